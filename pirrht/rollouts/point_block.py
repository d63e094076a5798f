"""Advance a block of paths of a point around one reference in lockstep, stage by stage (`point_stages`).

Exits and close walls, which are rare, are done lane by lane; paths that have ended leave the block. Paths are those of
`rollouts.path` up to rounding: the same numbers are drawn in the same order.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.disc import bridge as bridge_exit
from pirrht.geometry.disc import towards_exit
from pirrht.geometry.space import GOAL, INSIDE
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import antithetic, stream
from pirrht.rollouts.first_exit import at_crossing

from pirrht.rollouts.point_stages import (  # isort: skip
    BEGAN, C0, C1, DT, E0, EXPOSURE, FLAG, G0, E1, G1, KEY, LANES, LOG_SURVIVAL, LOST, NX, NY, PUSH0, PUSH1, ROOT,
    SAMPLE, SIGN, SLOW, SPENT, STEP, SUM0, SUM1, TUBE, WIDE, Z0, Z1, L, X, Y, add_log_ratios, advance, bridge,
    draw, expose, fit_steps, judge, lane, move, relax, row_of, scratch_of, single, single_matrix, survey,
    tape_control, tube_control, wall_push,
)  # fmt: skip
from pirrht.rollouts.tables import Kernels, Origin, empty_paths, tube_of
from pirrht.rollouts.tuning import TUNING
from pirrht.topology.signature import NO_CLASSES, SignatureKernels


@kernel
def resolve(setup, weighed, k, random, f):  # type: ignore[no-untyped-def]
    """Judge the step of a lane that may have ended on its way: outcome and share of the step."""
    arena, B = setup.world, setup.diffusion

    x = np.float64(f[X + k])
    y = np.float64(f[Y + k])
    nx = np.float64(f[NX + k])
    ny = np.float64(f[NY + k])

    before = np.float64(f[C0 + k]), np.float64(f[E0 + k]), np.float64(f[G0 + k])
    after = np.float64(f[C1 + k]), np.float64(f[E1 + k]), np.float64(f[G1 + k])
    variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    step = variance * np.float64(f[DT + k])
    state, outcome, share, lasting = bridge_exit(
        arena, (x, y), (nx, ny), before, after, (step, 0.0, step), weighed, random[k]
    )
    f[LOG_SURVIVAL + k] += np.float32(lasting)
    random[k] = state
    if outcome != INSIDE:
        # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
        met = towards_exit(arena, (x, y), outcome)
        _, dx, dy = at_crossing(
            met, arena.radius if outcome == GOAL else 0.0, (nx - x, ny - y), share, math.sqrt(step), state
        )
        f[Z0 + k] = (B[0, 0] * dx + B[1, 0] * dy) / variance
        f[Z1 + k] = (B[0, 1] * dx + B[1, 1] * dy) / variance
        f[NX + k] = x + dx
        f[NY + k] = y + dy
    return outcome, share


@inlined
def retire(setup, tables, h, outcome, share, k, scratch, paths):  # type: ignore[no-untyped-def]
    """Write to `paths` that the path of lane k ends, after a share of the lane's own step."""
    times, window, inverse = tables.times, tables.window, setup.inverse
    f, a, ratio, short, long, _, _ = scratch
    k = lane(k)

    i = np.int64(short[STEP + k])
    s = long[SAMPLE + k]
    until = np.float64(f[DT + k]) * share  # no dQ/dP after crossings

    n0 = np.float64(f[SUM0 + k])
    n1 = np.float64(f[SUM1 + k])
    span = times[min(i, window)]

    if i < window:
        own = row_of(h, 2) + k
        n0 = n0 + f[Z0 + k] - a[own] * until
        n1 = n1 + f[Z1 + k] - a[own + L] * until
        span += np.float64(f[SPENT + k]) + until

    y0 = np.float64(f[Z0 + k])
    y1 = np.float64(f[Z1 + k])
    total = np.float64(ratio[row_of(h, 1) + k]) + f[LOST + k]

    for g in range(tables.drift.shape[0]):  # the others are kept as what they are more
        a0 = np.float64(a[row_of(g, 2) + k])
        a1 = np.float64(a[row_of(g, 2) + L + k])
        more = 0.0 if g == h else np.float64(ratio[row_of(g, 1) + k])
        paths.log_ratio[s, g] = total + more + a0 * (y0 - 0.5 * a0 * until) + a1 * (y1 - 0.5 * a1 * until)
    paths.work[s] = setup.rate * (times[i] + np.float64(f[SPENT + k]) + until)
    paths.key[s] = long[KEY + k]

    paths.outcome[s] = outcome
    paths.steps[s] = i + 1
    paths.span[s] = span
    paths.log_survival[s] = f[LOG_SURVIVAL + k]

    paths.exposure[s] = f[EXPOSURE + k]
    for j in range(2):
        paths.now[s, j] = inverse[j, 0] * n0 + inverse[j, 1] * n1 + span * paths.start_control[s, j]


