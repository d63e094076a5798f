"""Describe a kind of dynamics, and build the parts of its Euler-Maruyama step: length, noise, and where it leads.

Kernels are compiled for one `KernelSpec`; all parts take the scratch that paths of a thread share (`path.Scratch`).
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.geometry.field import two_walls
from pirrht.geometry.world import NOTHING_MOVES, MovingKernels, with_walls
from pirrht.jit import vectors
from pirrht.jit.jit import borrowing, part
from pirrht.jit.streams import ONE, SIDEWAYS, ZERO, fill_normals
from pirrht.jit.vectors import copy_row
from pirrht.rollouts.first_exit import GOAL, facing, fitting, sweep_exit, turn_of, wall_slope
from pirrht.rollouts.tables import law_columns
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import no_drift, no_homing
from pirrht.topology.signature import SignatureKernels
from pirrht.traits import Traits

NO_WALLS = ONE, ZERO, ZERO, ONE, ZERO, ZERO
SWAY = 1.0 / math.sqrt(12.0)  # deviation of the mean of a step's noise from its middle, in deviations of the noise


class KernelSpec(NamedTuple):
    """A kind of dynamics and cost rate for which kernels are compiled; functions are numba's."""

    drift: Callable[..., None]  # (x, p, out)
    control_block: Callable[..., None] | None  # G_c (x, p, out); None: B^-1 G, which turns u into a, is constant
    diffusion_block: Callable[..., None] | None  # B_c (x, p, out); in input form G, of which B = G s; None: constant
    q: Callable[..., float]  # (x, p) [cost/s], if it varies
    n: int  # states
    m: int  # controls
    traits: Traits  # of the system
    angles: int = 0  # bit k: the k-th state is a heading
    homing: Callable[..., None] = no_homing  # (x, p, B, aim, radius, rate, out): `Dynamics.homing`
    stratonovich: bool = False  # whether f and G are those of the middle of a step: `Dynamics.stratonovich`
    moving: MovingKernels | None = None  # kernels of moving obstacles; None: they are compiled away
    curved_step: bool = False  # whether paths bend within a step by its noise, of which the mean over it is drawn too
    classes: SignatureKernels | None = None  # kernels of the signature of paths; None: their keys are 0

    @property
    def noisy_position(self) -> bool:
        """Tell whether noise acts on the position."""
        return self.traits.noisy_position

    @property
    def input_form(self) -> bool:
        """Tell whether noise enters through inputs."""
        return self.traits.input_form

    @property
    def varying_rate(self) -> bool:
        """Tell whether q varies."""
        return not self.traits.constant_rate

    @property
    def rows(self) -> int:
        """Trailing states that B has rows for."""
        return self.n if self.input_form else self.m

    @property
    def along_line(self) -> bool:
        """Tell whether its position moves to and fro along a line alone."""
        return self.rows > self.m and self.noisy_position and not self.traits.drifts

    @property
    def modes(self) -> int:
        """Modes of the noise of a step: m, and as many sways of paths that bend."""
        return 2 * self.m if self.curved_step else self.m

    @property
    def abreast(self) -> int:
        """Steps whose noise is drawn at once."""
        return 1 if self.noisy_position else TUNING.abreast

    @property
    def gated(self) -> bool:
        """Tell whether walls push on top of its law (`law`): of a point among moving obstacles."""
        return self.moving is not None and self.traits.free_point

    @property
    def is_martingale(self) -> bool:
        """Tell whether the optimal control of a point is a martingale (`Traits.is_martingale`)."""
        return self.traits.is_martingale(self.moving is not None)

    @property
    def takes_law(self) -> bool:
        """Tell whether samples follow a linear law; those of a point among static obstacles climb psi instead."""
        return not self.traits.climbs(self.moving is not None)


@cache
def diffusion_of(kind: KernelSpec) -> Any:
    """Build the kernel (x, p, s, G, B) that writes B (rows, m) at x (n,) where it varies; G (n, m) is scratch."""
    block: Any = kind.diffusion_block
    rows, m, input_form = kind.rows, kind.m, kind.input_form

    @borrowing
    def noise_at(x, p, s, G, B):  # type: ignore[no-untyped-def]
        block(x, p, G if input_form else B)
        for i in range(rows if input_form else 0):
            for j in range(m):
                B[i, j] = 0.0
                for k in range(m):
                    B[i, j] += G[i, k] * s[k, j]

    return noise_at


