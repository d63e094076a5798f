"""Account for flat walls at constant speed within one step of Brownian paths: survival, and payment of the others.

A step is a Brownian bridge between its ends, also relative to a moving wall; it misses one from which its ends have
clearances d and d', each at its own time, with probability 1 - exp(-2 d d' / (b^2 dt)). Solids in one direction from a
path's beginning are one wall, at the clearance of the nearest; each direction has a factor of its own.

Around a boundary that is alone psi is known: K_0(k rho)/K_0(k r) around the goal's disc, exp(-(m + n) d) at a flat wall
from which noise and its own speed carry a path away with a drift of m b^2, n^2 = m^2 + k^2. So a path that ends within
a step is paid what the sum over grid points is short of that, which includes the sum's error at the kink there. Of two
boundaries within reach a path meets either first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.exact.grid import Frame
from pirrht.geometry.walls import stands_apart
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.bodies import Bodies, clearance_and_slope, clearance_from

WALLS = 4  # directions of walls that are told apart, as seen from one place


class Room(NamedTuple):
    """Surroundings of a path without the poses of bodies."""

    frame: Frame  # of the grid, and the goal's disc
    left: float  # border of the workspace [m]
    low: float  # [m]
    right: float  # [m]
    high: float  # [m]
    bodies: Bodies


class Step(NamedTuple):
    """One step of the march, or a share of one."""

    dt: float  # [s]
    deviation: float  # b sqrt(dt) along each axis [m]
    b: float  # [m/sqrt(s)]
    rate: float  # q/lambda [nats/s]
    wall: float  # phi/lambda [nats]; may be infinite
    reach: float  # walls further away do not matter [m]


@kernel
def walls_around(bodies, near, pose, x, y, reach, wall, which, clear, slope):  # type: ignore[no-untyped-def]
    """Sort the solids within reach of (x, y) [m] into walls, nearest first; how many walls, -1 if (x, y) is in a solid.

    `near` (l,) are indices of solids to consider, `bodies` and `pose` those of `clearance_from`. Filled are `wall`
    (l,), the wall of each solid, -1 beyond `reach` [m]; of each wall `which` (WALLS,), its nearest solid, `clear`
    (WALLS,), its clearance [m], and `slope` (WALLS, 4), the vector from it and the gradient of its clearance.
    """
    n, count = near.shape[0], 0
    wall[:n] = -1
    while count < WALLS:
        best, at = reach, -1
        for k in range(n):
            if wall[k] >= 0:
                continue
            d, ex, ey, gx, gy = clearance_and_slope(bodies, near[k], pose, x, y)
            if d <= 0.0:
                return -1
            if d < best:
                best, at = d, k
                slope[count, 0], slope[count, 1], slope[count, 2], slope[count, 3] = ex, ey, gx, gy
        if at < 0:
            break
        clear[count], which[count] = best, near[at]
        for k in range(n):
            if wall[k] >= 0:
                continue
            d, ex, ey, _, _ = clearance_and_slope(bodies, near[k], pose, x, y)
            if k == at or (d < reach and not stands_apart(ex, ey, slope[count, 0], slope[count, 1])):
                wall[k] = count
        count += 1
    return count


@inlined
def missed(d, e, step):  # type: ignore[no-untyped-def]
    """Probability that a bridge misses a wall from which its ends are d and e [m]; 0 beyond it."""
    if d <= 0.0 or e <= 0.0:
        return 0.0
    z = 2.0 * d * e / (step.deviation * step.deviation)
    if z > 40.0:
        return 1.0
    return -math.expm1(-z) if z < 1e-3 else 1.0 - math.exp(-z)


@inlined
def outside(room, x, y):  # type: ignore[no-untyped-def]
    """Tell whether (x, y) [m] is on the border or beyond it."""
    return x <= room.left or x >= room.right or y <= room.low or y >= room.high


@inlined
def log_sum(a, b):  # type: ignore[no-untyped-def]
    """log(exp(a) + exp(b))."""
    high, low = max(a, b), min(a, b)
    return high if low == -math.inf else high + math.log1p(math.exp(low - high))


LEVER = 0.2  # of second differences, as a share of the robot's radius
MOST = 1 + WALLS + 4  # boundaries at one place: the goal's rim, walls, and the sides of the border
LEAST = 1e-6  # of psi around a boundary that is alone: less is not told from what a sum is off by
EULER = 0.5772156649015329


@kernel
def log_paid(room, near, begin, end, step, x, y, alone):  # type: ignore[no-untyped-def]
    """Logarithm of the payment to paths from (x, y) [m] that end within a step [nats]; -phi/lambda in walls.

    Args: `Room` and `Step`; `near` (l,), indices of solids to consider; `begin` and `end`, poses of all bodies, 2 x (1
        + J, 4), as of `frames_of`; `alone`, the payment at the goal if nothing else is near, negative where not known.
    """
    frame, count = room.frame, near.shape[0]
    wall, which = np.empty(count, dtype=np.int64), np.empty(WALLS, dtype=np.int64)
    clear, slope = np.empty(WALLS), np.empty((WALLS, 4))
    n = walls_around(room.bodies, near, begin, x, y, step.reach, wall, which, clear, slope)
    if n < 0 or outside(room, x, y):
        return -step.wall
    bound, speed = np.empty(MOST), np.zeros(MOST)
    bound[0] = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
    for g in range(n):
        then = math.inf
        for k in range(count):
            if wall[k] == g:
                then = min(then, clearance_from(room.bodies, near[k], end, x, y))
        bound[1 + g], speed[1 + g] = clear[g], (then - clear[g]) / step.dt
    bound[n + 1], bound[n + 2] = x - room.left, room.right - x
    bound[n + 3], bound[n + 4] = y - room.low, room.high - y
    b2, value = step.b * step.b, -math.inf
    for g in range(n + 5 if step.wall < math.inf else 1):
        if bound[g] >= step.reach:
            continue
        if g == 0:
            share, payoff = alone if alone >= 0.0 else _at_goal(frame, step, x, y, bound[0]), 0.0
        else:
            drift = speed[g] / b2
            if g <= n:
                drift += 0.5 * _roundness(room.bodies, which[g - 1], begin, x, y, clear[g - 1], slope[g - 1])
            share, payoff = _at_wall(room, near, wall, end, step, x, y, bound[g], drift, g, n), step.wall
        for h in range(n + 5):
            if h != g and bound[h] < step.reach:
                share *= 1.0 - 0.5 * _met(bound[h], speed[h], step)
        if share > 0.0:
            value = log_sum(value, math.log(share) - payoff)
    return value


@kernel
def at_goal(frame, step, out):  # type: ignore[no-untyped-def]
    """Fill `out` (nx, ny) with the payment at the goal to paths from points of the grid if nothing else is near."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            to_rim = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
            out[i, j] = _at_goal(frame, step, x, y, to_rim) if 0.0 < to_rim < step.reach else 0.0


