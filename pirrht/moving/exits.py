"""Account for moving obstacles along a path: which are near, how they end a step, and the weight of its survival.

Of J obstacles only the candidates are posed: a list serves as long as none of the others can have come near, by the
speeds of path and obstacles. A candidate keeps its velocity until its motion next changes. Relative to a flat wall at
constant speed a noisy path is a Brownian bridge, which misses that wall with probability 1 - exp(-2 c d / variance), c
and d being the clearances when the step begins and ends. Poses are tuples that end with the heading [rad], where there
is one that counts.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.polygon import variance_along
from pirrht.geometry.space import NEVER
from pirrht.jit.jit import borrowing, inlined, kernel, part
from pirrht.jit.streams import FAR, MIN_VARIANCE, first_crossing, survival, uniform
from pirrht.jit.vectors import copy_row
from pirrht.moving.distances import (
    clearance_facing,
    clock_of,
    disc_of,
    fastest_of,
    outside_of,
    piece_of,
    restart_of,
    wall_facing,
)
from pirrht.moving.tuning import LISTING, POSED, TUNING

REACH, X, Y, SEEN, AFTER, SERVES, COUNT = range(LISTING)
D, NX, NY, NTH, WX, WY, OX, OY, YAW, VX, VY, TURN, SINCE, UNTIL, COS, SIN, FACED, KNOWN = range(POSED)


class Watch(NamedTuple):
    """Notes on J moving obstacles along one path."""

    listing: (
        Array  # (LISTING,) distance [m], beyond which all others are, place [m] and time of it, and when it holds [s]
    )
    candidates: NDArray[np.int64]  # (J,) those that may be near, ascending
    near: Array  # (J, POSED) where they are


WATCH: Any = Watch


@inlined
def watch(moving):  # type: ignore[no-untyped-def]
    """Allocate the notes of a path."""
    notes = WATCH(np.empty(LISTING), np.empty(moving.J, np.int64), np.empty((moving.J, POSED)))
    begin(notes)
    return notes


@part
def begin(notes):  # type: ignore[no-untyped-def]
    """Forget all about moving obstacles: another path begins."""
    notes.listing[SERVES] = -math.inf
    for j in range(notes.near.shape[0]):
        notes.near[j, UNTIL] = -math.inf


@part
def _serves(moving, notes, x, y, t, within):  # type: ignore[no-untyped-def]
    """Check that the list has all obstacles `within` [m] of (x, y) [m] at t [s]."""
    known = notes.listing
    if not known[AFTER] <= t < known[SERVES]:
        return False
    away = math.sqrt((x - known[X]) * (x - known[X]) + (y - known[Y]) * (y - known[Y]))
    return known[REACH] - away - moving.speed * abs(t - known[SEEN]) >= within


@borrowing
def _list(moving, notes, x, y, t, within):  # type: ignore[no-untyped-def]
    """List the obstacles within a distance [m] of (x, y) [m] at t [s]."""
    count, after, until = 0, -math.inf, math.inf
    for j in range(moving.J):
        restart = restart_of(moving, j, t)
        until = min(until, restart)
        if restart < math.inf:
            after = max(after, restart - clock_of(moving, j)[1])
        ox, oy, _, _, _, _, _ = piece_of(moving, j, t)
        if outside_of(moving, j, ox, oy, x, y) < within:
            notes.candidates[count] = j
            count += 1
    notes.listing[:] = (within, x, y, t, after, until, float(count))


@part
def _see(moving, j, t, near):  # type: ignore[no-untyped-def]
    """Write where obstacle j is at t [s]; on from where it was, while it keeps its velocity."""
    past = t - near[j, SINCE]
    if past >= 0.0 and t < near[j, UNTIL]:
        near[j, OX] += past * near[j, VX]
        near[j, OY] += past * near[j, VY]
        near[j, YAW] += past * near[j, TURN]
    else:
        piece = piece_of(moving, j, t)
        near[j, OX:SINCE] = piece[:6]
        near[j, UNTIL] = piece[6]
        near[j, FACED] = math.inf
    near[j, SINCE] = t


@part
def _know(moving, j, pose, near):  # type: ignore[no-untyped-def]
    """Complete what is known of obstacle j as seen from a pose (x, y, heading)."""
    x, y, _ = pose
    ox, oy = near[j, OX], near[j, OY]
    yaw = near[j, YAW]

    if near[j, FACED] != yaw:
        near[j, COS] = math.cos(yaw)
        near[j, SIN] = math.sin(yaw)
        near[j, FACED] = yaw
    d, nx, ny, turn, ex, ey = wall_facing(moving, j, (ox, oy, near[j, COS], near[j, SIN]), pose)

    near[j, D] = d
    near[j, NX] = nx
    near[j, NY] = ny
    near[j, NTH] = turn
    near[j, KNOWN] = 1.0

    near[j, WX] = near[j, VX] - near[j, TURN] * (y - ey - oy)
    near[j, WY] = near[j, VY] + near[j, TURN] * (x - ex - ox)


@part
def _look(moving, notes, pose, t, within):  # type: ignore[no-untyped-def]
    """Pose the candidates at t [s] and measure those `within` [m]; return until when these keep velocities."""
    x, y, _ = pose
    near, until = notes.near, notes.listing[SERVES]
    for k in range(int(notes.listing[COUNT])):
        j = notes.candidates[k]
        _see(moving, j, t, near)
        near[j, D], near[j, KNOWN] = outside_of(moving, j, near[j, OX], near[j, OY], x, y), 0.0
        if near[j, D] < within:
            _know(moving, j, pose, near)
            until = min(until, near[j, UNTIL])
    return until


@part
def walls(moving, notes, pose, t, within, out):  # type: ignore[no-untyped-def]
    """Write walls nearer than `within` [m] to a pose at t [s] to rows of `out` (J, WALL); `MovingKernels.walls`."""
    x, y, th = pose[0], pose[1], pose[-1]
    if not _serves(moving, notes, x, y, t, within):
        _list(moving, notes, x, y, t, within + TUNING.skin)
    until, near, count = _look(moving, notes, (x, y, th), t, within), notes.near, 0
    for k in range(int(notes.listing[COUNT])):
        j = notes.candidates[k]
        if near[j, KNOWN] == 1.0 and near[j, D] < within:
            copy_row(near[j], out[count])
            count += 1
    return count, until


@kernel
def walls_at(moving, pose, t, within, out):  # type: ignore[no-untyped-def]
    """Write walls nearer than `within` [m] to a pose at t [s] to rows of `out` (J, WALL); return how many."""
    return walls(moving, watch(moving), pose, t, within, out)[0]


@part
def _towards(near, j, cov):  # type: ignore[no-untyped-def]
    """Return the variance of a step towards obstacle j."""
    if cov[1] == 0.0 and cov[0] == cov[3] and cov[5] == 0.0:
        return cov[0]
    return variance_along((near[j, NX], near[j, NY], near[j, NTH]), cov)


@part
def _passes(moving, j, near, here, there, dt, cov, square):  # type: ignore[no-untyped-def]
    """Return the probability that a noisy step misses obstacle j; 1 if twice both clearances' product is > `square`."""
    (x, y, th), (mx, my, mth), c = here, there, near[j, D]
    swing = moving.reach * abs(mth - th)
    length = math.sqrt((mx - x) * (mx - x) + (my - y) * (my - y)) + swing
    d = c - length - fastest_of(moving, j) * dt
    if d > 0.0 and 2.0 * c * d >= square:
        return 1.0, c, d, 0.0
    px = near[j, OX] + dt * near[j, VX]
    py = near[j, OY] + dt * near[j, VY]
    seen = math.sqrt((mx - x - px + near[j, OX]) ** 2 + (my - y - py + near[j, OY]) ** 2)
    seen += abs(near[j, TURN]) * dt * disc_of(moving, j) + swing
    d = outside_of(moving, j, px, py, mx, my)
    if c > 0.0 and d > 0.0 and 2.0 * c * d >= square and c + d > seen:
        return 1.0, c, d, 0.0
    if near[j, KNOWN] == 0.0:
        _know(moving, j, here, near)
        c = near[j, D]
    cos = near[j, COS]
    sin = near[j, SIN]

    if near[j, TURN] != 0.0:
        yaw = near[j, YAW] + dt * near[j, TURN]
        cos = math.cos(yaw)
        sin = math.sin(yaw)
    d = clearance_facing(moving, j, (px, py, cos, sin), there)
    if c > 0.0 and d > 0.0 and c + d <= seen:
        d = _behind(moving, j, near, here, there, dt, c, d, seen)
    variance = _towards(near, j, cov)
    return survival(c, d, variance) if c > 0.0 else 0.0, c, d, variance


