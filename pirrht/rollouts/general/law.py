"""Compute the control of every reference at a state, in noise units: a_g = B_c^-1 G_c u_g.

A linear law has rows of m modes per step or, where sways are drawn too, twice as many (`LawRows`). Past its end
samples home in on the goal.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.jit.jit import jitable, load_float64, part
from pirrht.rollouts.general.kind import KernelSpec
from pirrht.rollouts.tables import FINER, law_columns, slope_of, tube_at, tube_of
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import wrapped


@jitable
def straight_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Head straight for the goal from x (2,) at the best speed: `Dynamics.homing` of a point among moving obstacles."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    det = B[0, 0] * B[1, 1] - B[0, 1] * B[1, 0]
    a, b = (B[1, 1] * dx - B[0, 1] * dy) / det, (B[0, 0] * dy - B[1, 0] * dx) / det
    size = math.sqrt(a * a + b * b) + 1e-12
    scale = math.sqrt(2.0 * rate) / size
    out[0], out[1] = scale * a, scale * b


@cache
def nearest_of(n: int, angles: int) -> Any:
    """Build the kernel (address, pitch, s, last, x (n,), there, weights) that finds a law's nearest step from s on.

    Bits of `angles` mark headings. Rows begin at the address, `pitch` bytes apart; states are at column `there`,
    weights of squares at `weights`. Steps are followed as long as they come nearer.
    """

    @part
    def apart(row, x, there, weights):  # type: ignore[no-untyped-def]
        """Square of the distance from x (n,) to the state of a law's row at an address."""
        total = 0.0
        for k in range(n):
            off = x[k] - load_float64(row, there + k)
            if (angles >> k) & 1:
                off = wrapped(off)
            total += load_float64(row, weights + k) * off * off
        return total

    @part
    def nearest(first, pitch, s, last, x, there, weights):  # type: ignore[no-untyped-def]
        """Return the nearest step, up to the last one."""
        here = apart(first + pitch * s, x, there, weights)
        onward = apart(first + pitch * (s + 1), x, there, weights) if s < last else np.inf
        if onward < here:
            while onward < here:
                s, here = s + 1, onward
                onward = apart(first + pitch * (s + 1), x, there, weights) if s < last else np.inf
            return s
        while s > 0:
            onward = apart(first + pitch * (s - 1), x, there, weights)
            if onward >= here:
                break
            s, here = s - 1, onward
        return s

    return nearest


