"""Legs of a Dubins path: the curves that shortcuts are made of; the last one leads into the goal's disc."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.geometry.arcs import TWO_PI, along, entry_of_curve, truncate
from pirrht.topology.turns import key_of_pairs, pairs_of_curve

SHORT = 1e-9  # pieces below this length [m] are rounding


class Pieces(NamedTuple):
    """Pieces of a path in a row, with room for more: where each begins, and what of it."""

    pose: Array  # (k, 3) x, y [m], heading [rad]
    curvature: Array  # (k,) [1/m]; (k, 3) where three pieces make a leg
    length: Array  # (k,) or (k, 3) as well [m]


@kernel
def approach(around, start, side, curvature, length):  # type: ignore[no-untyped-def]
    """Write the leg from a pose (3,) into the disc that turns to `side`, then heads for the goal point; its length [m].

    It is written to `curvature` (3,) [1/m] and `length` (3,) [m]; `side` is 1 (left) or -1. It meets the disc at right
    angles, as the shortest way into a disc with free heading does. Where the goal point is too close for that, the leg
    is an arc, and infinitely long if the arc misses the disc.
    """
    x, y, theta, radius = start[0], start[1], start[2], around.radius
    vx = around.goal_x - x + side * radius * math.sin(theta)
    vy = around.goal_y - y - side * radius * math.cos(theta)
    square = vx * vx + vy * vy - radius * radius
    curvature[0], curvature[1], curvature[2] = side / radius, 0.0, 0.0
    length[0], length[1], length[2] = TWO_PI * radius, 0.0, 0.0
    if square > 0.0:
        length[1] = math.sqrt(square)
        turn = side * (math.atan2(vy, vx) - theta) + math.atan2(radius, length[1])
        length[0] = radius * (turn - TWO_PI * math.floor(turn / TWO_PI + 1e-12))
    s = entry_of_curve(start, curvature, length, around.goal_x, around.goal_y, around.reach)
    truncate(length, s, length)
    return s


@kernel
def key_of_leg(around, start, curvature, length, last, x, y):  # type: ignore[no-untyped-def]
    """Additive key of the whole turns of a leg from a pose (3,) to (x, y) [m]; the last goes on straight to the goal.

    The leg is `curvature` (P,) [1/m], `length` (P,) [m]. Paths with common ends are homologous exactly when the keys of
    their legs have the same sum.
    """
    most = length.shape[0] * around.weights.shape[0]
    marker, turn = np.empty(most, np.int32), np.empty(most, np.int16)
    count = pairs_of_curve(around.cuts, start, curvature, length, last, x, y, marker, turn, 0)
    return key_of_pairs(marker, turn, 0, count, around.weights)


@kernel
def append(pieces, count, start, curvature, length):  # type: ignore[no-untyped-def]
    """Append a leg from a pose (3,), `curvature` (P,) [1/m] and `length` (P,) [m], to `count` pieces; number of pieces.

    Neighbours that turn alike become one.
    """
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        if length[p] < SHORT:
            continue
        if count > 0 and abs(pieces.curvature[count - 1] - curvature[p]) < SHORT:
            pieces.length[count - 1] += length[p]
        else:
            pieces.pose[count, 0], pieces.pose[count, 1], pieces.pose[count, 2] = x, y, theta
            pieces.curvature[count], pieces.length[count] = curvature[p], length[p]
            count += 1
        x, y, theta = along(x, y, theta, curvature[p], length[p])
    return count
