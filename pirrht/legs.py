"""Legs of a Dubins path: the curves that shortcuts are made of; the last one leads into the goal's disc."""

from __future__ import annotations

import math
from typing import NamedTuple

from pirrht.clearance import Field
from pirrht.curves import TWO_PI, along, cut, entry_of_curve, turns_of_chord, turns_of_piece
from pirrht.jit import kernel
from pirrht.scene import Array

SHORT = 1e-9  # pieces below this length [m] are rounding


class Task(NamedTuple):
    """What legs have to respect; plain values, so that kernels can take it."""

    field: Field
    markers: Array  # (M, 2) [m]
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
    cut(length, s, length)
    return s


@kernel
def add_turns(task, start, curvature, length, last, weight, out):  # type: ignore[no-untyped-def]
    """Add `weight` times a leg's H (M,) to out; the last leg goes on straight to the goal point."""
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        if length[p] > 0.0:
            for k in range(task.markers.shape[0]):
                mx, my = task.markers[k, 0], task.markers[k, 1]
                out[k] += weight * turns_of_piece(x, y, theta, curvature[p], length[p], mx, my)
            x, y, theta = along(x, y, theta, curvature[p], length[p])
    if last:
        for k in range(task.markers.shape[0]):
            mx, my = task.markers[k, 0], task.markers[k, 1]
            out[k] += weight * turns_of_chord(x - mx, y - my, task.goal[0] - mx, task.goal[1] - my)


@kernel
def alike(one, other):  # type: ignore[no-untyped-def]
    """Whether signatures (M,) of paths with common ends are equal; they differ by whole turns."""
    same = True
    for k in range(one.shape[0]):
        same = same and abs(one[k] - other[k]) < 0.5
    return same


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
