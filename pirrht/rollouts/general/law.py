"""Compute the control of every reference at a state, in noise units: a_g = B_c^-1 G_c u_g.

A linear law has rows of m modes per step or, where sways are drawn too, twice as many (`law_width`). Gates bend it:
walls that a point has yet to pass make log psi rise towards their free sides. Past its end samples home in on the goal.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.jit import vectors
from pirrht.jit.jit import inlined, jitable, load_float64, part
from pirrht.rollouts.general.kind import KernelSpec, is_gated, takes_law
from pirrht.rollouts.tables import FINER
from pirrht.rollouts.ways import KNOWN, PLACE, numbers_at, slope_of
from pirrht.systems.heading import wrapped


@jitable
def straight_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Head straight for the goal from x (2,) at the best speed: `Dynamics.homing` of a point among moving obstacles."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    det = B[0, 0] * B[1, 1] - B[0, 1] * B[1, 0]
    a, b = (B[1, 1] * dx - B[0, 1] * dy) / det, (B[0, 0] * dy - B[1, 0] * dx) / det
    size = math.sqrt(a * a + b * b) + 1e-12
    scale = math.sqrt(2.0 * rate) / size
    out[0], out[1] = scale * a, scale * b


GATES = 2  # of a row of a law
GATE = 5  # numbers of one: direction (x, y) of its free side, z on the guide, its change per meter [1/m], weight


class LawTuning(NamedTuple):
    """Numbers of laws along paths."""

    lost: float = 30.0  # nats by which a path is less likely under another reference, which then counts for nothing:
    # dQ_g/dQ_h is a martingale, so that exp(-30) is also the expected share of it later
    mills_from: float = -6.0  # z at which the table of `mills` begins; below, two terms of the series suffice
    mills_to: float = 6.0  # z at which it ends; above, the ratio is below 1e-8
    mills_rows: int = 16  # of it per unit of z: more than 1e-4 of itself is not needed


TUNING = LawTuning()
_Z = np.arange(TUNING.mills_from, TUNING.mills_to + 0.5 / TUNING.mills_rows, 1.0 / TUNING.mills_rows)
MILLS = np.exp(-0.5 * _Z**2) * math.sqrt(2.0 / math.pi) / np.array([math.erfc(-z / math.sqrt(2.0)) for z in _Z])


@inlined
def mills(z):  # type: ignore[no-untyped-def]
    """phi(z) / Phi(z), by which log Phi grows with z, within 1e-4 of itself in the range of its table.

    It is h with h' = -h (z + h), so a cubic between two rows of a table has both slopes at no more than their h.
    """
    if z <= TUNING.mills_from:
        return -z + 1.0 / -z  # to z^-3
    if z >= TUNING.mills_to:
        return 0.0
    at = (z - TUNING.mills_from) * TUNING.mills_rows
    k = int(at)
    u, left, right, width = at - k, MILLS[k], MILLS[k + 1], 1.0 / TUNING.mills_rows
    begin = TUNING.mills_from + width * k
    rise, fall = -width * left * (begin + left), -width * right * (begin + width + right)
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * left + u * rise) + u * u * ((1.0 + 2.0 * v) * right - v * fall)


@inlined
def gate_slope(law, g, s, at, dx, dy):  # type: ignore[no-untyped-def]
    """Slope (x, y) of log psi that gates add [1/m], (dx, dy) [m] off the guide; row s of a law has them from `at`."""
    sx, sy = 0.0, 0.0
    for k in range(GATES):
        first = at + GATE * k
        per = law[g, s, first + 3]
        if per > 0.0:
            nx, ny = law[g, s, first], law[g, s, first + 1]
            push = law[g, s, first + 4] * per * mills(law[g, s, first + 2] + per * (nx * dx + ny * dy))
            sx, sy = sx + push * nx, sy + push * ny
    return sx, sy


@inlined
def columns_of(n, modes):  # type: ignore[no-untyped-def]
    """Columns of a law's row (`law_width`): slopes, state, deviation of noise, its inverse, log det."""
    there = modes + modes * n
    shape = there + n
    return modes, there, shape, shape + modes * modes, shape + 2 * modes * modes


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
def rows_of(n: int, m: int, most: int) -> tuple[Any, Any, Any, Any]:
    """Build kernels for rows of m or of `most` modes, at addresses; their last argument tells which."""
    affine_few, affine_many = vectors.affine(n, m), vectors.affine(n, most)
    clip_few, clip_many = vectors.clip(m), vectors.clip(most)
    matvec_few, matvec_many = vectors.matvec(m, m), vectors.matvec(most, most)
    axpy_few, axpy_many = vectors.axpy(m), vectors.axpy(most)

    @part
    def affine(out, row, beside, modes):  # type: ignore[no-untyped-def]
        """Write a + K beside, a law's row at a state that is `beside` (n,) its own."""
        if modes == most:
            affine_many(out, row, row + 8 * most, beside)
        else:
            affine_few(out, row, row + 8 * m, beside)

    @part
    def clip(row, bound, modes):  # type: ignore[no-untyped-def]
        """Keep all of a row within plus and minus a bound."""
        if modes == most:
            clip_many(row, bound)
        else:
            clip_few(row, bound)

    @part
    def matvec(out, matrix, row, modes):  # type: ignore[no-untyped-def]
        """Write a matrix, which lies transposed, times a row."""
        if modes == most:
            matvec_many(out, matrix, row)
        else:
            matvec_few(out, matrix, row)

    @part
    def axpy(out, x, a, y, b, modes):  # type: ignore[no-untyped-def]
        """Write a x + b y."""
        if modes == most:
            axpy_many(out, x, a, y, b)
        else:
            axpy_few(out, x, a, y, b)

    return affine, clip, matvec, axpy