@cache
def gap_for(kind: KernelSpec) -> Any:
    """Build the kernel of the nearest wall: its distance [m], and the deviation of noise towards it [m/sqrt(s)].

    Where noise acts along a line both are over the share of it that the wall faces (`facing`).
    """
    along_line = kind.along_line

    @part
    def gap_of(scratch, field, before, rates, close):  # type: ignore[no-untyped-def]
        gap, (xx, _, yy) = min(before[0], before[1]), rates
        if along_line:
            gap = min(facing(field, scratch.x[0], scratch.x[1], rates), before[1])
        gap = min(gap, gap_among(scratch.walls, close, rates, along_line))
        return max(gap, 0.0), math.sqrt(xx + yy if along_line else max(xx, yy))

    return gap_of


@part
def gap_among(walls, count, cov, along_line):  # type: ignore[no-untyped-def]
    """Return the least clearance of moving walls [m], along a line over the share of noise they face (`facing`)."""
    nearest = np.inf
    for k in range(count):
        nx, ny = walls[k, 1], walls[k, 2]
        share = 1.0

        if along_line:
            share = (cov[0] * nx * nx + 2.0 * cov[1] * nx * ny + cov[2] * ny * ny) / (cov[0] + cov[2])
        nearest = min(nearest, walls[k, 0] / math.sqrt(max(share, SIDEWAYS)))
    return nearest


@cache
def length_for(kind: KernelSpec) -> Any:
    """Build the kernel that fits a step to the clearance, and writes moving walls near it: (dt, how many)."""
    moving, along_line, near = kind.moving is not None, kind.along_line, (kind.moving or NOTHING_MOVES).walls

    @part
    def narrowest(tables, scratch, arena, rates, before, left, close):  # type: ignore[no-untyped-def]
        """Return the distance that the step is fitted to, and what fitting scales its square by."""
        (xx, xy, yy), x = rates, scratch.x
        scale = 1.0 / (9.0 * (xx + yy if along_line else max(xx, yy)))
        gap = before[0]

        if along_line and gap > 0.0 and scale * gap * gap < left:
            gap = facing(arena.field, x[0], x[1], (xx, xy, yy))
        if moving:
            gap = min(gap, gap_among(scratch.walls, close, rates, along_line))
        return max(min(min(gap, before[1]), max(before[2], TUNING.rim * arena.radius)), 0.0), scale

    @part
    def fitted(setup, tables, scratch, rates, before, left, now):  # type: ignore[no-untyped-def]
        x = scratch.x
        close = 0
        until = np.inf
        dt = left

        if moving:  # as far as noise carries a path that is not to be split, or walls push
            within = max(3.0 * math.sqrt(max(rates[0], rates[2]) * left), TUNING.push_cutoff * tables.wall_offset)
            close, until = near(setup.world.moving, scratch.watch, x[0], x[1], now, within, scratch.walls)
        if tables.least < left:
            narrow, scale = narrowest(tables, scratch, setup.world, rates, before, left, close)
            dt = fitting(narrow, left, tables.least, scale)
        if moving:
            dt = min(dt, max(until - now, TUNING.least_change))
        return dt, close

    @part
    def whole(setup, tables, scratch, rates, before, left, now):  # type: ignore[no-untyped-def]
        return left, 0

    return fitted if kind.noisy_position else whole


