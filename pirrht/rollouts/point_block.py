"""Advance a block of paths of a point around one reference in lockstep, stage by stage (`point_stages`).

Exits and close walls, which are rare, are done lane by lane; paths that have ended leave the block. Paths are those of
`rollouts.path` up to rounding: the same numbers are drawn in the same order.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import antithetic, stream
from pirrht.rollouts.first_exit import INSIDE, at_crossing, bridge_exit

from pirrht.rollouts.point_stages import (  # isort: skip
    C0, C1, DT, E0, FLAG, G0, E1, G1, KEY, LANES, LOG_SURVIVAL, LOST, NX, NY, PUSH0, PUSH1, ROOT, SAMPLE, SIGN, SLOW,
    SPENT, STEP, SUM0, SUM1, TUBE, WIDE, Z0, Z1, L, X, Y, add_log_ratios, advance, bridge, cross, draw, fit_steps,
    judge, lane, move, relax, row_of, scratch_of, single, single_matrix, survey, tape_control, tube_control, wall_push,
)  # fmt: skip
from pirrht.rollouts.tables import Origin, empty_paths, tube_of
from pirrht.rollouts.tuning import TUNING


class Run(NamedTuple):
    """Samples of one block, all around one reference."""

    h: int  # the reference
    start: int  # numbers of the samples, or places in `chosen`
    stop: int
    chosen: NDArray[np.int64]  # numbers of samples; empty: all of them are meant
    base: tuple[float, float] = (0.0, 0.0)  # the proposal control at the start without the nearest wall


RUN: Any = Run


@kernel
def resolve(setup, weighed, k, random, f):  # type: ignore[no-untyped-def]
    """Judge the step of a lane that may have ended on its way: outcome and share of the step."""
    arena, B = setup.world, setup.diffusion
    x, y, nx, ny = np.float64(f[X + k]), np.float64(f[Y + k]), np.float64(f[NX + k]), np.float64(f[NY + k])
    before = np.float64(f[C0 + k]), np.float64(f[E0 + k]), np.float64(f[G0 + k])
    after = np.float64(f[C1 + k]), np.float64(f[E1 + k]), np.float64(f[G1 + k])
    variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    step = variance * np.float64(f[DT + k])
    state, outcome, share, lasting = bridge_exit(
        arena, (x, y, nx, ny), before, after, (step, 0.0, step), weighed, random[k]
    )
    f[LOG_SURVIVAL + k] += np.float32(lasting)
    random[k] = state
    if outcome != INSIDE:
        # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
        deviation = math.sqrt(step)
        _, dx, dy = at_crossing(arena, (x, y), (nx - x, ny - y), outcome, share, deviation, state)
        f[Z0 + k] = (B[0, 0] * dx + B[1, 0] * dy) / variance
        f[Z1 + k] = (B[0, 1] * dx + B[1, 1] * dy) / variance
        f[NX + k], f[NY + k] = x + dx, y + dy
    return outcome, share


@inlined
def likelihood(h, H, until, k, f, a, ratio, out):  # type: ignore[no-untyped-def]
    """Write log dQ_g/dP of a path whose last step took a time `until` to out (H,)."""
    y0, y1 = np.float64(f[Z0 + k]), np.float64(f[Z1 + k])
    own = np.float64(ratio[row_of(h, 1) + k]) + np.float64(f[LOST + k])
    for g in range(H):  # the others are kept as what they are more
        row = row_of(g, 2)
        a0, a1 = np.float64(a[row + k]), np.float64(a[row + L + k])
        more = 0.0 if g == h else np.float64(ratio[row_of(g, 1) + k])
        out[g] = own + more + a0 * (y0 - 0.5 * a0 * until) + a1 * (y1 - 0.5 * a1 * until)


@inlined
def retire(setup, tables, run, outcome, share, k, scratch, paths):  # type: ignore[no-untyped-def]
    """Write to `paths` that the path of lane k ends, after a share of the lane's own step."""
    times, window, inverse, base, h = tables.times, tables.window, setup.inverse, run.base, run.h
    f, a, ratio, short, long, _, _ = scratch
    k = lane(k)
    i, s, until = np.int64(short[STEP + k]), long[SAMPLE + k], np.float64(f[DT + k]) * share  # no dQ/dP after crossings
    n0, n1, span = np.float64(f[SUM0 + k]), np.float64(f[SUM1 + k]), times[min(i, window)]
    if i < window:
        own = row_of(h, 2) + k
        n0, n1 = n0 + f[Z0 + k] - a[own] * until, n1 + f[Z1 + k] - a[own + L] * until
        span += np.float64(f[SPENT + k]) + until
    likelihood(h, tables.drift.shape[0], until, k, f, a, ratio, paths.log_ratio[s])
    paths.work[s], paths.key[s] = setup.rate * (times[i] + np.float64(f[SPENT + k]) + until), long[KEY + k]
    paths.outcome[s], paths.steps[s], paths.span[s], paths.log_survival[s] = outcome, i + 1, span, f[LOG_SURVIVAL + k]
    for j in range(2):
        paths.now[s, j] = inverse[j, 0] * n0 + inverse[j, 1] * n1 + span * base[j]
        paths.start_control[s, j] = base[j]


