"""Compute the control of every reference at a state, in noise units: a_g = B_c^-1 G_c u_g.

A linear law has rows of m modes per step or, where sways are drawn too, twice as many (`LawRows`). Past its end
samples home in on the goal.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.jit.jit import jitable, load_float64, part
from pirrht.rollouts.step import KernelSpec, pose_noise
from pirrht.rollouts.tables import FINER, grid_slope, law_columns, slope_of, tube_at, tube_of
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import wrapped


@jitable
def straight_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Head straight for the goal from x (2,) at the best speed: `Dynamics.homing` of a point among moving obstacles."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    det = B[0, 0] * B[1, 1] - B[0, 1] * B[1, 0]
    a = (B[1, 1] * dx - B[0, 1] * dy) / det
    b = (B[0, 0] * dy - B[1, 0] * dx) / det
    scale = math.sqrt(2.0 * rate) / (math.sqrt(a * a + b * b) + 1e-12)

    out[0] = scale * a
    out[1] = scale * b


@cache
def aims(kind: KernelSpec) -> Any:
    """Build the kernel that writes `a` of every reference, of all modes."""
    n, m, _, modes = kind.sizes
    angles = kind.angles
    noisy_position = kind.noisy_position

    takes_law, gated, moving = kind.takes_law, kind.gated, kind.moving is not None
    along_noise, homing_of, climbs = pose_noise(kind).along, kind.homing, kind.traits.isotropic_point
    column = law_columns(n, modes)

    @part
    def off(x, row, k):  # type: ignore[no-untyped-def]
        """Return how far state k is from that of a law's row at an address."""
        apart = x[k] - load_float64(row, column.state + k)
        return wrapped(apart) if (angles >> k) & 1 else apart

    @part
    def distance(x, row):  # type: ignore[no-untyped-def]
        """Return the square of the distance from x (n,) to the state of a law's row at an address."""
        total = 0.0
        for k in range(n):
            apart = off(x, row, k)
            total += load_float64(row, column.metric + k) * apart * apart
        return total

    @part
    def nearest(first, pitch, s, last, x):  # type: ignore[no-untyped-def]
        """Return the nearest row, of those from s on that come nearer one by one; they lie `pitch` bytes apart."""
        here = distance(x, first + pitch * s)
        for step in (1, -1):
            while 0 <= s + step <= last:
                onward = distance(x, first + pitch * (s + step))
                if onward >= here:
                    break
                s, here = s + step, onward
        return s

    @part
    def row_of(tables, scratch, g, at):  # type: ignore[no-untyped-def]
        """Find the row of a law: the one that is due among moving obstacles, else the one whose state is nearest."""
        law = tables.law
        s = scratch.stage[g]
        i, share = at

        if moving:
            s = min(i * FINER + int(FINER * share + 0.5), law.shape[1] - 1)
        elif s < tables.law_length[g]:
            pitch = 8 * law.shape[2]
            final = min(tables.law_length[g], law.shape[1] - 1)
            first = law.ctypes.data + pitch * law.shape[1] * g
            s = nearest(first, pitch, min(s + FINER, final) if i > 0 else s, final, scratch.x)
        scratch.stage[g] = s
        return s

    @part
    def along_row(tables, scratch, g, s):  # type: ignore[no-untyped-def]
        """Write `a` of a law's row s."""

        row = tables.law.ctypes.data + 8 * tables.law.shape[2] * (tables.law.shape[1] * g + s)
        steep = load_float64(row, column.steepest)
        for k in range(n):
            scratch.apart[k] = off(scratch.x, row, k)
        for j in range(modes):
            total = load_float64(row, column.mean + j)
            for k in range(n):
                total += load_float64(row, column.gains + k * modes + j) * scratch.apart[k]
            scratch.a[g, j] = max(-steep, min(steep, total))

    @part
    def along_tube(tables, scratch, g, goal, walls):  # type: ignore[no-untyped-def]
        """Write `a` of a tube, whose desirability is climbed."""
        stage = scratch.stage
        px = np.float32(scratch.x[0])

        stage[g] = tube_at(
            tube_of(tables.ways, g), stage[g], tables.ways.decay, goal, px, np.float32(scratch.x[1]), scratch.tube, 0, 1
        )
        c, (wx, wy), d, (vx, vy) = walls
        along_noise(scratch.B, slope_of(scratch.tube, 0, 1, (c, wx, wy, d, vx, vy)), scratch.a, g)

    @part
    def along_grid(tables, scratch, g, goal, walls):  # type: ignore[no-untyped-def]
        """Write `a` of a grid in space, whose desirability is climbed, without wall drift."""
        x = scratch.x
        along_noise(scratch.B, grid_slope(tube_of(tables.ways, g), x[0], x[1], x[2]), scratch.a, g)

    in_space = len(kind.position) == 3
    along_way = along_grid if in_space else along_tube

    @part
    def along_law(setup, tables, scratch, g, at, headed):  # type: ignore[no-untyped-def]
        """Write `a` of a law, or past its end of homing, which is computed once; return whether it is."""
        world, s = setup.world, row_of(tables, scratch, g, at)
        if s < tables.law_length[g]:
            along_row(tables, scratch, g, s)
            return headed
        if not headed:
            homing_of(scratch.x, setup.parameters, scratch.B, world.goal, world.radius, setup.least_rate, scratch.home)
        for j in range(modes):
            scratch.a[g, j] = scratch.home[j] if j < m else 0.0
        return True

    @part
    def add(tables, scratch, g, i):  # type: ignore[no-untyped-def]
        """Add the control sequence, and wall drift where noise moves the position and neither tube nor law has it."""
        pushed = in_space or tables.ways.count[g] == 0
        pushed = pushed and (tables.law_length[g] == 0 or gated) and tables.wall_offset > 0.0
        for j in range(m if i < tables.active[g] else 0):
            for k in range(m):
                scratch.a[g, j] += scratch.D[j, k] * tables.control[g, i, k]
        for j in range(m if noisy_position and pushed else 0):
            scratch.a[g, j] += scratch.wall_drift[0, j]

    @part
    def aim(setup, tables, scratch, ratio, walls, h, at):  # type: ignore[no-untyped-def]
        """Write them at (step i of the grid, share of it); if nothing is weighed, only that of the one followed, h."""
        weigh, headed = ratio.shape[0] > 0, False
        for g in range(0 if weigh else h, scratch.a.shape[0] if weigh else h + 1):
            if (takes_law or in_space) and weigh:
                # dQ_g/dQ_h is a martingale, so that exp(-lost) is also the expected share of it later; never of h.
                scratch.lost[g] = scratch.lost[g] or ratio[g] < ratio[h] - TUNING.negligible
            if scratch.lost[g]:
                continue
            if climbs and tables.ways.count[g] > 0:
                along_way(tables, scratch, g, setup.world.goal, walls)
            elif takes_law and tables.law_length[g] > 0:
                headed = along_law(setup, tables, scratch, g, at, headed)
            else:
                for j in range(modes):
                    scratch.a[g, j] = 0.0
            add(tables, scratch, g, at[0])

    return aim
