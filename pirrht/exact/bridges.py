"""What flat walls at constant speed do to a Brownian path of one step: whom it survives, and what it is paid at them.

Between its ends a step is a Brownian bridge; it misses a wall from which its ends have clearances d and d', each at its
own time, with probability 1 - exp(-2 d d' / (b^2 dt)), since its motion relative to the wall is a bridge again. Solids
that stand in one direction as seen from a path's beginning are one wall, whose clearance is that of the nearest; those
in another direction are another, with a factor of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pirrht.compiled.jit import inlined, kernel
from pirrht.exact.bodies import clearance_and_slope, clearance_from
from pirrht.geometry.walls import stands_apart

WALLS = 4  # directions of walls that are told apart, as seen from one place
MOST = 1 + WALLS + 4  # boundaries at one place: the goal's rim, walls, and the sides of the border

LEVER = 0.2  # of second differences, as a share of the robot's radius


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
    """Sort the solids within reach of (x, y) into walls, nearest first; how many walls, -1 if (x, y) is in a solid.

    Args:
        bodies, pose: as of `clearance_from`.
        near: indices of solids that come into question, (l,).
        x, y: robot centre [m].
        reach: of walls that count [m].
        wall: (l,) filled with the wall that each solid belongs to, -1 beyond reach.
        which: (WALLS,) filled with the nearest solid of each wall.
        clear: (WALLS,) filled with their clearances [m].
        slope: (WALLS, 4) filled with the vectors from them and the gradients of their clearances.
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


@kernel
def roundness(bodies, k, pose, x, y, d, gx, gy):  # type: ignore[no-untyped-def]
    """Laplacian [1/m] of the clearance from solid k half-way from (x, y) to it, by differences.

    Args:
        bodies, k, pose, x, y: as of `clearance_from`.
        d, gx, gy: clearance [m] and its gradient at (x, y).
    """
    x, y, e = x - 0.5 * d * gx, y - 0.5 * d * gy, LEVER * bodies.radius
    total = clearance_from(bodies, k, pose, x - e, y) + clearance_from(bodies, k, pose, x + e, y)
    total += clearance_from(bodies, k, pose, x, y - e) + clearance_from(bodies, k, pose, x, y + e)
    return max((total - 4.0 * clearance_from(bodies, k, pose, x, y)) / (e * e), 0.0)


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
def paid(d, speed, rate, step):  # type: ignore[no-untyped-def]
    """E[exp(-rate tau); tau < dt] of the time tau at which a Brownian path meets a wall.

    Args:
        d: clearance [m].
        speed: at which it grows [m/s].
        rate: [1/s].
        step: of `Step`.
    """
    b2 = step.b * step.b
    drift = speed / b2
    root = math.sqrt(drift * drift + 2.0 * rate / b2)
    width = step.deviation * math.sqrt(2.0)
    ahead = b2 * root * step.dt
    first = math.exp(-d * (drift + root)) * math.erfc((d - ahead) / width)
    return 0.5 * (first + math.exp(d * (root - drift)) * math.erfc((d + ahead) / width))


@kernel
def entered(n, clear, speed, step):  # type: ignore[no-untyped-def]
    """What a path is paid on the way: discounted shares that end at boundary 0, the goal, and at the n - 1 others.

    Of two boundaries that a path would meet it meets either first.

    Args:
        n: number of boundaries.
        clear: (n,) clearances [m].
        speed: (n,) at which these grow [m/s].
        step: of `Step`.
    """
    goal, others = 0.0, 0.0
    for g in range(1 if step.wall == math.inf else n):
        if clear[g] >= step.reach:
            continue
        beside = 1.0
        for h in range(n):
            if h != g and clear[h] < step.reach:
                beside *= 1.0 - 0.5 * min(paid(clear[h], speed[h], 0.0, step), 1.0)
        share = paid(clear[g], speed[g], step.rate, step) * beside
        if g == 0:
            goal = share
        else:
            others += share
    return goal, others
