"""Account for moving obstacles in a step: how near they are, how they end it, and the weight of its survival.

Only near ones are candidates (`broad_phase`), each posed when the step begins; it keeps its velocity until its motion
next changes. Relative to a flat wall at constant speed a noisy path is a Brownian bridge, which misses that wall with
probability 1 - exp(-2 c d / variance), c and d being the clearances when the step begins and ends.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.geometry.world import with_wall
from pirrht.jit.jit import inlined
from pirrht.jit.streams import FAR, MIN_VARIANCE, SIDEWAYS, first_crossing, normals, survival, uniform
from pirrht.moving.broad_phase import listing, surely
from pirrht.moving.distances import (
    FASTEST,
    JUMPING,
    clearance_facing,
    clearance_of_body,
    disc_of,
    of_body,
    outside_of,
    piece_of,
    wall_facing,
    walls_of_some,
)
from pirrht.moving.tuning import NEAR_WIDTH, TUNING

NEVER = 2.0  # share of a step at which nothing is met
D, NX, NY, WX, WY, OX, OY, YAW, VX, VY, TURN, SINCE, UNTIL, COS, SIN, FACED, WALL_KNOWN = range(NEAR_WIDTH)


@inlined
def look_anew(near):  # type: ignore[no-untyped-def]
    """Forget all about moving obstacles (J, NEAR_WIDTH) for another path."""
    for j in range(near.shape[0]):
        near[j, UNTIL] = -math.inf


@inlined
def look_around(moving, candidates, count, x, y, t, within, near):  # type: ignore[no-untyped-def]
    """Write candidates at t [s], seen from (x, y) [m], to `near` (J, NEAR_WIDTH); walls of those `within` alone.

    Returns: least clearance of these [m], and until when all of them keep their velocities [s].
    """
    least, until = moving.cutoff, math.inf
    for k in range(count):
        j = candidates[k]
        _see(moving, j, t, near)
        near[j, D] = outside_of(moving, j, near[j, OX], near[j, OY], x, y)
        near[j, WALL_KNOWN] = 0.0
        if near[j, D] < within:
            _know(moving, j, x, y, near)
            least, until = min(least, near[j, D]), min(until, near[j, UNTIL])
    return least, until


@inlined
def _see(moving, j, t, near):  # type: ignore[no-untyped-def]
    """Write where body j is at t [s]; on from where it was, while it keeps its velocity."""
    past = t - near[j, SINCE]
    if past >= 0.0 and t < near[j, UNTIL]:
        near[j, OX] += past * near[j, VX]
        near[j, OY] += past * near[j, VY]
        near[j, YAW] += past * near[j, TURN]
    else:
        ox, oy, yaw, vx, vy, turn, ends = piece_of(moving, j, t)
        near[j, OX], near[j, OY], near[j, YAW] = ox, oy, yaw
        near[j, VX], near[j, VY], near[j, TURN], near[j, UNTIL] = vx, vy, turn, ends
        near[j, FACED] = math.inf
    near[j, SINCE] = t


@inlined
def _know(moving, j, x, y, near):  # type: ignore[no-untyped-def]
    """Complete what is known of body j as seen from (x, y) [m]."""
    ox, oy, yaw = near[j, OX], near[j, OY], near[j, YAW]
    if near[j, FACED] != yaw:
        near[j, COS], near[j, SIN], near[j, FACED] = math.cos(yaw), math.sin(yaw), yaw
    d, nx, ny, ex, ey = wall_facing(moving, j, ox, oy, near[j, COS], near[j, SIN], x, y)
    near[j, D], near[j, NX], near[j, NY], near[j, WALL_KNOWN] = d, nx, ny, 1.0
    near[j, WX], near[j, WY] = near[j, VX] - near[j, TURN] * (y - ey - oy), near[j, VY] + near[j, TURN] * (x - ex - ox)


@inlined
def with_moving(walls, near, candidates, count, widest):  # type: ignore[no-untyped-def]
    """Return the two nearest walls (`two_walls`), static or moving, in single precision; none nearer than `widest`."""
    c, nx, ny, d, mx, my = walls
    for k in range(count):
        j = candidates[k]
        if near[j, WALL_KNOWN] == 1.0:
            two = c, nx, ny, d, mx, my
            c, nx, ny, d, mx, my = with_wall(two, near[j, D], near[j, NX], near[j, NY], np.float64(widest))
    return c, nx, ny, d, mx, my


@inlined
def walls_along(moving, x, y, t, within, lists, count, near):  # type: ignore[no-untyped-def]
    """Write `moving_walls` at one place and time after another; return the numbers of candidates and of walls.

    `lists` (`held_of`, candidates) and `count` are what the last call has left.
    """
    held, candidates = lists
    if surely(held, moving.speed, x, y, t) < within:
        count = listing(moving, x, y, t, within + TUNING.skin, held, candidates)
    return count, walls_of_some(moving, candidates, count, x, y, t, within, near)


@inlined
def _towards(near, j, cov):  # type: ignore[no-untyped-def]
    """Return the variance of a step towards obstacle j."""
    if cov[1] == 0.0 and cov[0] == cov[2]:
        return cov[0]
    nx, ny = near[j, NX], near[j, NY]
    return max(cov[0] * nx * nx + 2.0 * cov[1] * nx * ny + cov[2] * ny * ny, MIN_VARIANCE)


@inlined
def facing_among(near, candidates, count, cov):  # type: ignore[no-untyped-def]
    """Return the least clearance [m] over the share of noise that each faces, where noise acts along a line."""
    size, nearest = cov[0] + cov[2], math.inf
    for k in range(count):
        j = candidates[k]
        if near[j, WALL_KNOWN] == 1.0:
            share = _towards(near, j, cov) / size
            nearest = min(nearest, near[j, D] / math.sqrt(max(share, SIDEWAYS)))
    return nearest


@inlined
def met_on_bridge(moving, candidates, count, near, way, dt, cov, rule, state):  # type: ignore[no-untyped-def]
    """Find which candidate a noisy step (x, y, mx, my) [m] that takes dt [s] meets and when.

    Args: as of `bridge_exit`; `near` is that of `look_around` at the beginning of the step; `rule`: whether noise acts
        along a line, and whether survival is weighed.
    Returns: next state of the random sequence, share of the step until then or NEVER, number of the body, and log
        probability that none is met, where that is weighed [nats].
    """
    (x, y, mx, my), (line, weighed) = way, rule
    least = FAR * (cov[0] + cov[2] if line else max(cov[0], cov[2]))
    length = math.sqrt((mx - x) * (mx - x) + (my - y) * (my - y))
    alive, worst, which, from_, to, spread = 1.0, 2.0, np.int64(0), 0.0, 0.0, 0.0
    for k in range(count):
        j = candidates[k]
        c = near[j, D]
        d = c - length - of_body(moving, j, FASTEST) * dt
        if d > 0.0 and 2.0 * c * d >= least:
            continue
        px, py = near[j, OX] + dt * near[j, VX], near[j, OY] + dt * near[j, VY]
        length_seen = math.sqrt((mx - x - px + near[j, OX]) ** 2 + (my - y - py + near[j, OY]) ** 2)
        length_seen += abs(near[j, TURN]) * dt * disc_of(moving, j)
        d = outside_of(moving, j, px, py, mx, my)
        if c > 0.0 and d > 0.0 and 2.0 * c * d >= least and c + d > length_seen:
            continue
        if near[j, WALL_KNOWN] == 0.0:
            _know(moving, j, x, y, near)
            c = near[j, D]
        cos, sin = near[j, COS], near[j, SIN]
        if near[j, TURN] != 0.0:
            yaw = near[j, YAW] + dt * near[j, TURN]
            cos, sin = math.cos(yaw), math.sin(yaw)
        d = clearance_facing(moving, j, px, py, cos, sin, mx, my)
        if c > 0.0 and d > 0.0 and c + d <= length_seen:
            d = _behind_body(moving, j, near, way, dt, c, d, length_seen)
        variance = _towards(near, j, cov)
        survives = survival(c, d, variance) if c > 0.0 else 0.0
        alive *= survives
        if survives < worst:
            worst, which, from_, to, spread = survives, j, c, d, variance
    if alive >= 1.0:
        return state, NEVER, which, 0.0
    if weighed and alive > 0.0:
        return state, NEVER, which, math.log(alive)
    state, u = uniform(state)
    if u < alive:
        return state, NEVER, which, 0.0
    state, share = first_crossing(max(from_, MIN_VARIANCE), to, math.sqrt(spread), state)
    return state, share, which, 0.0


@inlined
def _behind_body(moving, j, near, way, dt, c, d, length):  # type: ignore[no-untyped-def]
    """Return clearance d of a step's end; negative if its chord meets the obstacle, as if it ended inside of that."""
    (x, y, mx, my), share = way, c / length
    while share < 1.0 - d / length:
        then = share * dt
        e = clearance_of_body(
            moving, j, near[j, OX] + then * near[j, VX], near[j, OY] + then * near[j, VY],
            near[j, YAW] + then * near[j, TURN], x + share * (mx - x), y + share * (my - y),
        )  # fmt: skip
        if e <= 0.0:
            return c * (1.0 - 1.0 / share)
        share += max(e, TUNING.sweep_step * moving.robot) / length
    return d


