"""Advance a block of paths of a point around one reference in lockstep, stage by stage (`stages`, `exits`).

Exits and close walls, which are rare, are done lane by lane; paths that have ended leave the block. Paths are those of
`rollouts.general` up to rounding: the same numbers are drawn in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.streams import antithetic, stream
from pirrht.rollouts.first_exit import INSIDE, at_crossing, bridge_exit
from pirrht.rollouts.point.exits import SLOW, bridge, judge, single, survey, wall_push

from pirrht.rollouts.point.stages import (  # isort: skip
    C0, C1, CELL, CORNER, DT, E0, E1, FLAG, G0, G1, KEY, LANES, LASTING, LEFT, LOST, NX, NY, OWED, PUSH0, PUSH1, ROOT,
    SAMPLE, SIGN, SPENT, STAGE, STEP, SUM0, SUM1, WIDE, Z0, Z1, L, U, V, X, Y, add_log_ratios, advance, cross, draw,
    move, pace, row_of, scratch_of, settle, tape_control, way_control,
)  # fmt: skip
from pirrht.rollouts.tables import Chosen, Origin, empty_paths
from pirrht.rollouts.tuning import TUNING
from pirrht.systems.dynamics import Dynamics, no_drift

RECORDED = 7  # of a step: where it leads, its noise y = a dt + dw, the guide a, its time until an exit


class Run(NamedTuple):
    """Samples of one block, all around one reference."""

    h: int  # the reference
    start: int  # numbers of the samples, or places in `chosen`
    stop: int
    chosen: NDArray[np.int64]  # numbers of samples; empty: all of them are meant


RUN: Any = Run


def is_point(d: Dynamics) -> bool:
    """Tell whether the dynamics are those of a point, with isotropic constant noise and no drift."""
    if not (d.n == d.m == 2 and d.drift is no_drift and d.constant):
        return False
    B = d.B_c(np.zeros(2))
    cov = B @ B.T
    return bool(cov[0, 1] == 0.0 and cov[0, 0] == cov[1, 1])


@kernel
def resolve(arena, B, weighed, k, random, f):  # type: ignore[no-untyped-def]
    """Judge the step of a lane that may have ended on its way: outcome and share of the step."""
    x, y, nx, ny = np.float64(f[X + k]), np.float64(f[Y + k]), np.float64(f[NX + k]), np.float64(f[NY + k])
    before = np.float64(f[C0 + k]), np.float64(f[E0 + k]), np.float64(f[G0 + k])
    after = np.float64(f[C1 + k]), np.float64(f[E1 + k]), np.float64(f[G1 + k])
    variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    step = variance * np.float64(f[DT + k])
    state, outcome, share, lasting = bridge_exit(
        arena, (x, y, nx, ny), before, after, (step, 0.0, step), weighed, random[k]
    )
    f[LASTING + k] += np.float32(lasting)
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
def lane(k):  # type: ignore[no-untyped-def]
    """Return a lane's number, in bounds the compiler sees (`row_of`)."""
    return min(max(k, 0), LANES)


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


class Common(NamedTuple):
    """Numbers that the paths of a block share."""

    arena: Any  # static obstacles and the goal's disc
    B: Array  # (2, 2) B_c
    weighed: bool  # `ProposalTables.weighed`
    leaning: bool  # whether walls push
    start: int  # number of the first sample
    rate: float  # q [cost/s]
    times: Array  # (T+1,) ends of the steps [s]
    window: int  # leading steps over which the control now is averaged
    inverse: Array  # (2, 2) G_c^-1 B_c
    H: int  # number of references
    h: int  # the one that is followed
    base: tuple[float, float]  # the proposal control at the start without the nearest wall


COMMON: Any = Common


