"""Whom flat walls at constant speed leave alive of the Brownian paths of one step.

Between its ends a step is a Brownian bridge; it misses a wall from which its ends have clearances d and d', each at its
own time, with probability 1 - exp(-2 d d' / (b^2 dt)), since its motion relative to the wall is a bridge again. Solids
that stand in one direction as seen from a path's beginning are one wall, whose clearance is that of the nearest; those
in another direction are another, with a factor of its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pirrht.compiled.jit import inlined, kernel
from pirrht.exact.domain import Frame
from pirrht.geometry.bodies import Bodies, clearance_and_slope
from pirrht.geometry.walls import stands_apart

WALLS = 4  # directions of walls that are told apart, as seen from one place


class Room(NamedTuple):
    """What a path moves in, apart from where bodies are."""

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
    """Whether (x, y) [m] is on the border or beyond it."""
    return x <= room.left or x >= room.right or y <= room.low or y >= room.high


@inlined
def log_sum(a, b):  # type: ignore[no-untyped-def]
    """log(exp(a) + exp(b))."""
    high, low = max(a, b), min(a, b)
    return high if low == -math.inf else high + math.log1p(math.exp(low - high))