@part
def _behind(moving, j, near, here, there, dt, c, d, length):  # type: ignore[no-untyped-def]
    """Return clearance d of a step's end; negative if its chord meets the obstacle, as if it ended inside of that."""
    (x, y, th), (mx, my, mth), share = here, there, c / length
    while share < 1.0 - d / length:
        then = share * dt
        yaw = near[j, YAW] + then * near[j, TURN]
        ox = near[j, OX] + then * near[j, VX]
        oy = near[j, OY] + then * near[j, VY]
        pose = x + share * (mx - x), y + share * (my - y), th + share * (mth - th)
        e = clearance_facing(moving, j, (ox, oy, math.cos(yaw), math.sin(yaw)), pose)
        if e <= 0.0:
            return c * (1.0 - 1.0 / share)
        share += max(e, TUNING.sweep_step * moving.robot) / length
    return d


@part
def met(alive, way, weighed, state):  # type: ignore[no-untyped-def]
    """Draw whether a step meets what it misses with a probability, and when: what `MovingKernels.bridge` returns.

    `way` are clearances before and after it [m] from what it misses least surely, and the variance towards that.
    """
    if alive >= 1.0:
        return state, NEVER, 0.0
    if weighed and alive > 0.0:
        return state, NEVER, math.log(alive)
    state, u = uniform(state)
    if u < alive:
        return state, NEVER, 0.0
    c, d, variance = way
    state, share = first_crossing(max(c, MIN_VARIANCE), d, math.sqrt(variance), state)
    return state, share, 0.0