@inlined
def retire(common, i, share, outcome, k, scratch, paths):  # type: ignore[no-untyped-def]
    """Note down in `paths` that the path of lane k ends: step of the grid, share of the lane's own step, outcome."""
    rate, times, window, inverse = common.rate, common.times, common.window, common.inverse
    H, h, base = common.H, common.h, common.base
    f, a, ratio, _, long, _, _ = scratch
    work, log_ratio, key, ended, steps, now, spans, led, lasting = paths
    k = lane(k)
    s, until = long[SAMPLE + k], np.float64(f[DT + k]) * share  # at a crossing nothing after it enters dQ/dP
    n0, n1, span = np.float64(f[SUM0 + k]), np.float64(f[SUM1 + k]), times[min(i, window)]
    if i < window:
        own = row_of(h, 2) + k
        n0, n1 = n0 + f[Z0 + k] - a[own] * until, n1 + f[Z1 + k] - a[own + L] * until
        span += np.float64(f[SPENT + k]) + until
    likelihood(h, H, until, k, f, a, ratio, log_ratio[s])
    work[s], key[s] = rate * (times[i] + np.float64(f[SPENT + k]) + until), long[KEY + k]
    ended[s], steps[s], spans[s], lasting[s] = outcome, i + 1, span, f[LASTING + k]
    now[s, 0] = inverse[0, 0] * n0 + inverse[0, 1] * n1 + span * base[0]
    now[s, 1] = inverse[1, 0] * n0 + inverse[1, 1] * n1 + span * base[1]
    led[s, 0], led[s, 1] = base


@inlined
def compact(k, last, H, leaning, scratch):  # type: ignore[no-untyped-def]
    """Move the last lane to where lane k has left; what walls need only if samples are `leaning` away from them."""
    f, a, ratio, short, long, random, _ = scratch
    k, last = lane(k), lane(last)
    f[Z0 + k], f[Z1 + k], f[NX + k], f[NY + k] = f[Z0 + last], f[Z1 + last], f[NX + last], f[NY + last]
    f[C1 + k], f[E1 + k], f[G1 + k] = f[C1 + last], f[E1 + last], f[G1 + last]
    f[SUM0 + k], f[SUM1 + k], f[SIGN + k], f[LOST + k] = f[SUM0 + last], f[SUM1 + last], f[SIGN + last], f[LOST + last]
    f[X + k], f[Y + k], f[C0 + k], f[E0 + k] = f[X + last], f[Y + last], f[C0 + last], f[E0 + last]
    f[G0 + k], f[DT + k], f[LEFT + k] = f[G0 + last], f[DT + last], f[LEFT + last]
    f[SPENT + k], f[LASTING + k] = f[SPENT + last], f[LASTING + last]
    short[STEP + k], f[OWED + k] = short[STEP + last], f[OWED + last]
    if leaning:
        f[U + k], f[V + k], short[CELL + k] = f[U + last], f[V + last], short[CELL + last]
        for corner in range(4):
            f[CORNER + corner * L + k] = f[CORNER + corner * L + last]
    random[k], long[KEY + k], long[SAMPLE + k] = random[last], long[KEY + last], long[SAMPLE + last]
    for g in range(H if k < last else 0):
        one, two = row_of(g, 1), row_of(g, 2)
        short[STAGE + one + k], ratio[one + k] = short[STAGE + one + last], ratio[one + last]
        a[two + k], a[two + L + k] = a[two + last], a[two + L + last]


@inlined
def record(into, h, share, k, first, scratch):  # type: ignore[no-untyped-def]
    """Add a share of a lane's own step to the row of `into` for the step of the grid that it is part of."""
    f, a, _, short, long, _, _ = scratch
    out = into[long[SAMPLE + k] - first, short[STEP + k]]
    until = f[DT + k] * np.float32(share)
    out[0], out[1] = f[NX + k], f[NY + k]
    out[2] += f[Z0 + k]
    out[3] += f[Z1 + k]
    out[4] += a[2 * h * L + k] * until
    out[5] += a[2 * h * L + L + k] * until
    out[6] += until