@inlined
def compact(k, last, H, scratch):  # type: ignore[no-untyped-def]
    """Move the last lane to where lane k has left."""
    f, a, ratio, short, long, random, _ = scratch
    k, last = lane(k), lane(last)
    for row in range(X, TUBE, L):
        f[row + k] = f[row + last]
    for row in range(0, short.shape[0], L):
        short[row + k] = short[row + last]
    random[k], long[KEY + k], long[SAMPLE + k] = random[last], long[KEY + last], long[SAMPLE + last]
    for g in range(H if k < last else 0):
        one, two = row_of(g, 1), row_of(g, 2)
        ratio[one + k], a[two + k], a[two + L + k] = ratio[one + last], a[two + last], a[two + L + last]


@inlined
def record(into, k, first, scratch):  # type: ignore[no-untyped-def]
    """Write where a step leads, and add its noise y = a dt + dw, to the row of `into` for its step of the grid."""
    f, _, _, short, long, _, _ = scratch
    out = into[long[SAMPLE + k] - first, short[STEP + k]]
    out[0], out[1] = f[NX + k], f[NY + k]
    out[2] += f[Z0 + k]
    out[3] += f[Z1 + k]


@inlined
def end_flagged(setup, tables, run, n, into, scratch, paths):  # type: ignore[no-untyped-def]
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
                    record(into, k, run.start, scratch)
                retire(setup, tables, run, outcome, share, k, scratch, paths)
                n -= 1
                compact(k, n, tables.drift.shape[0], scratch)
    return n


@inlined
def end_late(setup, tables, run, n, scratch, paths):  # type: ignore[no-untyped-def]
    """End the paths that are under way after the last step; return how many of n lanes go on."""
    f, _, _, short, _, _, _ = scratch
    times, T = tables.times, tables.times.shape[0] - 1
    for k in range(n - 1, -1, -1):
        if short[STEP + k] >= T:
            f[Z0 + k], f[Z1 + k], f[DT + k], f[SPENT + k] = 0.0, 0.0, 0.0, times[T] - times[T - 1]
            short[STEP + k] = T - 1
            retire(setup, tables, run, INSIDE, 1.0, k, scratch, paths)
            n -= 1
            compact(k, n, tables.drift.shape[0], scratch)
    return n


@inlined
def begin(tables, origin, run, scratch):  # type: ignore[no-untyped-def]
    """Set all lanes to the start of their paths."""
    f, _, ratio, short, long, random, _ = scratch
    h, start, chosen, x = run.h, run.start, run.chosen, origin.x
    f[:], short[:], long[:], ratio[:] = 0.0, 0, 0, 0.0
    f[X:Y], f[Y:Z0], f[NX:NY], f[NY:C0], f[DT:ROOT] = x[0], x[1], x[0], x[1], 1.0
    for k in range(run.stop - start):
        number = chosen[start + k] if chosen.shape[0] > 0 else start + k
        first, f[SIGN + k] = antithetic(number, tables.first[h], tables.mirrored)
        random[k], long[SAMPLE + k] = stream(origin.seed, first), start + k


@inlined
def write_controls(setup, tables, around, B, h, scratch, n):  # type: ignore[no-untyped-def]
    """Write the control of every reference, in noise units, and wall drift; arena and B: `single`."""
    f, a, _, short, _, _, _ = scratch
    ways, active, drift = tables.ways, tables.active, tables.drift.ctypes.data
    H, T, _ = tables.drift.shape
    if tables.wall_offset > 0.0:
        wall_push(around.field, tables.wall_offset, tables.set_back, B, f, short, n)
    for one in range(H):
        g = h if one == 0 else (one - 1 if one <= h else one)  # a_h first
        if ways.count[g] > 0:
            tube_control(tube_of(ways, g), ways.decay, around.goal, g, h, B, scratch, n)
        else:
            tape_control(drift, g, T, active[g], f, short, a, n)


