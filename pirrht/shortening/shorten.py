"""Shorten a path inside its homology class by the method that suits its steering.

Polylines have their own: shortcuts between corners, and corners blunted where they touch."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import FREE, certify_segment, entry_of_piece
from pirrht.geometry.field import Field, clearance
from pirrht.jit.jit import borrowing, inlined, kernel
from pirrht.shortening import chain, in_time
from pirrht.shortening.tuning import POLYLINE as TUNING
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.in_time import InTime
from pirrht.steering.motion import ARCS, Surroundings
from pirrht.steering.steering import Steering
from pirrht.topology.crossings import Cuts, key_of_segment


class Planar(NamedTuple):
    """Static obstacles and goal of polylines: kernels count references of every array in a record that they pass on."""

    field: Field
    cuts: Cuts
    goal_x: float
    goal_y: float
    goal_radius: float


def taut_polyline(points: Array, around: Surroundings) -> Array:
    """Shorten a polyline (k, 2) [m] that ends in the goal's disc inside its class, (l, 2) [m]; never longer."""
    capacity = max(TUNING.capacity, TUNING.capacity_per_corner * len(points))
    out = np.empty((capacity + TUNING.loose_capacity, 2))
    planar = Planar(around.field, around.cuts, around.goal_x, around.goal_y, around.goal_radius)
    short = out[: _taut(planar, np.ascontiguousarray(points), capacity, out)].copy()
    return short if _length(short) <= _length(points) else points


def _length(points: Array) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@borrowing
def _contractible(around, points, i, j):  # type: ignore[no-untyped-def]
    """Tell whether the loop points[i..j] and straight back encircles no marker."""
    key = key_of_segment(around.cuts, points[j, 0], points[j, 1], points[i, 0], points[i, 1])
    for a in range(i, j):
        key += key_of_segment(around.cuts, points[a, 0], points[a, 1], points[a + 1, 0], points[a + 1, 1])
    return key == 0


@borrowing
def _entry(around, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Length of a segment, and where it enters the goal's disc; infinity if it does not."""
    length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    heading = math.atan2(by - ay, bx - ax)
    return length, entry_of_piece(ax, ay, heading, 0.0, length, around.goal_x, around.goal_y, around.goal_radius)


@borrowing
def _clear(around, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Tell whether the segment ab is certainly free up to where it enters the goal's disc."""
    length, s = _entry(around, ax, ay, bx, by)
    if s < length:
        bx, by = ax + (bx - ax) * s / length, ay + (by - ay) * s / length
    return certify_segment(around.field, ax, ay, bx, by, False) == FREE


@borrowing
def _replaceable(around, points, i, j):  # type: ignore[no-untyped-def]
    """Tell whether a free straight piece of one class leads from points[i] to points[j]."""
    free = _clear(around, points[i, 0], points[i, 1], points[j, 0], points[j, 1])
    return free and _contractible(around, points, i, j)


@borrowing
def _shortcut(around, points, count):  # type: ignore[no-untyped-def]
    """Leave out every run of corners that a free straight piece of one class can replace."""
    i = 0
    while i < count - 2:
        for j in range(count - 1, i + 1, -1):
            if _replaceable(around, points, i, j):
                for k in range(j, count):
                    points[i + 1 + k - j, 0] = points[k, 0]
                    points[i + 1 + k - j, 1] = points[k, 1]
                count -= j - i - 1
                break
        i += 1
    return count


@borrowing
def _blunted(around, corner):  # type: ignore[no-untyped-def]
    """Blunt a corner (before, corner, after), (3, 2), by most of both legs; rows 0 and 2 become the new piece."""
    x, y = corner[1, 0], corner[1, 1]
    ax, ay, bx, by = corner[0, 0] - x, corner[0, 1] - y, corner[2, 0] - x, corner[2, 1] - y
    low, high = 0.0, 1.0
    for _ in range(TUNING.halvings):
        t = 0.5 * (low + high)
        corner[0, 0], corner[0, 1] = x + t * ax, y + t * ay
        corner[2, 0], corner[2, 1] = x + t * bx, y + t * by
        if _replaceable(around, corner, 0, 2):
            low = t
        else:
            high = t
    corner[0, 0], corner[0, 1] = x + low * ax, y + low * ay
    corner[2, 0], corner[2, 1] = x + low * bx, y + low * by
    return low


@inlined
def _turn(corner):  # type: ignore[no-untyped-def]
    """Angle by which a path turns at a corner (before, corner, after), (3, 2) [rad]."""
    ax, ay = corner[1, 0] - corner[0, 0], corner[1, 1] - corner[0, 1]
    bx, by = corner[2, 0] - corner[1, 0], corner[2, 1] - corner[1, 1]
    return abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))


@inlined
def _touches(around, x, y):  # type: ignore[no-untyped-def]
    """Tell whether something keeps a corner at (x, y) [m] from being cut."""
    return clearance(around.field, x, y) <= TUNING.touching