@inlined
def end_flagged(common, n, full, into, scratch, paths):  # type: ignore[no-untyped-def]
    """End the paths of flagged lanes that leave within this step; return how many of n lanes go on."""
    f, _, _, short, _, random, _ = scratch
    for group in range(full - WIDE, -1, -WIDE):
        some = 0
        for k in range(group, group + WIDE):
            some += 1 if short[FLAG + k] != INSIDE else 0
        for k in range(min(group + WIDE, n) - 1 if some > 0 else -1, group - 1, -1):
            outcome, share = short[FLAG + k], 1.0
            if outcome == SLOW:
                outcome, share = resolve(common.arena, common.B, common.weighed, k, random, f)
            if outcome != INSIDE:
                if into.shape[0] > 0:
                    record(into, common.h, share, k, common.start, scratch)
                retire(common, np.int64(short[STEP + k]), share, outcome, k, scratch, paths)
                n -= 1
                compact(k, n, common.H, common.leaning, scratch)
    return n


@inlined
def end_late(common, n, scratch, paths):  # type: ignore[no-untyped-def]
    """End the paths that are under way after the last step; return how many of n lanes go on."""
    f, _, _, short, _, _, _ = scratch
    times, T = common.times, common.times.shape[0] - 1
    for k in range(n - 1, -1, -1):
        if short[STEP + k] >= T:
            f[Z0 + k], f[Z1 + k], f[DT + k], f[SPENT + k] = 0.0, 0.0, 0.0, times[T] - times[T - 1]
            retire(common, T - 1, 1.0, INSIDE, k, scratch, paths)
            n -= 1
            compact(k, n, common.H, common.leaning, scratch)
    return n


@kernel
def block(setup, leads, origin, run, paths, into, scratch):  # type: ignore[no-untyped-def]
    """Simulate the samples of one run, at most LANES; write steps to `into` (stop - start, T, RECORDED) if any."""
    h, start, stop, chosen = run
    x0 = origin.x
    f, a, ratio, short, long, random, bits = scratch
    cuts, B, around = setup.cuts, setup.diffusion, single(setup.world)
    inverse, times, drift, weighed = setup.inverse, leads.times, leads.drift.ctypes.data, leads.weighed
    active, count, window, goal = leads.active, leads.ways.count, leads.window, around.goal
    place, slope, decay = leads.ways.place.ctypes.data, leads.ways.slope.ctypes.data, leads.ways.decay
    C, J = leads.ways.slope.shape[1], leads.ways.slope.shape[2]
    reach, least, keep, listed = leads.reach, leads.least, into.shape[0] > 0, chosen.shape[0] > 0
    H, T, n = leads.drift.shape[0], leads.drift.shape[1], stop - start
    variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    scale, rim = 1.0 / (9.0 * variance), TUNING.rim * setup.world.radius
    f[:], short[:], long[:], ratio[:], base, begun = 0.0, 0, 0, 0.0, (0.0, 0.0), False
    f[X:Y], f[Y:Z0], f[NX:NY], f[NY:C0], f[DT:ROOT] = x0[0], x0[1], x0[0], x0[1], 1.0
    for k in range(n):
        first, f[SIGN + k] = antithetic(chosen[start + k] if listed else start + k, leads.first[h], leads.mirrored)
        random[k], long[SAMPLE + k] = stream(origin.seed, first), start + k
    survey(around, f, short, LANES)
    for k in range(C1 - C0):  # a copy between slices would compile for two seconds
        f[C0 + k] = f[C1 + k]
    while n > 0:
        full = (n + WIDE - 1) // WIDE * WIDE
        pace(times, least, scale, rim, f, short, full)
        if reach > 0.0:
            wall_push(around.field, reach, leads.beyond, math.sqrt(variance), B, f, short, full)
        for one in range(H):
            g = h if one == 0 else (one - 1 if one <= h else one)  # a_h first
            if count[g] > 0:
                way_control((place, slope, C, J, count[g] - 1, decay), g, h, goal, B, f, short, a, ratio, full)
            else:
                tape_control(drift, g, T, active[g], f, short, a, full)
        if not begun:
            bare0, bare1 = a[2 * h * L] - f[PUSH0], a[2 * h * L + L] - f[PUSH1]
            base = inverse[0, 0] * bare0 + inverse[0, 1] * bare1, inverse[1, 0] * bare0 + inverse[1, 1] * bare1
            begun = True
        settle(h, f, a, full)
        draw(random, bits, f, full)
        move(h, B, f, a, full)
        cross(cuts, f, long, full)
        survey(around, f, short, full)
        flagged = bridge(variance, weighed, random, f, short, full) if setup.bridge else judge(around, f, short, full)
        common = COMMON(setup.world, B, weighed, reach > 0.0, start, setup.rate, times, window, inverse, H, h, base)
        if flagged > 0:
            n = end_flagged(common, n, full, into, scratch, paths)
        for k in range(n if keep else 0):
            record(into, h, 1.0, k, start, scratch)
        add_log_ratios(h, H, f, a, ratio, full)
        most = advance(h, window, reach > 0.0, f, short, a, full)
        if most >= T:
            n = end_late(common, n, scratch, paths)


