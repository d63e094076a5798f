"""Compute exact distances of a footprint that turns with the heading, and judge motions by them.

FCL's distances between boxes are too great by decimetres where both are cut at one height, and tests hold these against
its contacts, which are right.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.errors import SceneError
from pirrht.geometry.collision import Collision, touches
from pirrht.geometry.scene import Scene, Waiver
from pirrht.geometry.shapes import PROBE, distance_from, offset_from, square_to
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
        ex, ey = offset_from(solids, m, x, y, height)
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
    ex, ey = offset_from(solids, m, px, py, height)
    for k in range(count):
        if ex * (corners[k, 0] - px) + ey * (corners[k, 1] - py) < -1e-9 * best:
            return _inside(solids, m, height, corners, best, halvings)
    return best


@kernel
def hull_distances(solids, members, hull, farthest, poses, height, out):  # type: ignore[no-untyped-def]
    """Write distances from the nearest of the members to a hull (l, 2) at poses (k, 3), a height [m], out (k,).

    No corner is farther from the reference point than `farthest` [m].
    """
    corners = np.empty(hull.shape)
    for i in range(len(poses)):
        x, y, th = poses[i]
        for k in range(len(hull)):
            corners[k, 0] = x + math.cos(th) * hull[k, 0] - math.sin(th) * hull[k, 1]
            corners[k, 1] = y + math.sin(th) * hull[k, 0] + math.cos(th) * hull[k, 1]
        best = math.inf
        for m in members:
            if square_to(solids.low, solids.high, m, x, y) < (best + farthest) ** 2:
                best = min(best, _from_hull(solids, m, height, corners, TUNING.edge_halvings))
        out[i] = best


class HullCollision(Collision):
    """Distances and free motions of a footprint that turns, among the obstacles of a world; by poses (k, 3).

    Positions (k, 2) alone are judged by the inscribed disc: free ones may still be free at no heading.
    """

    def clearance(self, points: Array) -> Array:
        """Return exact free distances at poses (k, 3), or those of the inscribed disc at places (k, 2), (k,) [m]."""
        if points.shape[1] == 2:
            return super().clearance(points)
        body = self.footprint
        away = np.empty(len(points))
        poses = np.ascontiguousarray(points, dtype=float)
        hull_distances(self._solids, self._every, body.hull, body.reach - body.rounding, poses, body.height, away)
        places = points[:, :2]
        eased = self._eased(away - body.rounding + body.radius, places) - body.radius
        border = np.minimum(places - self.world.lower, self.world.upper - places).min(axis=-1)
        return np.asarray(np.minimum(border, eased))

    def free(self, points: Array) -> BoolArray:
        """Return whether the robot touches nothing at poses (k, 3), or its inscribed disc at places (k, 2), (k,)."""
        return super().free(points) if points.shape[1] == 2 else np.asarray(self.clearance(points) > 0.0)

    def bisect_free(self, pose: Callable[[float], Array], length: float, curvature: float = 0.0) -> bool:
        """Return whether an arc of a curvature [1/m] is free; `pose` takes an arc length [m] to x, y and heading."""
        speed = 1.0 + self.footprint.reach * abs(curvature)
        return self._free(pose, length, speed)

    def _free(self, pose: Callable[[float], Array], length: float, speed: float) -> bool:
        """Return whether a motion is free, on which no point moves faster than `speed` [m per unit of its length]."""

        def clear(s: float) -> float:
            return float(self.clearance(pose(s)[None, :3])[0])

        return not touches(clear, lambda a, b: speed * (b - a), length, slack=TUNING.rounding)

    def turn_free(self, pose: Array, turn: float) -> bool:
        """Return whether a turn [rad] on the spot from a pose (3,) is free, all headings between included."""
        return self._free(lambda s: pose + np.array([0.0, 0.0, s * turn]), 1.0, self.footprint.reach * abs(turn))

    def segments_free(self, tails: Array, heads: Array, more: float = 0.0) -> BoolArray:
        """Return whether straight pieces from tails to heads, 2 x (k, 2) [m], are free, headed along them, (k,)."""
        free = super().segments_free(tails, heads, more)
        for k in np.flatnonzero(free):
            span = heads[k] - tails[k]
            heading = math.atan2(span[1], span[0])
            begun = np.append(tails[k], heading)
            ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
            free[k] = self.bisect_free(partial(_ahead, begun, ahead), float(np.hypot(*span)))
        return free

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
            raise SceneError(
                f"{scene.name}: the start ({x:g}, {y:g}) is in collision at its heading of {heading:g} rad for "
                f"{scene.body} (it lacks {-body:.3g} m); move or turn it, or choose a smaller footprint"
            )
        disc = TUNING.turning_reach * scene.footprint.reach
        return replace(scene, waivers=(*scene.waivers, Waiver(x, y, disc, scene.margin - 0.5 * body)))


def _ahead(pose: Array, ahead: Array, s: float) -> Array:
    return pose + s * ahead