@inlined
def at_moving_wall(near, j, moved, drift, dt, share, deviation, state):  # type: ignore[no-untyped-def]
    """Displace an isotropic bridge to where it first meets body j, at its distance then; across it is drawn.

    Args, after j: displacement at the end of the step (2) [m], drift (2) [m/s], step [s], share of it until then,
        standard deviation of the whole step [m], and state of the random sequence; returns the next one, and
        displacement [m].
    """
    (dx, dy), (fx, fy), nx, ny = moved, drift, -near[j, NX], -near[j, NY]
    gap = max(near[j, D], 0.0) + share * dt * ((near[j, WX] - fx) * nx + (near[j, WY] - fy) * ny)
    state, z, _ = normals(state)
    along = share * (dy * nx - dx * ny) + deviation * math.sqrt(share * (1.0 - share)) * z
    return state, gap * nx - along * ny, gap * ny + along * nx


@inlined
def met_on_path(moving, candidates, count, step, t, dt, stop):  # type: ignore[no-untyped-def]
    """Return the share of a step (x, y, mx, my, turn) [m, rad] at which a candidate is met, or NEVER.

    It has no position noise, begins at t and takes dt [s]; a share `stop` is judged. A turning step [rad] is an arc.
    Clearances certify parts of the step, since path and bodies come nearer no faster than by their speeds.
    """
    x, y, mx, my, turn = step
    length = math.sqrt((mx - x) ** 2 + (my - y) ** 2)
    bow, rate, share = 0.5 * turn * length, length * math.sqrt(1.0 + 0.25 * turn * turn), 0.0
    while True:
        aside = bow * share * (1.0 - share)
        px, py = x + share * (mx - x), y + share * (my - y)
        if length > 0.0:
            px, py = px + aside * (my - y) / length, py - aside * (mx - x) / length
        ahead = stop - share
        for k in range(count):
            j = candidates[k]
            ox, oy, yaw, _, _, _, ends = piece_of(moving, j, t + share * dt)
            speed = rate + of_body(moving, j, FASTEST) * dt
            c = outside_of(moving, j, ox, oy, px, py)
            if c <= speed * ahead:
                c = clearance_of_body(moving, j, ox, oy, yaw, px, py)
            if c <= 0.0:
                return share
            ahead = min(ahead, max(c, TUNING.sweep_step * moving.robot) / max(speed, MIN_VARIANCE))
            if of_body(moving, j, JUMPING) > 0.0:
                ahead = min(ahead, max((ends - t) / dt - share, 0.0) + 1e-9)
        if share >= stop:
            return NEVER
        share = min(stop, share + ahead)