@part
def bridge(moving, notes, step, t, dt, cov, rule, state, out):  # type: ignore[no-untyped-def]
    """Find which obstacle a noisy step meets and when: `MovingKernels.bridge`."""
    (before, after), (most, weighed) = step, rule
    here = before[0], before[1], before[-1]
    there = after[0], after[1], after[-1]
    x, y, th = here
    mx, my, mth = there
    square = FAR * most
    spread = math.sqrt(0.5 * square)
    length = math.sqrt((mx - x) * (mx - x) + (my - y) * (my - y)) + moving.reach * abs(mth - th)
    within = length + spread + moving.speed * dt
    if not _serves(moving, notes, x, y, t, within):
        _list(moving, notes, x, y, t, within + TUNING.skin)
        _look(moving, notes, here, t, spread)

    alive = 1.0
    worst = 2.0
    which = np.int64(0)
    from_ = 0.0
    to = 0.0
    variance = 0.0

    for k in range(int(notes.listing[COUNT])):
        survives, c, d, towards = _passes(moving, notes.candidates[k], notes.near, here, there, dt, cov, square)
        alive *= survives
        if survives < worst:
            worst = survives
            which = notes.candidates[k]
            from_ = c
            to = d
            variance = towards
    state, share, lasting = met(alive, (from_, to, variance), weighed, state)
    if share <= 1.0:
        copy_row(notes.near[which], out[0])
    return state, share, lasting


@borrowing
def sweep(moving, notes, step, t, dt, stop):  # type: ignore[no-untyped-def]
    """Find the share at which a step without position noise meets an obstacle, by certified parts: `MovingKernels`."""
    before, after, turn = step
    x, y, th = before[0], before[1], before[-1]
    mx, my, mth = after[0], after[1], after[-1]
    swing = moving.reach * abs(mth - th)
    length = math.sqrt((mx - x) ** 2 + (my - y) ** 2)
    within = length * (1.0 + abs(turn)) + swing + moving.speed * dt
    if not _serves(moving, notes, x, y, t, within) or t + dt > notes.listing[SERVES]:
        _list(moving, notes, x, y, t, within + TUNING.skin)
        if t + dt > notes.listing[SERVES]:  # one is suddenly elsewhere meanwhile
            _list(moving, notes, x, y, t, math.inf)

    bow = 0.5 * turn * length
    rate = length * math.sqrt(1.0 + 0.25 * turn * turn) + swing
    share = 0.0

    while True:
        aside = bow * share * (1.0 - share)
        px = x + share * (mx - x)
        py = y + share * (my - y)

        if length > 0.0:
            px = px + aside * (my - y) / length
            py = py - aside * (mx - x) / length
        ahead = stop - share
        now = t + share * dt

        for k in range(int(notes.listing[COUNT])):
            j = notes.candidates[k]
            ox, oy, yaw, _, _, _, _ = piece_of(moving, j, now)
            speed = rate + fastest_of(moving, j) * dt
            c = outside_of(moving, j, ox, oy, px, py)
            if c <= speed * ahead:
                pose = px, py, th + share * (mth - th)
                c = clearance_facing(moving, j, (ox, oy, math.cos(yaw), math.sin(yaw)), pose)
            if c <= 0.0:
                return share
            ahead = min(ahead, max(c, TUNING.sweep_step * moving.robot) / max(speed, MIN_VARIANCE))
            ahead = min(ahead, max((restart_of(moving, j, now) - t) / dt - share, 0.0) + 1e-9)
        if share >= stop:
            return NEVER
        share = min(stop, share + ahead)
