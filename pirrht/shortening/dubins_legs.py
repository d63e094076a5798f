"""Legs of a Dubins path: the curves that shortcuts are made of; the last one leads into the goal's disc."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.geometry.arcs import TWO_PI, along, entry_of_curve, truncate
from pirrht.geometry.field import Field
from pirrht.topology.cuts import Cuts
from pirrht.topology.turns import key_of_pairs, pairs_of_curve

SHORT = 1e-9  # pieces below this length [m] are rounding


class Task(NamedTuple):
    """What legs have to respect; plain values, so that kernels can take it."""

    field: Field
    cuts: Cuts
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker
    goal: Array  # (2,) goal point [m]
    reach: float  # radius of the goal's disc [m]
    radius: float  # least turning radius [m]


@kernel
def approach(task, start, side, curvature, length):  # type: ignore[no-untyped-def]
    """Write the leg (3,) into the disc that turns to `side` and then heads for the goal point; its length.

    It meets the disc at right angles, as the shortest way into a disc with free heading does. Where the goal
    point is too close for that, the leg is an arc, and infinitely long if the arc misses the disc.
    """
    x, y, theta, radius = start[0], start[1], start[2], task.radius
    vx = task.goal[0] - x + side * radius * math.sin(theta)
    vy = task.goal[1] - y - side * radius * math.cos(theta)
    square = vx * vx + vy * vy - radius * radius
    curvature[0], curvature[1], curvature[2] = side / radius, 0.0, 0.0
    length[0], length[1], length[2] = TWO_PI * radius, 0.0, 0.0
    if square > 0.0:
        length[1] = math.sqrt(square)
        turn = side * (math.atan2(vy, vx) - theta) + math.atan2(radius, length[1])
        length[0] = radius * (turn - TWO_PI * math.floor(turn / TWO_PI + 1e-12))
    s = entry_of_curve(start, curvature, length, task.goal[0], task.goal[1], task.reach)
    truncate(length, s, length)
    return s


@kernel
def key_of_leg(task, start, curvature, length, last, x, y):  # type: ignore[no-untyped-def]
    """Additive key of the whole turns of a leg to (x, y); the last leg goes on straight to the goal point.

    Paths with common ends are homologous exactly when the keys of their legs have the same sum.
    """
    room = length.shape[0] * task.weights.shape[0]
    marker, turn = np.empty(room, np.int32), np.empty(room, np.int16)
    count = pairs_of_curve(task.cuts, start, curvature, length, last, x, y, marker, turn, 0)
    return key_of_pairs(marker, turn, 0, count, task.weights)


@kernel
def append(pose, curvature, length, count, start, kappas, ells):  # type: ignore[no-untyped-def]
    """Append a leg to a list of pieces, of which neighbours that turn alike become one; number of pieces."""
    x, y, theta = start[0], start[1], start[2]
    for p in range(ells.shape[0]):
        if ells[p] < SHORT:
            continue
        if count > 0 and abs(curvature[count - 1] - kappas[p]) < SHORT:
            length[count - 1] += ells[p]
        else:
            pose[count, 0], pose[count, 1], pose[count, 2] = x, y, theta
            curvature[count], length[count] = kappas[p], ells[p]
            count += 1
        x, y, theta = along(x, y, theta, kappas[p], ells[p])
    return count
