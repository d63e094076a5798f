"""Describe a kind of dynamics, and build the parts of its Euler-Maruyama step: length, noise, and where it leads.

Kernels are compiled for one `KernelSpec`; all parts take the scratch that paths of a thread share (`path.Scratch`).
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.geometry.polygon import variance_along
from pirrht.geometry.space import GOAL, SpaceKernels, pose_at
from pirrht.geometry.world import NOTHING_MOVES, MovingKernels, merging
from pirrht.jit import vectors
from pirrht.jit.jit import borrowing, part
from pirrht.jit.streams import ONE, SIDEWAYS, ZERO, fill_normals
from pirrht.jit.vectors import copy_row
from pirrht.rollouts.first_exit import fitting, slope_for, turn_of
from pirrht.rollouts.tables import law_columns
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import no_drift, no_homing
from pirrht.topology.signature import SignatureKernels
from pirrht.traits import Traits

NO_WALLS = {2: (ONE, (ZERO, ZERO), ONE, (ZERO, ZERO)), 3: (ONE, (ZERO, ZERO, ZERO), ONE, (ZERO, ZERO, ZERO))}
SWAY = 1.0 / math.sqrt(12.0)  # deviation of the mean of a step's noise from its middle, in deviations of the noise


class Clear(NamedTuple):
    """Clearance of a state, as far as it is known."""

    distances: Any  # `SpaceKernels.distances`, perhaps those of an earlier state
    least: float  # clearance at least [m]
    known: bool  # whether the distances are those of the state


class Moved(NamedTuple):
    """Outcome of a step's motion."""

    arrived: bool  # it enters the goal straight ahead before its noise matters: then that is zero
    ahead: float  # the share of it until then
    turn: float  # how much its path bends [rad]
    rates: Any  # covariance of the pose per second


