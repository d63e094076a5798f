"""Measure distances from obstacles and decide whether paths are free; only this module knows FCL.

The robot is a sphere at a fixed height. `collide` of FCL is right for every convex solid and has the last word on swept
paths; distances are those of `shapes`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import fcl
import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Workspace
from pirrht.geometry.shapes import Solids, distances, hull_of
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.walls import Found, nearest_walls

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
        self._solids = Solids.of(world.obstacles)
        self.first = _first_of_equals(world.obstacles)  # (M,) index of the first solid that is equal to each
        self._every = np.unique(self.first)
        self._tree = fcl.DynamicAABBTreeCollisionManager()
        self._tree.registerObjects([solid_of(world.obstacles[i]) for i in self._every.tolist()])
        self._tree.setup()
        self._request = fcl.CollisionRequest()
        self._waivers = np.array(world.waivers).reshape(-1, 4)

    def extents(self) -> tuple[Array, Array]:
        """Return rectangles around the obstacles seen from above: lower and upper corners, 2 x (M, 2) [m]."""
        return self._solids.low, self._solids.high

    def distance(self, points: Array) -> Array:
        """Return distances of the robot's centre from obstacles, (k, 2) -> (k,) [m]; 0 inside, infinite if none."""
        return self._eased(self._from(self._every, points), points)

    def obstacle_distance(self, index: int, points: Array) -> Array:
        """Return distances of the robot's centre from `obstacles[index]`, (k, 2) -> (k,) [m]; 0 inside."""
        return self._from(self.first[index : index + 1], points)

    def _from(self, members: IntArray, points: Array) -> Array:
        out = np.empty(len(points))
        distances(self._solids, members, np.ascontiguousarray(points), self.footprint.height, out)
        return out

    def nearest_walls(self, points: Array, members: Sequence[int], cutoff: float, cell: float = 0.0) -> Found:
        """Return the nearest of the solids `members` and the nearest in another direction at points (k, 2) [m].

        No distance above `cutoff` [m] is reported. With a cell [m], bilinear interpolation between points so far apart
        is not too high where less margin begins to count.
        """
        counted = np.unique(self.first[np.array(members, dtype=np.int64)])
        found = nearest_walls(self._solids, counted, points, self.footprint.height, cutoff)
        if not len(self._waivers):
            return found
        first, second = (np.minimum(self._eased(d, points, cell), cutoff) for d in (found.first, found.second))
        return found._replace(first=first, second=second)

    def clearance(self, points: Array) -> Array:
        """Return free distances, (k, 2) -> (k,) [m]; 1-Lipschitz, at most 0 where the robot may not be."""
        border = np.minimum(points - self.world.lower, self.world.upper - points).min(axis=-1)
        return np.asarray(np.minimum(border, self.distance(points) - self.footprint.radius))

    def free(self, points: Array) -> BoolArray:
        """Return whether the robot touches no obstacle and is strictly inside the border, (k, 2) [m] -> (k,)."""
        return self.segments_free(points, points)

    def segments_free(self, tails: Array, heads: Array, more: float = 0.0) -> BoolArray:
        """Return whether capsules from tails to heads, 2 x (k, 2) [m], are free, (k,), with `more` clearance [m]."""
        low, high = self.world.lower, self.world.upper
        result: BoolArray = np.all((tails > low) & (tails < high) & (heads > low) & (heads < high), axis=-1)
        for k in np.flatnonzero(result):
            span = heads[k] - tails[k]
            middle = np.append(0.5 * (tails[k] + heads[k]), self.footprint.height)
            result[k] = not self._hits(_capsule(self.footprint.radius + more, middle, span))
            if not result[k] and len(self._waivers):
                length = float(np.hypot(*span))
                along = span / max(length, 1e-300)
                result[k] = self.bisect_free(lambda s, k=k, along=along: tails[k] + s * along, length)  # type: ignore[misc]
        return result

    def bisect_free(self, position: Callable[[float], Array], length: float) -> bool:
        """Return whether clearances certify a curve: a piece ab is free if c(a) + c(b) > |ab|.

        `position` takes an arc length in [0, length] [m] to the robot's centre (2,) [m].
        """

        def clear(s: float) -> float:
            return float(self.clearance(position(s)[None])[0])

        return not touches(clear, lambda a, b: b - a, length, slack=TUNING.rounding)

    def _eased(self, d: Array, points: Array, cell: float = 0.0) -> Array:
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

    def _hits(self, body: Any) -> bool:
        def visit(one: Any, other: Any, data: list[bool]) -> bool:
            if fcl.collide(one, other, self._request, fcl.CollisionResult()):
                data.append(True)
            return bool(data)

        self.calls += 1
        found: list[bool] = []
        self._tree.collide(body, found, visit)
        return bool(found)


def _first_of_equals(obstacles: Sequence[Obstacle]) -> IntArray:
    """Return the index of the first obstacle of the same shape in the same place as each, (M,)."""
    known: dict[tuple[Any, ...], int] = {}
    first = np.empty(len(obstacles), dtype=np.int64)
    for i, o in enumerate(obstacles):
        arrays = (o.size, o.position, o.rotation, o.vertices, o.faces)
        shape = tuple(b"" if array is None else array.tobytes() for array in arrays)
        first[i] = known.setdefault((o.kind, *shape), i)
    return first


def _capsule(radius: float, middle: Array, span: Array) -> Any:
    """Return the capsule that a sphere of a radius [m] sweeps along span (2,) [m] about `middle` (3,) [m]."""
    length = float(np.hypot(span[0], span[1]))
    if length < 1e-9:
        return fcl.CollisionObject(fcl.Sphere(radius), fcl.Transform(middle))
    c, s = span[0] / length, span[1] / length
    along_z = np.array([[-s, 0.0, c], [c, 0.0, s], [0.0, 1.0, 0.0]])  # the capsule's own axis is z
    return fcl.CollisionObject(fcl.Capsule(radius, length), fcl.Transform(along_z, middle))


def solid_of(obstacle: Obstacle) -> Any:
    """Return an obstacle as a convex solid in world coordinates [m]."""
    a, b, c = (float(s) for s in obstacle.size)
    match obstacle.kind:
        case Kind.BOX:
            shape = fcl.Box(2 * a, 2 * b, 2 * c)
        case Kind.CYLINDER:
            shape = fcl.Cylinder(a, 2 * b)
        case Kind.SPHERE:
            shape = fcl.Sphere(a)
        case Kind.CAPSULE:
            shape = fcl.Capsule(a, 2 * b)
        case Kind.ELLIPSOID:
            shape = fcl.Ellipsoid(a, b, c)
        case Kind.MESH:
            vertices, faces = hull_of(obstacle)
            shape = fcl.Convex(vertices, len(faces), np.insert(faces, 0, 3, axis=1).ravel())
    pose = fcl.Transform(np.asarray(obstacle.rotation, dtype=float), np.asarray(obstacle.position, dtype=float))
    return fcl.CollisionObject(shape, pose)