@inlined
def compact(k, last, H, scratch):  # type: ignore[no-untyped-def]
    """Move the last lane to where lane k has left."""
    f, a, ratio, short, long, random, _ = scratch
    k = lane(k)
    last = lane(last)

    for row in range(X, TUBE, L):
        f[row + k] = f[row + last]
    for row in range(0, short.shape[0], L):
        short[row + k] = short[row + last]

    random[k] = random[last]
    long[KEY + k] = long[KEY + last]
    long[SAMPLE + k] = long[SAMPLE + last]

    for g in range(H if k < last else 0):
        one = row_of(g, 1)
        two = row_of(g, 2)

        ratio[one + k] = ratio[one + last]
        a[two + k] = a[two + last]
        a[two + L + k] = a[two + L + last]


@inlined
def record(into, k, scratch):  # type: ignore[no-untyped-def]
    """Write where a step leads, and add its noise y = a dt + dw, to the row of `into` for its step of the grid."""
    f, _, _, short, long, _, _ = scratch
    out = into[long[SAMPLE + k], short[STEP + k]]
    out[0] = f[NX + k]
    out[1] = f[NY + k]
    out[2] += f[Z0 + k]
    out[3] += f[Z1 + k]


@inlined
def end_flagged(setup, tables, h, n, into, scratch, paths):  # type: ignore[no-untyped-def]
    """End the paths of flagged lanes that leave within this step; return how many of n lanes go on."""
    f, _, _, short, _, random, _ = scratch
    for group in range((n - 1) // WIDE * WIDE, -1, -WIDE):
        some = 0
        for k in range(group, group + WIDE):
            some += 1 if short[FLAG + k] != INSIDE else 0
        for k in range(min(group + WIDE, n) - 1 if some > 0 else -1, group - 1, -1):
            outcome, share = short[FLAG + k], 1.0
            if outcome == SLOW:
                outcome, share = resolve(setup, tables.weighed, k, random, f)
            if outcome != INSIDE:
                if into.shape[0] > 0:
                    record(into, k, scratch)
                retire(setup, tables, h, outcome, share, k, scratch, paths)
                n -= 1
                compact(k, n, tables.drift.shape[0], scratch)
    return n


@inlined
def end_late(setup, tables, h, n, scratch, paths):  # type: ignore[no-untyped-def]
    """End the paths that are under way after the last step; return how many of n lanes go on."""
    f, _, _, short, _, _, _ = scratch
    times, T = tables.times, tables.times.shape[0] - 1
    for k in range(n - 1, -1, -1):
        if short[STEP + k] >= T:
            f[Z0 + k] = 0.0
            f[Z1 + k] = 0.0
            f[DT + k] = 0.0
            f[SPENT + k] = times[T] - times[T - 1]

            short[STEP + k] = T - 1
            retire(setup, tables, h, INSIDE, 1.0, k, scratch, paths)
            n -= 1
            compact(k, n, tables.drift.shape[0], scratch)
    return n


@inlined
def begin(tables, origin, h, start, number, scratch):  # type: ignore[no-untyped-def]
    """Set all lanes to the start of their paths."""
    f, _, ratio, short, long, random, _ = scratch
    x = origin.x

    f[:] = 0.0
    short[:] = 0
    long[:] = 0
    ratio[:] = 0.0

    f[X:Y] = x[0]
    f[Y:Z0] = x[1]
    f[NX:NY] = x[0]
    f[NY:C0] = x[1]
    f[DT:ROOT] = 1.0

    for k in range(number.shape[0]):
        first, f[SIGN + k] = antithetic(number[k], tables.first[h], tables.mirrored)
        random[k] = stream(origin.seed, first)
        long[SAMPLE + k] = start + k


@inlined
def write_controls(setup, tables, around, B, h, scratch, n):  # type: ignore[no-untyped-def]
    """Write the control of every reference, in noise units, and wall drift; arena and B: `single`."""
    f, a, _, short, _, _, _ = scratch
    ways, active, drift = tables.ways, tables.active, tables.drift.ctypes.data
    H, T, _ = tables.drift.shape
    if tables.wall_offset > 0.0:
        wall_push(around.static, tables.wall_offset, tables.set_back, B, f, short, n)
    for one in range(H):
        g = h if one == 0 else (one - 1 if one <= h else one)  # a_h first
        if ways.count[g] > 0:
            tube_control(tube_of(ways, g), ways.decay, around.goal, g, h, B, scratch, n)
        else:
            tape_control(drift, g, T, active[g], f, short, a, n)


@inlined
def lead(setup, h, paths, f, a, rows):  # type: ignore[no-untyped-def]
    """Write the proposal control at the start, without wall drift, of samples in some rows of `paths`."""
    mine, inverse = 2 * h * L, setup.inverse
    a0 = a[mine] - f[PUSH0]
    a1 = a[mine + L] - f[PUSH1]

    for s in range(*rows):
        for j in range(2):
            paths.start_control[s, j] = inverse[j, 0] * a0 + inverse[j, 1] * a1


@cache
def blocks_for(classes: SignatureKernels | None) -> Kernels:
    """Build the rollouts of points, by kernels of the signature of paths; None: their keys are 0."""
    add_keys = (classes or NO_CLASSES).keys

    @kernel
    def block(setup, around, tables, origin, h, rows, number, paths, into, scratch):  # type: ignore[no-untyped-def]
        """Simulate samples of some numbers, at most LANES, around reference h to rows of `paths` and any of `into`."""
        f, a, ratio, short, long, random, bits = scratch

        H, T, _ = tables.drift.shape
        n = number.shape[0]
        B = single_matrix(setup.diffusion)

        follows, wide = tables.wall_offset > 0.0, setup.diffusion
        variance = wide[0, 0] * wide[0, 0] + wide[0, 1] * wide[0, 1]
        rim = TUNING.rim * setup.world.radius
        begin(tables, origin, h, rows[0], number, scratch)
        survey(around, f, short, LANES)
        for k in range(C1 - C0):  # a copy between slices would compile for two seconds
            f[C0 + k] = f[C1 + k]
        for k in range(LANES):
            f[BEGAN + k] = min(f[C1 + k], f[E1 + k])
        begun = False
        while n > 0:
            full = min((n + WIDE - 1) // WIDE * WIDE, LANES)  # in bounds the compiler sees
            fit_steps(tables.times, tables.least, 1.0 / (9.0 * variance), rim, f, short, full)
            write_controls(setup, tables, around, B, h, scratch, full)
            if not begun:
                lead(setup, h, paths, f, a, rows)
                begun = True
            relax(h, f, a, full)
            draw(random, bits, f, full)
            move(h, B, f, a, full)
            add_keys(tables.classes, f, (X, Y, NX, NY), full, long, KEY)
            survey(around, f, short, full)
            if (
                bridge(variance, tables.weighed, f, short, full) if setup.bridge else judge(around, f, short, full)
            ) > 0:
                n = end_flagged(setup, tables, h, n, into, scratch, paths)
            for k in range(n if into.shape[0] > 0 else 0):
                record(into, k, scratch)
            add_log_ratios(h, H, f, a, ratio, full)
            if advance(h, tables.window, follows, f, short, a, full) >= T:
                n = end_late(setup, tables, h, n, scratch, paths)
            expose(variance, f, short, full)

    @kernel
    def blocks(setup, around, tables, origin, number, start, stop, paths, into, scratch):  # type: ignore[no-untyped-def]
        """Simulate samples of the numbers from `start` to `stop`, which ascend, block by block."""
        h, s = 0, start
        while s < stop:
            while number[s] >= tables.first[h + 1]:
                h += 1
            end = s
            while end < min(stop, s + LANES) and number[end] < tables.first[h + 1]:
                end += 1
            block(setup, around, tables, origin, h, (s, end), number[s:end], paths, into, scratch)
            s = end

    def sample(setup: Any, tables: Any, origin: Origin, start: int, stop: int, paths: Any) -> None:
        """Fill `paths` for a range of samples."""
        nowhere = np.empty((0, 0, 4), np.float32)
        scratch = scratch_of(len(tables.control))
        blocks(setup, single(setup.world), tables, origin, np.arange(stop), start, stop, paths, nowhere, scratch)

    def replay(
        setup: Any, tables: Any, origin: Origin, number: IntArray, states: Array, applied: Array, steps: IntArray
    ) -> None:
        """Write states (c, T+1, 2), controls carried (c, T, 2) and steps (c,) of samples of some numbers (c,)."""
        H, T, m = tables.control.shape
        c = len(number)
        order = np.argsort(number, kind="stable")

        into = np.zeros((c, T, 4), np.float32)
        paths = empty_paths(c, H, m)
        blocks(setup, single(setup.world), tables, origin, number[order], 0, c, paths, into, scratch_of(H))
        states[:, 0], states[order, 1:], steps[order] = origin.x, into[:, :, :2], paths.steps
        applied[order] = into[:, :, 2:] @ setup.inverse.T / np.diff(tables.times)[:, None]

    return Kernels(sample, replay, TUNING.alone_points)