@kernel
def blocks(setup, leads, origin, start, stop, paths, scratch):  # type: ignore[no-untyped-def]
    """Fill `paths` for a range of samples, block by block."""
    all_of_them, nowhere = np.empty(0, np.int64), np.empty((0, 0, RECORDED), np.float32)
    h, s = 0, start
    while s < stop:
        while s >= leads.first[h + 1]:
            h += 1
        end = min(min(stop, leads.first[h + 1]), s + LANES)
        block(setup, leads, origin, RUN(h, s, end, all_of_them), paths, nowhere, scratch)
        s = end


def sample(setup: Any, leads: Any, origin: Origin, start: int, stop: int, paths: Any) -> None:
    """Fill `paths` for a range of samples."""
    blocks(setup, leads, origin, start, stop, paths, scratch_of(len(leads.control)))


def control(setup: Any, leads: Any, origin: Origin, chosen: Chosen, total: Array, alive: Array) -> None:
    """Add weight times control carried to total[group] (G, T, m), and weight to alive[group] (G, T)."""
    for _, places, steps, taken in _recorded(setup, leads, origin, chosen.number):
        _carried(leads.times, setup.inverse, taken, steps, chosen.group[places], chosen.weight[places], total, alive)


def trace(
    setup: Any, leads: Any, origin: Origin, number: NDArray[np.int64], states: Array, out: NDArray[np.int64]
) -> None:
    """Write states (c, T+1, 2) and number of steps (c,) of chosen samples."""
    states[:, 0] = origin.x
    for _, places, steps, taken in _recorded(setup, leads, origin, number):
        out[places] = steps
        under_way = np.arange(taken.shape[1]) < steps[:, None]
        states[places, 1:] = np.where(under_way[:, :, None], taken[:, :, :2], 0.0)


def _recorded(
    setup: Any, leads: Any, origin: Origin, chosen: NDArray[np.int64]
) -> Iterator[tuple[int, NDArray[np.int64], NDArray[np.int32], NDArray[np.float32]]]:
    """Yield reference, places in `chosen`, numbers of steps and steps (., T, RECORDED), block by block."""
    H, T, m = leads.control.shape
    order = np.argsort(chosen, kind="stable")
    listed = np.ascontiguousarray(chosen[order])
    edges = np.searchsorted(listed, leads.first)
    scratch, taken = scratch_of(H), np.zeros((LANES, T, RECORDED), np.float32)
    paths = empty_paths(len(listed), H, m)
    for h, (first, end) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        for start in range(first, end, LANES):
            stop = min(start + LANES, end)
            taken[:] = 0.0
            block(setup, leads, origin, Run(h, start, stop, listed), paths, taken, scratch)
            yield h, order[start:stop], paths.steps[start:stop], taken[: stop - start]


@kernel
def _carried(times, inverse, taken, steps, group, weight, total, alive):  # type: ignore[no-untyped-def]
    """Add the controls of recorded steps (c, T, RECORDED), as `control` says."""
    for c in range(steps.shape[0]):
        g, w = group[c], weight[c]
        for i in range(steps[c]):
            dt, y0, y1 = times[i + 1] - times[i], taken[c, i, 2], taken[c, i, 3]
            alive[g, i] += w
            for j in range(2):
                total[g, i, j] += w * (inverse[j, 0] * y0 + inverse[j, 1] * y1) / dt