@kernel
def _at_goal(frame, step, x, y, to_rim):  # type: ignore[no-untyped-def]
    """Payment at the goal's rim, which is `to_rim` from (x, y) [m], if nothing else is near."""
    k = math.sqrt(2.0 * step.rate) / step.b
    here, rim = _log_k0(k * (frame.radius + to_rim)), _log_k0(k * frame.radius)
    i0, i1, j0, j1 = _window(frame, step, x, y)
    total, half = 0.0, 0.5 / (step.deviation * step.deviation)
    for i in range(i0, i1):
        for j in range(j0, j1):
            px, py = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            rho = math.sqrt((px - frame.goal_x) ** 2 + (py - frame.goal_y) ** 2)
            if rho > frame.radius:
                weight = math.exp(_log_k0(k * rho) - here - half * ((px - x) ** 2 + (py - y) ** 2))
                total += weight * missed(to_rim, rho - frame.radius, step)
    return _short(total, frame, step) * math.exp(here - rim)


@kernel
def _at_wall(room, near, wall, end, step, x, y, d, drift, g, n):  # type: ignore[no-untyped-def]
    """Share of the payment at boundary g, a wall from 1 to n or a side of the border from n + 1 to n + 4.

    `d` is the clearance at the beginning [m], `drift` away from it over b^2 [1/m], `wall` that of `walls_around`.
    """
    frame = room.frame
    steep = drift + math.sqrt(drift * drift + 2.0 * step.rate / (step.b * step.b))
    i0, i1, j0, j1 = _window(frame, step, x, y)
    total, half = 0.0, 0.5 / (step.deviation * step.deviation)
    for i in range(i0, i1):
        for j in range(j0, j1):
            px, py = frame.x0 + i * frame.spacing, frame.y0 + j * frame.spacing
            e = math.inf
            if g <= n:
                for k in range(near.shape[0]):
                    if wall[k] == g - 1:
                        e = min(e, clearance_from(room.bodies, near[k], end, px, py))
            elif g <= n + 2:
                e = px - room.left if g == n + 1 else room.right - px
            else:
                e = py - room.low if g == n + 3 else room.high - py
            if e > 0.0:
                weight = math.exp(steep * (d - e) - half * ((px - x) ** 2 + (py - y) ** 2))
                total += weight * missed(d, e, step)
    return _short(total, frame, step) * math.exp(-steep * d)


