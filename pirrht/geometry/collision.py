"""Measure distances from obstacles and decide whether paths are free; only this module queries FCL.

The robot is a sphere at a fixed height. FCL's distance from a sphere is exact for boxes, cylinders, spheres,
capsules and the outside of triangle meshes; meshes are hollow to it, and from an ellipsoid it can be
millimetres too great. `collide` is right for every convex solid, so it has the last word on those two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from threading import RLock
from typing import Any

import fcl
import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray
from pirrht.geometry.fcl_shapes import ball, capsule, shell_of, solid_of, tree_of
from pirrht.geometry.flat import CURVED, flat_cells
from pirrht.geometry.scene import Footprint, Kind, Workspace
from pirrht.geometry.shapes import PROBE, Solids, distance_from
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.walls import Answer, Found, nearest_walls, queried_points

SHORTEST = TUNING.shortest


def touches(
    free: Callable[[float], float], approach: Callable[[float, float], float], end: float = 1.0, *, slack: float = 0.0,
    undecided: bool = True,
) -> bool:  # fmt: skip
    """Bisect a path from 0 to `end` until free distances decide whether two things touch on it.

    A piece ab is free if free(a) + free(b) > approach(a, b) + slack.

    Args:
        free: distance between them at a place of the path [m]; at most 0 in contact.
        approach: how far they may come nearer between two places at most [m].
        slack: over-estimate of two distances [m].
        undecided: the answer where a piece stays undecided down to SHORTEST.
    """
    pieces = [(0.0, free(0.0), end, free(end))]
    while pieces:
        a, free_a, b, free_b = pieces.pop()
        if not min(free_a, free_b) > 0.0:
            return True
        length = approach(a, b)
        if free_a + free_b > length + slack:
            continue
        if length < SHORTEST:
            if undecided:
                return True
            continue
        middle = 0.5 * (a + b)
        between = free(middle)
        pieces += [(middle, between, b, free_b), (a, free_a, middle, between)]
    return False


class Collision:
    """Distances and free paths of a sphere among the obstacles of a world; the border bounds its centre."""

    def __init__(self, world: Workspace, footprint: Footprint) -> None:
        self.world, self.footprint = world, footprint
        self.calls = 0  # FCL queries so far
        self._lock = RLock()  # the probe is one for all, and threads move it
        doubtful = [o.kind in (Kind.ELLIPSOID, Kind.MESH) for o in world.obstacles]
        self._solids = [solid_of(o) for o in world.obstacles]
        self._shells = [
            shell_of(o) if o.kind is Kind.MESH else s for o, s in zip(world.obstacles, self._solids, strict=True)
        ]
        self._is_doubtful, self._doubtful = doubtful, any(doubtful)
        self._all_solids, self._all_shells = tree_of(self._solids), tree_of(self._shells)
        self._all_doubtful = tree_of([s for s, doubt in zip(self._solids, doubtful, strict=True) if doubt])
        self._probe = ball(np.zeros(3), PROBE)
        self._distance_request = fcl.DistanceRequest(enable_nearest_points=True)
        self._collision_request = fcl.CollisionRequest()
        self._waivers = np.array(world.waivers).reshape(-1, 4)
        self._border: tuple[float, ...] = (*world.lower.tolist(), *world.upper.tolist())
        self._slack = 2 * TUNING.hull_error if self._doubtful else 1e-9
        self._forms = Solids.of(world.obstacles)
        self._lowest, self._highest = self._forms.low, self._forms.high

    def extents(self) -> tuple[Array, Array]:
        """Return rectangles around the obstacles seen from above: lower and upper corners, 2 x (M, 2) [m]."""
        return self._lowest, self._highest

    def distance(self, points: Array) -> Array:
        """Return distances of the robot's centre from obstacles, (k, 2) -> (k,) [m]; 0 inside, infinite if none."""
        if not self._solids:
            return np.full(len(points), np.inf)
        nearest = self._nearest
        return np.array([nearest(point) for point in self._lift(points)], dtype=float)

    def obstacle_distance(self, index: int, points: Array) -> Array:
        """Return distances of the robot's centre from `obstacles[index]`, (k, 2) -> (k,) [m]; 0 inside."""
        return np.array([self._from_one(index, point) for point in self._lift(points)], dtype=float)

    def nearest_walls(self, points: Array, members: Sequence[int], cutoff: float, cell: float = 0.0) -> Found:
        """Return the nearest of the solids `members` and the nearest in another direction at points (k, 2) [m].

        No distance above `cutoff` [m] is reported. FCL answers for solids without a confirmed closed form. With a cell
        [m], bilinear interpolation between points so far apart is not too high where less margin begins to count.
        """
        counted = np.array(members, dtype=np.int64)
        height = self.footprint.height
        found = nearest_walls(self._forms, self._confirmed, counted, self._answer, points, height, cutoff)
        if not len(self._waivers):
            return found
        first, second = (np.minimum(self._eased(d, points, cell), cutoff) for d in (found.first, found.second))
        return found._replace(first=first, second=second)

    def flat_cells(self, points: Array, found: Found, members: Sequence[int], cutoff: float) -> NDArray[np.int8]:
        """Return in which cells of blocks of points (k, S, S, 2) [m] distances are linear (`flat.flat_cells`)."""
        counted, height = np.array(members, dtype=np.int64), self.footprint.height
        kinds = flat_cells(self._forms, self._confirmed, counted, points, found, height, cutoff)
        kinds[self.near_waivers(points[:, :-1, :-1], cutoff)] = CURVED
        return kinds

    def near_waivers(self, points: Array, distance: float) -> BoolArray:
        """Return whether points (..., 2) are within a distance [m] of a disc in which less margin counts, (...,)."""
        near = np.zeros(points.shape[:-1], dtype=np.bool_)
        for x, y, disc, _ in self._waivers:
            near |= np.hypot(points[..., 0] - x, points[..., 1] - y) < disc + distance
        return near

    def queried_points(self, points: Array, members: Sequence[int], cutoff: float) -> int:
        """Count points (k, 2) [m] that may be within a cutoff [m] of solids without a confirmed closed form."""
        return queried_points(self._forms, self._confirmed, np.array(members, dtype=np.int64), points, cutoff)

    @cached_property
    def _confirmed(self) -> BoolArray:
        """Return of which solids FCL confirms the closed form at corners and sides of rectangles around them, (M,)."""
        confirmed = self._forms.form >= 0
        r, height = self.footprint
        spots = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1], [1, 0.1], [-1, -0.1], [0.1, 1], [-0.1, -1]])
        for m in np.flatnonzero(confirmed):
            middle, half = 0.5 * (self._lowest[m] + self._highest[m]), 0.5 * (self._highest[m] - self._lowest[m])
            around = np.vstack([middle + share * (half + r) * spots for share in (0.4, 1.0)])
            exact = self.obstacle_distance(int(m), around)
            found = np.array([distance_from(self._forms, m, *spot, height) for spot in around])
            confirmed[m] = np.all(np.abs(np.where(found > PROBE, found, 0.0) - exact) < TUNING.form_error)
        return confirmed

    def clearance(self, points: Array) -> Array:
        """Return free distances, (k, 2) -> (k,) [m]; 1-Lipschitz, at most 0 where the robot may not be."""
        border = np.minimum(points - self.world.lower, self.world.upper - points).min(axis=-1)
        nearest: Array = np.minimum(border, self.distance(points) - self.footprint.radius)
        return nearest

    def free(self, points: Array) -> BoolArray:
        """Return whether the robot touches no obstacle and is strictly inside the border, (k, 2) [m] -> (k,)."""
        return self.segments_free(points, points)

    def segments_free(self, tails: Array, heads: Array, more: float = 0.0) -> BoolArray:
        """Return whether the robot can go straight from tails to heads, 2 x (k, 2) [m] -> (k,); a swept capsule each.

        Args:
            more: clearance from obstacles that is required in addition [m].
        """
        result = self._inside(tails) & self._inside(heads)
        middles = self._lift(0.5 * (tails + heads))
        spans, radius = heads - tails, self.footprint.radius + more
        for k in np.flatnonzero(result):
            result[k] = not self._hits(self._all_solids, capsule(radius, middles[k], spans[k]))
            if not result[k] and len(self._waivers):
                length = float(np.hypot(*spans[k]))
                along = spans[k] / max(length, 1e-300)
                result[k] = self.bisect_free(lambda s, k=k, along=along: tails[k] + s * along, length)  # type: ignore[misc]
        return result

    def bisect_free(self, position: Callable[[float], Array], length: float) -> bool:
        """Return whether clearances certify a curve: a piece ab is free if c(a) + c(b) > |ab|.

        Args:
            position: arc length in [0, length] [m] -> robot centre (2,) [m].
            length: of the curve [m].
        """
        return not touches(lambda s: self._clear_at(position(s)), lambda a, b: b - a, length, slack=self._slack)

    def _clear_at(self, position: Array) -> float:
        x, y = float(position[0]), float(position[1])
        left, low, right, high = self._border
        border = min(x - left, right - x, y - low, high - y)
        if border <= 0 or not self._solids:
            return border
        return min(border, self._nearest(np.array([x, y, self.footprint.height])) - self.footprint.radius)

    def _inside(self, points: Array) -> BoolArray:
        within = (points > self.world.lower) & (points < self.world.upper)
        return np.asarray(within.all(axis=-1), dtype=np.bool_)

    def _lift(self, points: Array) -> Array:
        lifted = np.empty((len(points), 3))
        lifted[:, :2] = points
        lifted[:, 2] = self.footprint.height
        return lifted

    def _nearest(self, point: Array) -> float:
        probe, request = self._probe, self._distance_request
        best = [np.inf]

        def visit(one: Any, other: Any, data: list[float]) -> tuple[bool, float]:
            d = fcl.distance(one, other, request, fcl.DistanceResult())
            if d < data[0]:
                data[0] = d
            return d <= 0, data[0]

        with self._lock:
            self.calls += 1
            probe.setTranslation(point)
            self._all_shells.distance(probe, best, visit)
        d = best[0] + PROBE
        if d <= PROBE:
            return 0.0
        if self._doubtful:
            d = self._corrected(point, d, lambda body: self._hits(self._all_doubtful, body))
        return float(self._eased(d, point)) if len(self._waivers) else d

    def _eased(self, d: Any, points: Array, cell: float = 0.0) -> Any:
        """Raise distances (k,) [m] from points (k, 2) to obstacles where less than the safety margin counts.

        The planning radius then leaves as much clearance as a smaller radius does within the disc of a waiver. Where
        one takes over from the other, interpolation in cells [m] is too high by half a cell, which is subtracted.
        """
        eased = d
        for x, y, disc, less in self._waivers:
            away = np.hypot(points[..., 0] - x, points[..., 1] - y)
            other = np.minimum(self.footprint.radius + disc - away, d + less)
            kink = np.where(np.abs(eased - other) < TUNING.kink_cells * cell, min(0.6 * cell, 0.5 * less), 0.0)
            eased = np.maximum(eased, other) - kink
        return np.where(d > 0.0, eased, d)

    @property
    def least_radius(self) -> float:
        """Return the least radius with which the robot plans anywhere [m]."""
        return self.footprint.radius - float(self._waivers[:, 3].max(initial=0.0))

    def _answer(self, index: int, point: Array) -> Answer:
        """Return distance and offset of a point (3,) [m] from one solid, for `nearest_walls`."""
        result = fcl.DistanceResult()
        d = self._from_one(index, point, result)
        if d <= 0.0:
            return 0.0, 0.0, 0.0
        obstacle = self.world.obstacles[index]
        if obstacle.kind is Kind.MESH:  # FCL reports that of a mesh first, and in the mesh's own frame
            near = obstacle.rotation @ result.nearest_points[0] + obstacle.position
        else:
            near = result.nearest_points[1]
        return d, float(point[0] - near[0]), float(point[1] - near[1])

    def _from_one(self, index: int, point: Array, result: Any = None) -> float:
        result = fcl.DistanceResult() if result is None else result
        with self._lock:
            self.calls += 1
            self._probe.setTranslation(point)
            d: float = PROBE + fcl.distance(self._probe, self._shells[index], self._distance_request, result)
        if d <= PROBE:
            return 0.0
        if not self._is_doubtful[index]:
            return d
        return self._corrected(point, d, lambda body: self._hits_one(self._solids[index], body))

    def _corrected(self, point: Array, d: float, hits: Callable[[Any], bool]) -> float:
        """Return the greatest radius up to d of a ball that hits nothing, to within TUNING.hull_error."""
        margin = 0.5 * TUNING.hull_error
        if d <= margin or not hits(ball(point, d - margin)):
            return d
        if hits(ball(point, PROBE)):
            return 0.0
        low, high = max(PROBE, d - 4 * margin), d - margin
        while low > PROBE and hits(ball(point, low)):
            low, high = max(PROBE, low - 4 * (d - low)), low
        while high - low > margin:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if hits(ball(point, middle)) else (middle, high)
        return low

    def _hits_one(self, solid: Any, body: Any) -> bool:
        self.calls += 1
        hit: int = fcl.collide(body, solid, self._collision_request, fcl.CollisionResult())
        return hit > 0

    def _hits(self, manager: Any, body: Any) -> bool:
        request = self._collision_request

        def visit(one: Any, other: Any, data: list[bool]) -> bool:
            if fcl.collide(one, other, request, fcl.CollisionResult()):
                data.append(True)
            return bool(data)

        self.calls += 1
        found: list[bool] = []
        manager.collide(body, found, visit)
        return bool(found)