@cache
def aims(kind: KernelSpec) -> Any:
    """Build the kernel that writes `a` of every reference, and with a law `wide`."""
    n, m, rows, moving, noisy_position = kind.n, kind.m, kind.rows, kind.moving, kind.noisy_position
    leadable, gated, state_dependent_gain = takes_law(kind), is_gated(kind), kind.state_dependent_gain
    fixed, angles, homing_of = n - rows, kind.angles, kind.homing
    nearest, (affine, clip, _, _) = nearest_of(n, angles), rows_of(n, m, kind.modes)

    @part
    def step_of(leads, scratch, g, i, share, modes):  # type: ignore[no-untyped-def]
        """Find the step of a law: the one that is due among moving obstacles, else the one whose state is nearest."""
        law, led, s = leads.law, leads.led, scratch.stage[g]
        if moving:
            s = min(i * FINER + int(FINER * share + 0.5), law.shape[1] - 1)
            scratch.stage[g] = s
        elif s < led[g]:
            _, there, _, _, end = columns_of(n, modes)
            pitch = 8 * law.shape[2]
            row, final = law.ctypes.data + pitch * law.shape[1] * g, min(led[g], law.shape[1] - 1)
            s = nearest(row, pitch, min(s + FINER, final) if i > 0 else s, final, scratch.x, there, end + 2)
            scratch.stage[g] = s
        return s

    @part
    def any_law(leads, scratch, g, s, modes):  # type: ignore[no-untyped-def]
        """Write `wide` of a law's step s."""
        law, x, wide, beside = leads.law, scratch.x, scratch.wide, scratch.beside
        _, there, _, _, end = columns_of(n, modes)
        row = law.ctypes.data + 8 * law.shape[2] * (law.shape[1] * g + s)
        for k in range(n):
            beside[k] = x[k] - load_float64(row, there + k)
            if (angles >> k) & 1:
                beside[k] = wrapped(beside[k])
        out, steep = wide.ctypes.data + 8 * wide.shape[1] * g, load_float64(row, end + 1)
        affine(out, row, beside.ctypes.data, modes)
        if gated:
            at_x, at_y = x[0] - law[g, s, there], x[1] - law[g, s, there + 1]
            sx, sy = gate_slope(law, g, s, end + 2 + n, at_x, at_y)
            for j in range(m):
                wide[g, j] += scratch.B[0, j] * sx + scratch.B[1, j] * sy
            for j in range(m):  # one by one, as they were written last
                wide[g, j] = max(-steep, min(steep, wide[g, j]))
        else:
            clip(out, steep, modes)

    @part
    def along_way(leads, scratch, g, goal, walls):  # type: ignore[no-untyped-def]
        """Write `a` of a way, whose desirability is climbed."""
        ways, x, B, stage = leads.ways, scratch.x, scratch.B, scratch.stage
        C, J = ways.slope.shape[1], ways.slope.shape[2]
        place, slope = ways.place.ctypes.data + 4 * PLACE * g * C, ways.slope.ctypes.data + 4 * KNOWN * g * C * J
        px, py = np.float32(x[0]), np.float32(x[1])
        stage[g] = numbers_at((place, slope, ways.count[g] - 1, J), stage[g], px, py, scratch.tube, 0, 1)
        sx, sy = slope_of(scratch.tube, 0, 1, ways.decay, goal, px, py, walls)
        for j in range(m):
            bx = B[0 - fixed, j] if fixed <= 0 else 0.0
            by = B[1 - fixed, j] if fixed <= 1 else 0.0
            scratch.a[g, j] = bx * sx + by * sy

    @part
    def along_law(setup, leads, scratch, g, i, share, modes, headed):  # type: ignore[no-untyped-def]
        """Write `a` and `wide` of a law, or past its end of homing, which is computed once; return whether it is."""
        a, wide, home, world = scratch.a, scratch.wide, scratch.home, setup.world
        s = step_of(leads, scratch, g, i, share, modes)
        if s < leads.led[g]:
            any_law(leads, scratch, g, s, modes)
        else:
            if not headed:
                homing_of(scratch.x, setup.parameters, scratch.B, world.goal, world.radius, setup.pace, home)
                headed = True
            for j in range(modes):
                wide[g, j] = home[j] if j < m else 0.0
        for j in range(m):
            a[g, j] = wide[g, j]
        return headed

    @part
    def without_law(scratch, g, modes):  # type: ignore[no-untyped-def]
        """Write zeros."""
        for j in range(m):
            scratch.a[g, j] = 0.0
        for j in range(modes if leadable else 0):
            scratch.wide[g, j] = 0.0

    @part
    def add(leads, scratch, g, i):  # type: ignore[no-untyped-def]
        """Add the control sequence, and wall drift where nothing else has it."""
        a, count = scratch.a, leads.ways.count[g]
        held = i < leads.active[g]
        pushing = noisy_position and leads.reach > 0.0 and count == 0 and (leads.led[g] == 0 or gated)
        for j in range(m if held else 0):
            a[g, j] += 0.0 if state_dependent_gain else leads.drift[g, i, j]
            for k in range(m if state_dependent_gain else 0):
                a[g, j] += scratch.D[j, k] * leads.control[g, i, k]
        for j in range(m if pushing else 0):
            a[g, j] += scratch.pushed[j]
        for j in range(m if leadable and (held or pushing or count > 0) else 0):
            scratch.wide[g, j] = a[g, j]

    @part
    def aim(setup, leads, scratch, ratio, walls, h, i, share, modes):  # type: ignore[no-untyped-def]
        """Write them after a share of step i of the grid; if nothing is weighed, only that of the one followed, h."""
        lost, weigh, headed = scratch.lost, ratio.shape[0] > 0, False
        for g in range(0 if weigh else h, scratch.a.shape[0] if weigh else h + 1):
            lost[g] = lost[g] or (leadable and weigh and ratio[g] < ratio[h] - TUNING.lost)
            if lost[g]:  # never of h
                continue
            if noisy_position and leads.ways.count[g] > 0:
                along_way(leads, scratch, g, setup.world.goal, walls)
            elif leadable and leads.led[g] > 0:
                headed = along_law(setup, leads, scratch, g, i, share, modes, headed)
            else:
                without_law(scratch, g, modes)
            add(leads, scratch, g, i)

    return aim