@kernel
def block(setup, tables, origin, run, paths, into, scratch):  # type: ignore[no-untyped-def]
    """Simulate the samples of one run, at most LANES; write steps to `into` (stop - start, T, 4) if any."""
    f, a, ratio, short, long, random, bits = scratch
    h, start, stop, chosen, _ = run
    (H, T, _), n, B, inverse = tables.drift.shape, stop - start, single_matrix(setup.diffusion), setup.inverse
    around, follows, wide = single(setup.world), tables.wall_offset > 0.0, setup.diffusion
    variance, rim = wide[0, 0] * wide[0, 0] + wide[0, 1] * wide[0, 1], TUNING.rim * setup.world.radius
    begin(tables, origin, run, scratch)
    survey(around, f, short, LANES)
    for k in range(C1 - C0):  # a copy between slices would compile for two seconds
        f[C0 + k] = f[C1 + k]
    begun = False
    while n > 0:
        full = min((n + WIDE - 1) // WIDE * WIDE, LANES)  # in bounds the compiler sees
        fit_steps(tables.times, tables.least, 1.0 / (9.0 * variance), rim, f, short, full)
        write_controls(setup, tables, around, B, h, scratch, full)
        if not begun:
            bare0, bare1 = a[2 * h * L] - f[PUSH0], a[2 * h * L + L] - f[PUSH1]
            base = inverse[0, 0] * bare0 + inverse[0, 1] * bare1, inverse[1, 0] * bare0 + inverse[1, 1] * bare1
            run, begun = RUN(h, start, stop, chosen, base), True
        relax(h, f, a, full)
        draw(random, bits, f, full)
        move(h, B, f, a, full)
        cross(setup.cuts, f, long, full)
        survey(around, f, short, full)
        if setup.bridge:
            flagged = bridge(variance, tables.weighed, random, f, short, full)
        else:
            flagged = judge(around, f, short, full)
        if flagged > 0:
            n = end_flagged(setup, tables, run, n, into, scratch, paths)
        for k in range(n if into.shape[0] > 0 else 0):
            record(into, k, start, scratch)
        add_log_ratios(h, H, f, a, ratio, full)
        if advance(h, tables.window, follows, f, short, a, full) >= T:
            n = end_late(setup, tables, run, n, scratch, paths)


@kernel
def blocks(setup, tables, origin, start, stop, paths, scratch):  # type: ignore[no-untyped-def]
    """Fill `paths` for a range of samples, block by block."""
    everything, nowhere = np.empty(0, np.int64), np.empty((0, 0, 4), np.float32)
    h, s = 0, start
    while s < stop:
        while s >= tables.first[h + 1]:
            h += 1
        end = min(min(stop, tables.first[h + 1]), s + LANES)
        block(setup, tables, origin, RUN(h, s, end, everything, (0.0, 0.0)), paths, nowhere, scratch)
        s = end


def sample(setup: Any, tables: Any, origin: Origin, start: int, stop: int, paths: Any) -> None:
    """Fill `paths` for a range of samples."""
    blocks(setup, tables, origin, start, stop, paths, scratch_of(len(tables.control)))


def replay(
    setup: Any, tables: Any, origin: Origin, number: IntArray, states: Array, applied: Array, steps: IntArray
) -> None:
    """Write states (c, T+1, 2), controls carried (c, T, 2) and steps (c,) of samples of some numbers (c,)."""
    H, T, m = tables.control.shape
    order, states[:, 0], inverse = np.argsort(number, kind="stable"), origin.x, setup.inverse
    listed = np.ascontiguousarray(number[order])
    edges = np.searchsorted(listed, tables.first)
    scratch, taken, paths = scratch_of(H), np.zeros((LANES, T, 4), np.float32), empty_paths(len(listed), H, m)
    for h, (first, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        for start in range(first, end, LANES):
            stop, taken[:] = min(start + LANES, end), 0.0
            block(setup, tables, origin, Run(h, start, stop, listed), paths, taken, scratch)
            places = order[start:stop]
            steps[places] = paths.steps[start:stop]
            own = np.where((np.arange(T) < steps[places, None])[:, :, None], taken[: stop - start], 0.0)
            controls = own[:, :, 2:3] * inverse[:, 0] + own[:, :, 3:] * inverse[:, 1]
            states[places, 1:], applied[places] = own[:, :, :2], controls / np.diff(tables.times)[:, None]