class KernelSpec(NamedTuple):
    """A kind of dynamics and cost rate for which kernels are compiled; functions are numba's."""

    drift: Callable[..., None]  # (x, p, out)
    control_block: Callable[..., None] | None  # G_c (x, p, out); None: B^-1 G, which turns u into a, is constant
    diffusion_block: Callable[..., None] | None  # B_c (x, p, out); in input form G, of which B = G s; None: constant
    q: Callable[..., float]  # (x, p) [cost/s], if it varies
    n: int  # states
    m: int  # controls
    traits: Traits  # of the system
    space: SpaceKernels  # kernels of what is static, for the robot's footprint
    reads: tuple[int, ...]  # indices of the states that they read: the position, and perhaps the heading
    angles: int = 0  # bit k: the k-th state is a heading
    homing: Callable[..., None] = no_homing  # (x, p, B, aim, radius, rate, out): `Dynamics.homing`
    stratonovich: bool = False  # whether f and G are those of the middle of a step: `Dynamics.stratonovich`
    moving: MovingKernels | None = None  # kernels of moving obstacles; None: they are compiled away
    curved_step: bool = False  # whether paths bend within a step by its noise, of which the mean over it is drawn too
    classes: SignatureKernels | None = None  # kernels of the signature of paths; None: their keys are 0

    @property
    def position(self) -> tuple[int, ...]:
        """Indices of the states that are the position."""
        return self.reads[: self.space.position]

    @property
    def noisy_position(self) -> bool:
        """Tell whether noise acts on the position."""
        return self.traits.noisy_position

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Numbers of states, of controls, of rows of B, and of modes of noise."""
        return self.n, self.m, self.rows, self.modes

    @property
    def varying_rate(self) -> bool:
        """Tell whether q varies."""
        return not self.traits.constant_rate

    @property
    def rows(self) -> int:
        """Trailing states that B has rows for."""
        return self.n if self.traits.input_form else self.m

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
        return self.traits.free_point and self.moving is not None

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
    rows, m, input_form = kind.rows, kind.m, kind.traits.input_form

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
    facing, spread = kind.space.facing, kind.space.spread
    pose = pose_at(kind.reads)
    whole = of_pose(len(kind.reads))

    @part
    def gap_of(scratch, static, before, rates, close):  # type: ignore[no-untyped-def]
        gap, border, _ = before[:3]
        if along_line:
            gap = facing(static, pose(scratch.x), before, rates)
        gap = min(gap, border)
        most = spread(static, rates, along_line)
        gap = min(gap, gap_among(scratch.walls, close, whole(rates), most, along_line))
        return max(gap, 0.0), math.sqrt(most)

    return gap_of


@part
def gap_among(walls, count, cov, most, along_line):  # type: ignore[no-untyped-def]
    """Return the least clearance of moving walls [m], along a line over the share of noise they face (`facing`)."""
    nearest = np.inf
    for k in range(count):
        share = variance_along((walls[k, 1], walls[k, 2], walls[k, 3]), cov) / most if along_line else 1.0
        nearest = min(nearest, walls[k, 0] / math.sqrt(max(share, SIDEWAYS)))
    return nearest


@cache
def length_for(kind: KernelSpec) -> Any:
    """Build the kernel that fits a step to the clearance, and writes moving walls near it: (dt, how many)."""
    moving, along_line, near = kind.moving is not None, kind.along_line, (kind.moving or NOTHING_MOVES).walls
    facing, spread = kind.space.facing, kind.space.spread
    pose = pose_at(kind.reads)
    of_rates = of_pose(len(kind.reads))

    @part
    def narrowest(tables, scratch, arena, rates, before, left, close):  # type: ignore[no-untyped-def]
        """Return the distance that the step is fitted to, and what fitting scales its square by."""
        most = spread(arena.static, rates, along_line)
        scale = 1.0 / (9.0 * most)
        gap, border, to_rim = before[:3]

        if along_line and gap > 0.0 and scale * gap * gap < left:
            gap = facing(arena.static, pose(scratch.x), before, rates)
        if moving:
            gap = min(gap, gap_among(scratch.walls, close, of_rates(rates), most, along_line))
        return max(min(min(gap, border), max(to_rim, TUNING.rim * arena.radius)), 0.0), scale

    @part
    def fitted(setup, tables, scratch, rates, before, left, now):  # type: ignore[no-untyped-def]
        close = 0
        until = np.inf
        dt = left

        if moving:  # as far as noise carries a path that is not to be split, or walls push
            here = pose(scratch.x)
            reach = 3.0 * math.sqrt(spread(setup.world.static, rates, False) * left)
            within = max(reach, TUNING.push_cutoff * tables.wall_offset)
            close, until = near(setup.world.moving, scratch.watch, here, now, within, scratch.walls)
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
def in_plane(width: int) -> Any:
    """Build the kernel that takes (xx, xy, yy) of the covariance of a pose of two or three numbers."""
    return part(lambda cov: cov) if width == 2 else part(lambda cov: (cov[0], cov[1], cov[3]))


@cache
def of_pose(width: int) -> Any:
    """Build the kernel that takes the covariance (xx, xy, xt, yy, yt, tt) of that of a pose of two or three numbers."""
    return part(lambda cov: cov) if width == 3 else part(lambda cov: (cov[0], cov[1], 0.0, cov[2], 0.0, 0.0))


class PoseNoise(NamedTuple):
    """Kernels of the rows of B that act on a pose."""

    covariance: Any  # (B): covariance of the pose per second, as `SpaceKernels` take it
    scaled: Any  # (rates, dt): that over a time
    size: Any  # (rates): variance of the position per second, in all directions together [m^2/s]
    row: Any  # (B, j): column j of these rows
    along: Any  # (B, slope, out, g): write B' s of a slope, a direction, to row g of out (.., m or more)


@cache
def algebra(width: int) -> tuple[Any, Any]:
    """Return the functions (s, a, t, b) and (a, b) that combine and multiply places of so many numbers."""
    return vectors.combined(width), vectors.dot(width)


@cache
def pose_noise(kind: KernelSpec) -> PoseNoise:
    """Build the kernels of the rows of B that act on a pose; rows that B lacks are zero."""
    m, fixed = kind.m, kind.n - kind.rows
    i, j, k = (*(at - fixed for at in kind.reads), 0)[:3]
    of_dot = vectors.dot(len(kind.reads))

    row = part(lambda B, c: (B[i, c] if i >= 0 else 0.0, B[j, c] if j >= 0 else 0.0))
    if len(kind.reads) == 3:
        row = part(lambda B, c: (B[i, c] if i >= 0 else 0.0, B[j, c] if j >= 0 else 0.0, B[k, c] if k >= 0 else 0.0))

    @part
    def of_two(B):  # type: ignore[no-untyped-def]
        xx, xy, yy = 0.0, 0.0, 0.0
        for c in range(m):
            bx, by = row(B, c)
            xx += bx * bx
            xy += bx * by
            yy += by * by
        return xx, xy, yy

    @part
    def of_three(B):  # type: ignore[no-untyped-def]
        xx, xy, xt, yy, yt, tt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(m):
            bx, by, bt = row(B, c)
            xx += bx * bx
            xy += bx * by
            xt += bx * bt
            yy += by * by
            yt += by * bt
            tt += bt * bt
        return xx, xy, xt, yy, yt, tt

    @part
    def along(B, slope, out, g):  # type: ignore[no-untyped-def]
        for c in range(m):
            out[g, c] = of_dot(row(B, c), slope)

    if len(kind.reads) == 2:
        scaled = part(lambda rates, dt: (rates[0] * dt, rates[1] * dt, rates[2] * dt))
        return PoseNoise(of_two, scaled, part(lambda rates: rates[0] + rates[2]), row, along)
    scaled = part(lambda r, dt: (r[0] * dt, r[1] * dt, r[2] * dt, r[3] * dt, r[4] * dt, r[5] * dt))
    size = part(lambda r: r[0] + r[3])
    if len(kind.position) == 3:
        size = part(lambda r: r[0] + r[3] + r[5])
    return PoseNoise(of_three, scaled, size, row, along)


@cache
def walls_for(kind: KernelSpec) -> Any:
    """Build the kernel that writes the drift of the two nearest walls, B' grad log psi there, and returns those."""
    moving = kind.moving is not None
    two_walls, spread = kind.space.known_walls, kind.space.spread
    pose, slope, with_walls = pose_at(kind.reads), slope_for(len(kind.reads)), merging(len(kind.reads))
    along_noise = pose_noise(kind).along

    @part
    def push_of(tables, scratch, arena, before, cov, close):  # type: ignore[no-untyped-def]
        c, n, d, m = two_walls(arena.static, pose(scratch.x), before)
        widest = np.float32(0.5 * math.sqrt(spread(arena.static, cov, False)))
        shift = np.float32(tables.set_back)
        walls = (max(c + shift, widest), n, max(d + shift, widest), m)
        if moving and close > 0:
            walls = with_walls(walls, scratch.walls, close, np.float64(widest))
        along_noise(scratch.B, slope(walls, tables.wall_offset), scratch.wall_drift, 0)
        return walls

    return push_of


