"""Compute exact distances of a footprint that turns with the heading, and judge motions by them.

FCL's distances between boxes are too great by decimetres where both are cut at one height, and tests hold these against
its contacts, which are right.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.errors import SceneError
from pirrht.geometry.arcs import point_along
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint, placed
from pirrht.geometry.scene import Scene, Waiver, Workspace
from pirrht.geometry.shapes import PROBE, Solids, distance_from, offset_from, square_to
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import borrowing, kernel


@borrowing
def _along_edge(solids, m, height, ax, ay, bx, by, halvings):  # type: ignore[no-untyped-def]
    """Return the distance [m] of solid m from a segment at a height, which is convex along it, and where it is least.

    The sign of its slope along the segment says in which half that is.
    """
    low, high = 0.0, 1.0
    best, where = math.inf, 0.0
    for k in range(halvings + 2):
        s = (0.0, 1.0)[k] if k < 2 else 0.5 * (low + high)
        x, y = ax + s * (bx - ax), ay + s * (by - ay)
        d = distance_from(solids, m, x, y, height)
        if d <= PROBE:
            return 0.0, s
        if d < best:
            best, where = d, s
        ex, ey, _ = offset_from(solids, m, x, y, height)
        slope = ex * (bx - ax) + ey * (by - ay)
        if slope == 0.0 or (k == 0 and slope > 0.0) or (k == 1 and slope < 0.0):
            break
        if k >= 2 and slope > 0.0:
            high = s
        elif k >= 2:
            low = s
    return best, where


@borrowing
def _from_chord(solids, m, height, corners, x, halvings):  # type: ignore[no-untyped-def]
    """Return the distance of solid m from the chord along y of a polygon at x [m]."""
    low, high = math.inf, -math.inf
    for k in range(corners.shape[0]):
        a = corners[k]
        b = corners[(k + 1) % corners.shape[0]]

        if min(a[0], b[0]) <= x <= max(a[0], b[0]) and a[0] != b[0]:
            y = a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1])
            low = min(low, y)
            high = max(high, y)
    return _along_edge(solids, m, height, x, low, x, high, halvings)[0]


@borrowing
def _inside(solids, m, height, corners, below, halvings):  # type: ignore[no-untyped-def]
    """Return the least distance of solid m from the inside of a polygon [m], at most `below`: over chords along y."""
    left, right, best = math.inf, -math.inf, below
    for k in range(corners.shape[0]):
        left = min(left, corners[k, 0])
        right = max(right, corners[k, 0])
    for _ in range(halvings):
        third = (right - left) / 3.0
        one = _from_chord(solids, m, height, corners, left + third, halvings)
        other = _from_chord(solids, m, height, corners, right - third, halvings)
        best = min(best, one, other)
        if best <= PROBE:
            return 0.0
        if one < other:
            right -= third
        else:
            left += third
    return best


@borrowing
def _from_hull(solids, m, height, corners, halvings):  # type: ignore[no-untyped-def]
    """Return the distance of solid m from a convex polygon (k, 2) at a height [m].

    It is least on an edge unless it falls from there towards a corner: distances from a convex solid are convex.
    """
    count = corners.shape[0]
    best, px, py = math.inf, 0.0, 0.0
    for k in range(count):
        a = corners[k]
        b = corners[(k + 1) % count]
        d, s = _along_edge(solids, m, height, a[0], a[1], b[0], b[1], halvings)
        if d < best:
            best = d
            px = a[0] + s * (b[0] - a[0])
            py = a[1] + s * (b[1] - a[1])
    if best <= PROBE:
        return 0.0
    ex, ey, _ = offset_from(solids, m, px, py, height)
    for k in range(count):
        if ex * (corners[k, 0] - px) + ey * (corners[k, 1] - py) < -1e-9 * best:
            return _inside(solids, m, height, corners, best, halvings)
    return best


class HullNumbers(NamedTuple):
    """A footprint that turns with the heading among solids, as kernels take it; lengths in [m]."""

    solids: Solids
    members: IntArray  # indices of the solids that count
    hull: Array  # corners of the hull, (l, 2)
    height: float
    farthest: float  # distance of the farthest corner from the reference point
    rounding: float  # by which the hull is grown
    radius: float  # of the inscribed disc
    waivers: Array  # (w, 4) x, y, radius of a disc, and by how much the margin is smaller there
    lower: Array  # (2,) least corner of the workspace
    upper: Array  # (2,)


@borrowing
def _clearance(numbers, x, y, th, corners):  # type: ignore[no-untyped-def]
    """Return the exact clearance at a pose [m]; `corners` (l, 2) is scratch."""
    hull = numbers.hull
    best, radius = math.inf, numbers.radius
    for k in range(len(hull)):
        corners[k, 0] = x + math.cos(th) * hull[k, 0] - math.sin(th) * hull[k, 1]
        corners[k, 1] = y + math.sin(th) * hull[k, 0] + math.cos(th) * hull[k, 1]
    for m in numbers.members:
        if square_to(numbers.solids.low, numbers.solids.high, m, x, y) < (best + numbers.farthest) ** 2:
            best = min(best, _from_hull(numbers.solids, m, numbers.height, corners, TUNING.edge_halvings))
    clear = best - numbers.rounding + radius
    eased = clear
    for w in range(len(numbers.waivers) if clear > 0.0 else 0):
        disc = numbers.waivers[w]
        rim = radius + disc[2] - math.sqrt((x - disc[0]) ** 2 + (y - disc[1]) ** 2)
        eased = max(eased, min(rim, clear + disc[3]))
    across = min(x - numbers.lower[0], numbers.upper[0] - x)
    along = min(y - numbers.lower[1], numbers.upper[1] - y)
    return min(eased - radius, min(across, along))


@kernel
def hull_clearances(numbers, poses, out):  # type: ignore[no-untyped-def]
    """Write exact clearances at poses (k, 3) to out (k,) [m]."""
    corners = np.empty(numbers.hull.shape)
    for i in range(len(poses)):
        out[i] = _clearance(numbers, poses[i, 0], poses[i, 1], poses[i, 2], corners)


@kernel
def hull_is_free(numbers, start, speed, rate, length):  # type: ignore[no-untyped-def]
    """Return whether a motion from a pose is free, along its heading at a speed that turns at a rate [rad] per unit.

    Clearances to either side of a pose must cover it; what stays undecided down to `TUNING.shortest` is not free.
    """
    (x, y, th), corners = start, np.empty(numbers.hull.shape)
    s, reached = 0.0, 0.0
    per = 1.0 / (speed + (numbers.farthest + numbers.rounding) * abs(rate))
    ux, uy = math.cos(th), math.sin(th)
    while True:
        px, py = point_along(x, y, th, ux, uy, rate, s) if speed > 0.0 else (x, y)
        c = _clearance(numbers, px, py, th + rate * s, corners) - TUNING.rounding
        if s > reached and s - per * c > reached:
            s = reached
            continue
        if c <= 0.0 or (s < length and c < 0.5 * TUNING.shortest):
            return False
        if s >= length:
            return True
        reached = min(s + per * c, length)
        s = min(s + TUNING.stride * per * c, length)


class HullCollision(Collision):
    """Distances and free motions of a footprint that turns, among the obstacles of a world; by poses (k, 3).

    Positions (k, 2) alone are judged by the inscribed disc: free ones may still be free at no heading.
    """

    def __init__(self, world: Workspace, footprint: Footprint) -> None:
        super().__init__(world, footprint)
        rounding, lower, upper = footprint.rounding, world.lower.astype(float), world.upper.astype(float)
        self._numbers = HullNumbers(
            self._solids, self._every, footprint.hull, footprint.height, footprint.reach - rounding, rounding,
            footprint.radius, self._waivers, lower, upper,
        )  # fmt: skip

    def clearance(self, points: Array) -> Array:
        """Return exact free distances at poses (k, 3), or those of the inscribed disc at places (k, 2), (k,) [m]."""
        if points.shape[1] == 2:
            return super().clearance(points)
        clear = np.empty(len(points))
        hull_clearances(self._numbers, np.ascontiguousarray(points, dtype=float), clear)
        return clear

    def free(self, points: Array) -> BoolArray:
        """Return whether the robot touches nothing at poses (k, 3), or its inscribed disc at places (k, 2), (k,)."""
        return super().free(points) if points.shape[1] == 2 else np.asarray(self.clearance(points) > 0.0)

    def arc_free(self, start: tuple[float, float, float], curvature: float, length: float) -> bool:
        """Return whether an arc from a pose, along its heading, of a curvature [1/m] and length [m] is free."""
        return bool(hull_is_free(self._numbers, start, 1.0, curvature, length))

    def turn_free(self, pose: Array, turn: float) -> bool:
        """Return whether a turn [rad] on the spot from a pose (3,) is free, all headings between included."""
        x, y, heading = pose.tolist()
        return bool(hull_is_free(self._numbers, (x, y, heading), 0.0, math.copysign(1.0, turn), abs(turn)))

    def segments_free(self, tails: Array, heads: Array) -> BoolArray:
        """Return whether straight pieces from tails to heads, 2 x (k, 2) [m], are free, headed along them, (k,)."""
        free = super().segments_free(tails, heads)
        for k in np.flatnonzero(free):
            span = heads[k] - tails[k]
            start = (float(tails[k, 0]), float(tails[k, 1]), math.atan2(span[1], span[0]))
            free[k] = self._sweeps_free(np.array(start), span) or (
                len(self._waivers) > 0 and self.arc_free(start, 0.0, float(np.hypot(*span)))
            )
        return free

    def _sweeps_free(self, start: Array, span: Array) -> bool:
        """Return whether the hull that a move from a pose by span (2,) [m] sweeps is free, with all of the margin."""
        middle = start[:2] + 0.5 * span
        ends = placed(self.footprint.hull, start) - middle
        aside = ends @ np.array([-span[1], span[0]])
        right = int(np.argmin(aside))
        around = np.roll(np.arange(len(ends)), -right)  # from there over the front
        left = int(np.argmax(aside[around]))
        swept = np.vstack((ends[around[: left + 1]] + span, ends[around[left:]], ends[right]))
        farthest = float(np.hypot(*swept.T).max())
        clear = np.empty(1)
        numbers = self._numbers._replace(hull=swept, farthest=farthest, waivers=np.empty((0, 4)))
        hull_clearances(numbers, np.append(middle, 0.0)[None], clear)
        return bool(clear[0] > 0.0)

    def _free_scaled(self, pose: Array, share: float) -> bool:
        """Return whether the robot would be free at a pose (3,) at a share of its size, without its margin."""
        hull, farthest = share * self._numbers.hull, share * self._numbers.farthest
        numbers = self._numbers._replace(hull=hull, farthest=farthest, rounding=0.0, radius=0.0)
        hull_clearances(numbers, pose[None], clear := np.empty(1))
        return bool(clear[0] > 0.0)

    def fitted(self, scene: Scene) -> Scene:
        """Return the scene with less safety margin around a start at whose pose there is no room for all of it.

        SceneError: the robot touches an obstacle at the start, at its heading.
        """
        x, y, heading = scene.start.tolist()
        clear = float(self.clearance(scene.start[None])[0])
        if clear > 0.0:
            return scene
        body = clear + scene.margin
        if body <= 0.0:
            fits = bisect_left(range(1, 1001), True, key=lambda k: not self._free_scaled(scene.start, k / 1000.0))
            raise SceneError(
                f"{scene.name}: the start ({x:g}, {y:g}) is in collision at its heading of {heading:g} rad for "
                f"{scene.body}; move or turn it, or choose a footprint of at most {fits / 10.0:g} % of its size"
            )
        disc = TUNING.turning_reach * scene.footprint.reach
        return replace(scene, waivers=(*scene.waivers, Waiver(x, y, disc, scene.margin - 0.5 * body)))