@inlined
def _window(frame, step, x, y):  # type: ignore[no-untyped-def]
    """First and end indices of points within reach of (x, y) [m], those off the grid included."""
    fx, fy, wide = (x - frame.x0) / frame.spacing, (y - frame.y0) / frame.spacing, step.reach / frame.spacing
    return math.ceil(fx - wide), math.floor(fx + wide) + 1, math.ceil(fy - wide), math.floor(fy + wide) + 1


@inlined
def _short(total, frame, step):  # type: ignore[no-untyped-def]
    """Shortfall of a sum of weights from one."""
    scale = frame.spacing * frame.spacing / (2.0 * math.pi * step.deviation * step.deviation)
    short = 1.0 - scale * math.exp(-step.rate * step.dt) * total
    return short if short > LEAST else 0.0


@inlined
def _met(d, speed, step):  # type: ignore[no-untyped-def]
    """Probability that a path meets a wall d away [m] whose clearance grows at a speed [m/s]."""
    width = step.deviation * math.sqrt(2.0)
    drift, ahead = speed / (step.b * step.b), speed * step.dt
    first = math.erfc((d + ahead) / width)
    return min(0.5 * (first + math.exp(min(-2.0 * d * drift, 700.0)) * math.erfc((d - ahead) / width)), 1.0)


@kernel
def _roundness(bodies, k, pose, x, y, d, slope):  # type: ignore[no-untyped-def]
    """Laplacian [1/m] of the clearance from solid k half-way from (x, y) to it, by differences.

    `d` is the clearance at (x, y) [m], the last two of `slope` (4,) are its gradient there.
    """
    x, y, e = x - 0.5 * d * slope[2], y - 0.5 * d * slope[3], LEVER * bodies.radius
    total = clearance_from(bodies, k, pose, x - e, y) + clearance_from(bodies, k, pose, x + e, y)
    total += clearance_from(bodies, k, pose, x, y - e) + clearance_from(bodies, k, pose, x, y + e)
    return max((total - 4.0 * clearance_from(bodies, k, pose, x, y)) / (e * e), 0.0)


@kernel
def _log_k0(z):  # type: ignore[no-untyped-def]
    """log K_0(z), to 2e-7: a series, from 2 on the polynomial of Abramowitz and Stegun, 9.8.6."""
    if z < 2.0:
        t, term, harmonic = 0.25 * z * z, 1.0, 0.0
        i0, rest = 1.0, 0.0
        for n in range(1, 20):
            term *= t / (n * n)
            harmonic += 1.0 / n
            i0 += term
            rest += term * harmonic
        return math.log(rest - (math.log(0.5 * z) + EULER) * i0)
    t = 2.0 / z
    p = 0.00587872 + t * (-0.00251540 + t * 0.00053208)
    p = 1.25331414 + t * (-0.07832358 + t * (0.02189568 + t * (-0.01062446 + t * p)))
    return math.log(p) - z - 0.5 * math.log(z)