@cache
def shapes_for(kind: KernelSpec) -> Any:
    """Build the kernel that tells whether the noise of a step has the covariance of its law, whichever law that is.

    Where noise acts on the position, that of a step which ends at a crossing counts until then only. So steps that are
    split near walls have the covariance of the passive noise, and those that may enter the goal.
    """
    noisy_position, gated, size_of = kind.noisy_position, kind.gated, pose_noise(kind).size

    @part
    def shapes(setup, dt, whole, rates, distances):  # type: ignore[no-untyped-def]
        if gated:
            return False
        if not noisy_position:
            return True
        way = TUNING.entering * math.sqrt(2.0 * setup.least_rate) * dt + TUNING.deviations * math.sqrt(dt)
        _, _, to_rim = distances[:3]
        return dt == whole and to_rim > way * math.sqrt(size_of(rates))

    return shapes


@cache
def noise_for(kind: KernelSpec) -> Any:
    """Build the kernel that draws the noise `y` of a step and `drawn` with all modes; it returns the stream."""
    modes = kind.modes

    column = law_columns(kind.n, modes).deviation
    even = modes + modes % 2
    steps = kind.abreast

    matvec = vectors.matvec(modes, modes)
    axpy = vectors.axpy(modes)

    @part
    def under_law(tables, scratch, state, sign, h, i, dt, shaped):  # type: ignore[no-untyped-def]
        """Draw under a law's step, whose covariance counts where the step is `shaped` by it (`shapes_for`)."""
        drawn = scratch.drawn

        if i % steps == 0:  # those of several steps at once where no other draws come between
            state = fill_normals(state, steps * even // 2, scratch.fresh)
        source = scratch.fresh.ctypes.data + 8 * even * (i % steps)
        if shaped and scratch.stage[h] < tables.law_length[h]:
            row = tables.law.ctypes.data + 8 * tables.law.shape[2] * (tables.law.shape[1] * h + scratch.stage[h])
            matvec(drawn.ctypes.data, row + 8 * column, source)
            source = drawn.ctypes.data
        axpy(drawn.ctypes.data, source, sign * math.sqrt(dt), scratch.a.ctypes.data + 8 * scratch.a.shape[1] * h, dt)
        copy_row(drawn, scratch.y)
        return state

    return under_law


@cache
def motion(kind: KernelSpec) -> Any:
    """Build the kernel that writes where a step leads to `scratch.moved`, and returns how (`Moved`)."""
    n, m, rows, _ = kind.sizes
    fixed = n - rows

    drift = kind.drift
    stratonovich = kind.stratonovich
    noisy_position = kind.noisy_position
    curved_step = kind.curved_step

    drifting = drift is not no_drift
    varying = kind.diffusion_block is not None
    noise_at: Any = diffusion_of(kind) if varying else drift
    covariance = pose_noise(kind).covariance
    pose, sweep = pose_at(kind.reads), kind.space.sweep
    onward = vectors.combined(len(kind.reads))
    place = pose_at(kind.position)
    between, square = algebra(len(kind.position))
    bends = curved_step and len(kind.position) == 2  # in space steps are chords: they bow by millimetres

    @part
    def shaken(scratch, share):  # type: ignore[no-untyped-def]
        """Add a share of the step's noise to where it leads."""
        for j in range(rows):
            for k in range(m):
                scratch.moved[fixed + j] += share * scratch.B[j, k] * scratch.y[k]

    @part
    def half_way(setup, scratch, dt):  # type: ignore[no-untyped-def]
        """Take the drift where no noise acts on the position: at the middle of the step's noise, or its mean over it.

        The mean is by two points about the mean state, apart by the deviation of the state within the step.
        """
        moved = scratch.moved

        copy_row(scratch.x, moved)
        shaken(scratch, 0.5)
        if not curved_step:
            drift(moved, setup.parameters, scratch.f)
            return
        for k in range(m):
            scratch.column[k] = math.copysign(SWAY * math.sqrt(scratch.y[k] * scratch.y[k] + dt), scratch.y[k])
        copy_row(moved, scratch.apart)
        for j in range(rows):
            for k in range(m):
                mean = SWAY * scratch.B[j, k] * scratch.drawn[m + k]
                spread = scratch.B[j, k] * scratch.column[k]
                moved[fixed + j] -= mean + spread
                scratch.apart[fixed + j] -= mean - spread
        drift(moved, setup.parameters, scratch.f)
        drift(scratch.apart, setup.parameters, moved)
        for j in range(n):
            scratch.f[j] = 0.5 * (scratch.f[j] + moved[j])

    @part
    def arrives(setup, scratch, dt):  # type: ignore[no-untyped-def]
        """Check whether the step enters the goal straight ahead, then without noise; return its share until then."""
        f = scratch.f
        here = pose(scratch.x)
        velocity = place(f)
        within = setup.world.radius + math.sqrt(square(velocity, velocity)) * dt
        to_goal = between(1.0, place(scratch.x), -1.0, setup.world.goal)
        if square(to_goal, to_goal) >= within * within:
            return False, 1.0
        exit, ahead, _ = sweep(setup.world, here, onward(1.0, here, dt, pose(f)), 0.0, 0.0)
        for j in range(m if exit == GOAL else 0):
            scratch.y[j] = 0.0
        return exit == GOAL, ahead

    @part
    def at_middle(setup, scratch, dt, rates):  # type: ignore[no-untyped-def]
        """Take drift and noise of the middle of the step; return the covariance per second."""

        for j in range(n):
            scratch.moved[j] = scratch.x[j] + 0.5 * scratch.f[j] * dt
        shaken(scratch, 0.5)
        if varying:
            noise_at(scratch.moved, setup.parameters, setup.inverse, scratch.G, scratch.B)
            rates = covariance(scratch.B)
        if drifting and (noisy_position or not setup.bridge):
            drift(scratch.moved, setup.parameters, scratch.f)
        return rates

    @part
    def move(setup, scratch, dt, rates):  # type: ignore[no-untyped-def]
        moved, f = scratch.moved, scratch.f

        arrived = False
        ahead = 1.0
        turn = 0.0
        before = place(f)

        if not noisy_position and setup.bridge:
            arrived, ahead = arrives(setup, scratch, dt)
            if drifting and not arrived:
                half_way(setup, scratch, dt)
        if stratonovich and not arrived:
            rates = at_middle(setup, scratch, dt, rates)
        for j in range(n):
            moved[j] = scratch.x[j] + f[j] * dt
        shaken(scratch, 1.0)
        if curved_step and not arrived:  # between two steps its velocity changes, and its path is no chord
            drift(moved, setup.parameters, f)
        if bends and not arrived:
            turn = turn_of(before, place(f), between(1.0, place(moved), -1.0, place(scratch.x)), dt)
        return Moved(arrived, ahead, turn, rates)

    return move