@kernel
def _blunt_corners(around, points, count, least, capacity, out):  # type: ignore[no-untyped-def]
    """Blunt corners that turn more than `least` [rad], or touch nothing; number of points, fewer than `capacity`."""
    out[0, 0], out[0, 1] = points[0, 0], points[0, 1]
    n = 1
    corner = np.empty((3, 2))
    for i in range(1, count - 1):
        for c in range(2):
            corner[0, c], corner[1, c], corner[2, c] = out[n - 1, c], points[i, c], points[i + 1, c]
        t, turn = 0.0, _turn(corner)
        wanted = turn > least or (turn > TUNING.straight_turn and not _touches(around, points[i, 0], points[i, 1]))
        if wanted and n + 2 + count - i < capacity:
            t = _blunted(around, corner)
        if t > 0.0:
            for c in range(2):
                out[n, c], out[n + 1, c] = corner[0, c], corner[2, c]
            n += 2
        else:
            out[n, 0], out[n, 1] = points[i, 0], points[i, 1]
            n += 1
    out[n, 0], out[n, 1] = points[count - 1, 0], points[count - 1, 1]
    return n + 1


@borrowing
def _slide(around, points, i, to, leg):  # type: ignore[no-untyped-def]
    """Move corner i towards its neighbour `to` as long as the leg (3, 2) from or to its other neighbour stays free."""
    last = 2 if to > i else 0  # the leg leads forward, since it ends where it enters the goal's disc
    x, y = points[i, 0], points[i, 1]
    dx, dy = points[to, 0] - x, points[to, 1] - y
    for c in range(2):
        leg[2 - last, c], leg[1, c] = points[2 * i - to, c], points[i, c]
    low, high = 0.0, 1.0
    for _ in range(TUNING.slide_halvings):
        t = 0.5 * (low + high)
        leg[last, 0], leg[last, 1] = x + t * dx, y + t * dy
        if _replaceable(around, leg, 0, 2):
            low = t
        else:
            high = t
    points[i, 0], points[i, 1] = x + low * dx, y + low * dy


@kernel
def _slide_corners(around, points, count):  # type: ignore[no-untyped-def]
    """Slide every corner that touches nothing along both of its legs until it does; whether there was one."""
    loose, leg = False, np.empty((3, 2))
    for i in range(1, count - 1):
        for to in (i + 1, i - 1):
            if not _touches(around, points[i, 0], points[i, 1]):
                loose = True
                _slide(around, points, i, to, leg)
    return loose


@borrowing
def _copied(points, count, out):  # type: ignore[no-untyped-def]
    for i in range(count):
        out[i, 0], out[i, 1] = points[i, 0], points[i, 1]
    return count


@kernel
def _taut(around, points, capacity, out):  # type: ignore[no-untyped-def]
    """Shortcut and blunt corners in turn until nothing is gained; number of points written to out."""
    count = _copied(points, points.shape[0], out)
    work = np.empty((out.shape[0], 2))
    out[count, 0], out[count, 1] = around.goal_x, around.goal_y
    count += 1
    before = np.inf
    for _ in range(TUNING.rounds):
        count = _shortcut(around, out, count)
        length = 0.0
        for i in range(count - 1):
            length += math.sqrt((out[i + 1, 0] - out[i, 0]) ** 2 + (out[i + 1, 1] - out[i, 1]) ** 2)
        if before - length < TUNING.gain * length:
            break
        before = length
        count = _copied(work, _blunt_corners(around, out, count, TUNING.flat_turn, capacity, work), out)
    for _ in range(TUNING.loose_rounds):
        if not _slide_corners(around, out, count):
            break
        count = _shortcut(around, out, count)
        count = _copied(work, _blunt_corners(around, out, count, np.pi, out.shape[0], work), out)
    for i in range(count - 1):
        ax, ay, bx, by = out[i, 0], out[i, 1], out[i + 1, 0], out[i + 1, 1]
        length, s = _entry(around, ax, ay, bx, by)
        if s <= length:
            out[i + 1, 0], out[i + 1, 1] = ax + (bx - ax) * s / length, ay + (by - ay) * s / length
            return i + 2
    return count


def shorten(path: Any, steering: Steering, checker: EdgeChecker) -> Any:
    """Shorten a path (consecutive motions into the goal) inside its class; it never costs more.

    Every new piece is certified by the clearance field, which is FCL's distance less its error bound.
    """
    if isinstance(steering, InTime):
        return in_time.taut_in_time(path, steering, checker)
    if _straight(steering) and not np.any(path.curvature):
        length, (x, y, theta) = path.length[-1].sum(), path.start[-1]
        end = np.array([x + length * np.cos(theta), y + length * np.sin(theta)])
        short = taut_polyline(np.vstack([path.start[:, :2], end]), checker.around)
        return steering.connect(short[:-1], short[1:])
    return chain.cheapest_chain(path, steering, checker)


def resumes(steering: Steering) -> bool:
    """Tell whether paths of a method are shortened much faster from an earlier path of the class."""
    return isinstance(steering, InTime) or not steering.drives or steering.motion is not ARCS


def resume(x: Array, path: Any, steering: Steering, checker: EdgeChecker) -> Any:
    """Find the cheapest path from x (n,) near an earlier one into the goal, in any class; None if there is none."""
    if isinstance(steering, InTime):
        return in_time.resumed(x, path, steering, checker)
    return chain.resumed(x, path, steering, checker)


def _straight(steering: Steering) -> bool:
    """Tell whether motions are those of a point, whose paths are polylines."""
    return steering.motion is ARCS and steering.n == 2