@cache
def aims(kind: KernelSpec) -> Any:
    """Build the kernel that writes `a` of every reference, and with a law `wide`."""
    n, m, modes, rows, angles, noisy_position = kind.n, kind.m, kind.modes, kind.rows, kind.angles, kind.noisy_position
    takes_law, gated, state_dependent_gain = kind.takes_law, kind.gated, kind.state_dependent_gain
    moving = kind.moving is not None
    fixed, homing_of, nearest = n - rows, kind.homing, nearest_of(n, angles)
    _, _, there, _, _, end, _, metric, _ = law_columns(n, modes)

    @part
    def row_of(tables, scratch, g, at):  # type: ignore[no-untyped-def]
        """Find the row of a law: the one that is due among moving obstacles, else the one whose state is nearest."""
        law, led, s, (i, share) = tables.law, tables.law_length, scratch.stage[g], at
        if moving:
            s = min(i * FINER + int(FINER * share + 0.5), law.shape[1] - 1)
        elif s < led[g]:
            pitch, final = 8 * law.shape[2], min(led[g], law.shape[1] - 1)
            first = law.ctypes.data + pitch * law.shape[1] * g
            s = nearest(first, pitch, min(s + FINER, final) if i > 0 else s, final, scratch.x, there, metric)
        scratch.stage[g] = s
        return s

    @part
    def along_row(tables, scratch, g, s):  # type: ignore[no-untyped-def]
        """Write `wide` of a law's row s."""
        law, x, wide, apart = tables.law, scratch.x, scratch.wide, scratch.apart
        row = law.ctypes.data + 8 * law.shape[2] * (law.shape[1] * g + s)
        for k in range(n):
            apart[k] = x[k] - load_float64(row, there + k)
            if (angles >> k) & 1:
                apart[k] = wrapped(apart[k])
        steep = load_float64(row, end + 1)
        for j in range(modes):
            total = load_float64(row, j)
            for k in range(n):
                total += load_float64(row, modes + k * modes + j) * apart[k]
            wide[g, j] = max(-steep, min(steep, total))

    @part
    def along_tube(tables, scratch, g, goal, walls):  # type: ignore[no-untyped-def]
        """Write `a` of a tube, whose desirability is climbed."""
        ways, x, B, stage = tables.ways, scratch.x, scratch.B, scratch.stage
        px, py = np.float32(x[0]), np.float32(x[1])
        stage[g] = tube_at(tube_of(ways, g), stage[g], ways.decay, goal, px, py, scratch.tube, 0, 1)
        sx, sy = slope_of(scratch.tube, 0, 1, walls)
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            scratch.a[g, j] = bx * sx + by * sy

    @part
    def along_law(setup, tables, scratch, g, at, headed):  # type: ignore[no-untyped-def]
        """Write `a` and `wide` of a law, or past its end of homing, which is computed once; return whether it is."""
        a, wide, home, world = scratch.a, scratch.wide, scratch.home, setup.world
        s = row_of(tables, scratch, g, at)
        if s < tables.law_length[g]:
            along_row(tables, scratch, g, s)
        else:
            if not headed:
                homing_of(scratch.x, setup.parameters, scratch.B, world.goal, world.radius, setup.least_rate, home)
                headed = True
            for j in range(modes):
                wide[g, j] = home[j] if j < m else 0.0
        for j in range(m):
            a[g, j] = wide[g, j]
        return headed

    @part
    def without_law(scratch, g):  # type: ignore[no-untyped-def]
        """Write zeros."""
        for j in range(m):
            scratch.a[g, j] = 0.0
        for j in range(modes if takes_law else 0):
            scratch.wide[g, j] = 0.0

    @part
    def add_sequence(tables, scratch, g, i):  # type: ignore[no-untyped-def]
        """Add the control sequence."""
        for j in range(m):
            if state_dependent_gain:
                for k in range(m):
                    scratch.a[g, j] += scratch.D[j, k] * tables.control[g, i, k]
            else:
                scratch.a[g, j] += tables.drift[g, i, j]

    @part
    def drifts(tables, g):  # type: ignore[no-untyped-def]
        """Tell whether walls push on top: where noise moves the position, and neither tube nor law has it."""
        apart = tables.ways.count[g] == 0 and (tables.law_length[g] == 0 or gated)
        return noisy_position and tables.wall_offset > 0.0 and apart

    @part
    def add(tables, scratch, g, i):  # type: ignore[no-untyped-def]
        """Add the control sequence, and wall drift where nothing else has it."""
        a, pushed, under_way = scratch.a, drifts(tables, g), i < tables.active[g]
        if under_way:
            add_sequence(tables, scratch, g, i)
        for j in range(m if pushed else 0):
            a[g, j] += scratch.wall_drift[j]
        for j in range(m if takes_law and (under_way or pushed or tables.ways.count[g] > 0) else 0):
            scratch.wide[g, j] = a[g, j]

    @part
    def aim(setup, tables, scratch, ratio, walls, h, at):  # type: ignore[no-untyped-def]
        """Write them at (step i of the grid, share of it); if nothing is weighed, only that of the one followed, h."""
        lost, weigh, headed = scratch.lost, ratio.shape[0] > 0, False
        for g in range(0 if weigh else h, scratch.a.shape[0] if weigh else h + 1):
            if takes_law and weigh:
                # dQ_g/dQ_h is a martingale, so that exp(-lost) is also the expected share of it later; never of h.
                lost[g] = lost[g] or ratio[g] < ratio[h] - TUNING.negligible
            if lost[g]:
                continue
            if noisy_position and tables.ways.count[g] > 0:
                along_tube(tables, scratch, g, setup.world.goal, walls)
            elif takes_law and tables.law_length[g] > 0:
                headed = along_law(setup, tables, scratch, g, at, headed)
            else:
                without_law(scratch, g)
            add(tables, scratch, g, at[0])

    return aim