@cache
def planar(kind: KernelSpec) -> tuple[Any, Any]:
    """Build kernels of B's rows of the position: (B) for the covariance (xx, xy, yy) per second, and B' s for a row."""
    m, fixed = kind.m, kind.n - kind.rows

    @part
    def row(B, j):  # type: ignore[no-untyped-def]
        return B[0 - fixed, j] if fixed <= 0 else 0.0, B[1 - fixed, j] if fixed <= 1 else 0.0

    @part
    def covariance(B):  # type: ignore[no-untyped-def]
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(m):
            bx, by = row(B, j)
            xx += bx * bx
            xy += bx * by
            yy += by * by
        return xx, xy, yy

    @part
    def along_noise(B, sx, sy, out, g):  # type: ignore[no-untyped-def]
        """Write B' s of a slope (x, y) [1/m] to row g of out (.., m or more)."""
        for j in range(m):
            bx, by = row(B, j)
            out[g, j] = bx * sx + by * sy

    return covariance, along_noise


@cache
def walls_for(kind: KernelSpec) -> Any:
    """Build the kernel that writes the drift of the two nearest walls, B' grad log psi there, and returns those."""
    moving = kind.moving is not None
    _, along_noise = planar(kind)

    @part
    def push_of(tables, scratch, arena, cov, close):  # type: ignore[no-untyped-def]
        c, wx, wy, d, vx, vy = two_walls(arena.field, scratch.x[0], scratch.x[1])
        widest = np.float32(0.5 * math.sqrt(max(cov[0], cov[2])))
        shift = np.float32(tables.set_back)
        walls = (max(c + shift, widest), wx, wy, max(d + shift, widest), vx, vy)
        if moving and close > 0:
            walls = with_walls(walls, scratch.walls, close, np.float64(widest))
        sx, sy = wall_slope(*walls, tables.wall_offset)
        along_noise(scratch.B, sx, sy, scratch.wall_drift, 0)
        return walls

    return push_of


@cache
def shapes_for(kind: KernelSpec) -> Any:
    """Build the kernel that tells whether the noise of a step has the covariance of its law, whichever law that is.

    Where noise acts on the position, that of a step which ends at a crossing counts until then only. So steps that are
    split near walls have the covariance of the passive noise, and those that may enter the goal.
    """
    noisy_position, gated = kind.noisy_position, kind.gated

    @part
    def shapes(setup, dt, whole, rates, to_goal):  # type: ignore[no-untyped-def]
        if gated:
            return False
        if not noisy_position:
            return True
        way = TUNING.entering * math.sqrt(2.0 * setup.least_rate) * dt + TUNING.deviations * math.sqrt(dt)
        return dt == whole and to_goal > way * math.sqrt(rates[0] + rates[2])

    return shapes


@cache
def noise_for(kind: KernelSpec) -> Any:
    """Build the kernel that draws the noise `y` of a step and `drawn` with all modes; it returns the stream."""
    m, modes = kind.m, kind.modes

    shape = law_columns(kind.n, modes)[3]
    even = modes + modes % 2
    steps = kind.abreast

    matvec = vectors.matvec(modes, modes)
    axpy = vectors.axpy(modes)

    @part
    def under_law(tables, scratch, state, sign, h, i, dt, shaped):  # type: ignore[no-untyped-def]
        """Draw under a law's step, whose covariance counts where the step is `shaped` by it (`shapes_for`)."""
        law = tables.law
        drawn = scratch.drawn
        stage = scratch.stage
        a = scratch.a
        fresh = scratch.fresh

        if i % steps == 0:  # those of several steps at once where no other draws come between
            state = fill_normals(state, steps * even // 2, fresh)
        source = fresh.ctypes.data + 8 * even * (i % steps)
        if shaped and stage[h] < tables.law_length[h]:
            row = law.ctypes.data + 8 * law.shape[2] * (law.shape[1] * h + stage[h])
            matvec(drawn.ctypes.data, row + 8 * shape, source)
            source = drawn.ctypes.data
        axpy(drawn.ctypes.data, source, sign * math.sqrt(dt), a.ctypes.data + 8 * a.shape[1] * h, dt)
        for j in range(m):
            scratch.y[j] = drawn[j]
        return state

    return under_law


@cache
def motion(kind: KernelSpec) -> Any:
    """Build the kernel that writes where a step leads to `moved`.

    It returns whether the step enters the goal straight ahead before its noise matters (then y = 0), the share of it
    until then, how much its path bends [rad], and the covariance of the position per second.
    """
    n = kind.n
    m = kind.m
    rows = kind.rows
    fixed = kind.n - kind.rows

    drift = kind.drift
    stratonovich = kind.stratonovich
    noisy_position = kind.noisy_position
    curved_step = kind.curved_step

    drifting = drift is not no_drift
    varying = kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if varying else drift
    covariance = planar(kind)[0]

    @part
    def shaken(scratch, share):  # type: ignore[no-untyped-def]
        """Add a share of the step's noise to where it leads."""
        moved, B, y = scratch.moved, scratch.B, scratch.y
        for j in range(rows):
            for k in range(m):
                moved[fixed + j] += share * B[j, k] * y[k]

    @part
    def half_way(setup, scratch, dt):  # type: ignore[no-untyped-def]
        """Take the drift where no noise acts on the position: at the middle of the step's noise, or its mean over it.

        The mean is by two points about the mean state, apart by the deviation of the state within the step.
        """
        x = scratch.x
        moved = scratch.moved
        f = scratch.f
        B = scratch.B
        y = scratch.y
        p = setup.parameters

        copy_row(x, moved)
        shaken(scratch, 0.5)
        if not curved_step:
            drift(moved, p, f)
            return
        ahead = scratch.apart
        for k in range(m):
            scratch.column[k] = math.copysign(SWAY * math.sqrt(y[k] * y[k] + dt), y[k])
        copy_row(moved, ahead)
        for j in range(rows):
            for k in range(m):
                mean = SWAY * B[j, k] * scratch.drawn[m + k]
                spread = B[j, k] * scratch.column[k]
                moved[fixed + j] -= mean + spread
                ahead[fixed + j] -= mean - spread
        drift(moved, p, f)
        drift(ahead, p, moved)
        for j in range(n):
            f[j] = 0.5 * (f[j] + moved[j])

    @part
    def arrives(setup, scratch, dt):  # type: ignore[no-untyped-def]
        """Check whether the step enters the goal straight ahead, then without noise; return its share until then."""
        x, f, arena = scratch.x, scratch.f, setup.world
        within = arena.radius + math.sqrt(f[0] * f[0] + f[1] * f[1]) * dt
        if (x[0] - arena.goal[0]) ** 2 + (x[1] - arena.goal[1]) ** 2 >= within * within:
            return False, 1.0
        exit, ahead, _ = sweep_exit(arena, x[0], x[1], x[0] + f[0] * dt, x[1] + f[1] * dt)
        for j in range(m if exit == GOAL else 0):
            scratch.y[j] = 0.0
        return exit == GOAL, ahead

    @part
    def at_middle(setup, scratch, dt, rates):  # type: ignore[no-untyped-def]
        """Take drift and noise of the middle of the step; return the covariance per second."""
        x = scratch.x
        moved = scratch.moved
        f = scratch.f
        p = setup.parameters

        for j in range(n):
            moved[j] = x[j] + 0.5 * f[j] * dt
        shaken(scratch, 0.5)
        if varying:
            noise_at(moved, p, setup.inverse, scratch.G, scratch.B)
            rates = covariance(scratch.B)
        if drifting and (noisy_position or not setup.bridge):
            drift(moved, p, f)
        return rates

    @part
    def move(setup, scratch, dt, rates):  # type: ignore[no-untyped-def]
        x, moved, f = scratch.x, scratch.moved, scratch.f

        arrived = False
        ahead = 1.0
        turn = 0.0
        vx, vy = f[0], f[1]

        if not noisy_position and setup.bridge:
            arrived, ahead = arrives(setup, scratch, dt)
            if drifting and not arrived:
                half_way(setup, scratch, dt)
        if stratonovich and not arrived:
            rates = at_middle(setup, scratch, dt, rates)
        for j in range(n):
            moved[j] = x[j] + f[j] * dt
        shaken(scratch, 1.0)
        if curved_step and not arrived:  # between two steps its velocity changes, and its path is no chord
            drift(moved, setup.parameters, f)
            turn = turn_of(vx, vy, f[0], f[1], moved[0] - x[0], moved[1] - x[1], dt)
        return arrived, ahead, turn, rates

    return move
