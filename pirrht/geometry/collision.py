"""Measure distances from obstacles and decide whether paths are free; only this module knows FCL.

The robot is a sphere at a fixed height. `collide` of FCL is right for every convex solid and has the last word on swept
paths; distances are those of `shapes`.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import fcl
import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.arcs import along
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.scene import Kind, Obstacle, Scene, Workspace
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
    """Distances and free paths of a sphere among the obstacles of a world; the border bounds its centre.

    Points are (k, 2) at the footprint's height, or (k, 3) in space [m].
    """

    def __init__(self, world: Workspace, footprint: Footprint) -> None:
        self.world, self.footprint = world, footprint
        self.calls = 0  # FCL queries so far
        self._solids = Solids.of(world.obstacles)
        self.first = _first_of_equals(world.obstacles)  # (M,) index of the first solid that is equal to each
        self._every = np.unique(self.first)
        self._tree = fcl.DynamicAABBTreeCollisionManager()
        self._tree.registerObjects([solid_of(world.obstacles[i]) for i in self._every.tolist()])
        self._tree.setup()
        self._waivers = np.array(world.waivers).reshape(-1, 4)

    def extents(self) -> tuple[Array, Array]:
        """Return boxes around the obstacles, in the plane seen from above: lower and upper corners, 2 x (M, d) [m]."""
        d = len(self.world.lower)
        return self._solids.low[:, :d], self._solids.high[:, :d]

    def distance(self, points: Array) -> Array:
        """Return distances of the robot's centre from obstacles, (k, 2) -> (k,) [m]; 0 inside, infinite if none.

        They are greater where less than the safety margin counts.
        """
        return self._eased(self.true_distance(points), points)

    def true_distance(self, points: Array) -> Array:
        """Return distances of the robot's centre from obstacles, whatever the margin, (k, 2) -> (k,) [m]."""
        return self._from(self._every, points)

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
        other = np.where(first == found.first, found.other, 0.0)  # a distance that is eased is linear nowhere
        return found._replace(first=first, second=second, other=other)

    def clearance(self, points: Array) -> Array:
        """Return free distances, (k, 2) -> (k,) [m]; 1-Lipschitz, at most 0 where the robot may not be."""
        border = np.minimum(points - self.world.lower, self.world.upper - points).min(axis=-1)
        return np.asarray(np.minimum(border, self.distance(points) - self.footprint.radius))

    def free(self, points: Array) -> BoolArray:
        """Return whether the robot touches no obstacle and is strictly inside the border, (k, 2) [m] -> (k,)."""
        return self.segments_free(points, points)

    def segments_free(self, tails: Array, heads: Array) -> BoolArray:
        """Return whether capsules from tails to heads, 2 x (k, 2) [m], are free, (k,)."""
        low, high = self.world.lower, self.world.upper
        result: BoolArray = np.all((tails > low) & (tails < high) & (heads > low) & (heads < high), axis=-1)
        for k in np.flatnonzero(result):
            result[k] = not self._hits(self._swept(tails[k], heads[k], self.footprint.radius))
            if not result[k] and len(self._waivers):
                result[k] = self._free_with_waivers(tails[k], heads[k])
        return result

    def _free_with_waivers(self, tail: Array, head: Array) -> bool:
        """Return whether a segment between points (2,) [m] is free where it is cut at the rims of all waivers."""
        span = head - tail
        square = max(float(span @ span), 1e-300)
        cuts = [0.0, 1.0]
        for x, y, disc, _ in self._waivers:
            to_center = np.array([x, y]) - tail
            nearest = float(to_center @ span) / square
            half = disc**2 / square - float(to_center @ to_center) / square + nearest**2
            if half > 0.0:
                cuts += [nearest - math.sqrt(half), nearest + math.sqrt(half)]
        for a, b in itertools.pairwise(sorted({min(max(cut, 0.0), 1.0) for cut in cuts})):
            middle = tail + 0.5 * (a + b) * span
            radius = self.footprint.radius - float(self.waived(middle[None])[0])
            if self._hits(self._swept(tail + a * span, tail + b * span, radius)):
                return False
        return True

    def waived(self, points: Array) -> Array:
        """Return by how much the margin is smaller at points (k, 2), (k,) [m]."""
        x, y, disc, less = self._waivers.T
        return np.asarray(
            np.where(np.hypot(points[:, :1] - x, points[:, 1:] - y) < disc, less, 0.0).max(axis=1, initial=0.0)
        )

    def _swept(self, tail: Array, head: Array, radius: float) -> Any:
        """Return the capsule that the robot sweeps between two places (d,) with a radius [m]."""
        middle = 0.5 * (tail + head)
        if len(middle) == 2:
            middle = np.append(middle, self.footprint.height)
        return _capsule(radius, middle, head - tail)

    def arc_free(self, start: tuple[float, float, float], curvature: float, length: float) -> bool:
        """Return whether an arc from a pose, along its heading, of a curvature [1/m] and length [m] is free."""
        return self.bisect_free(lambda s: np.array(along(*start, curvature, s)), length)

    def bisect_free(self, place: Callable[[float], Array], length: float) -> bool:
        """Return whether clearances certify a curve: a piece ab is free if c(a) + c(b) > |ab|.

        `place` takes an arc length in [0, length] [m] to where the robot is, its position [m] first.
        """
        d = len(self.world.lower)

        def clear(s: float) -> float:
            return float(self.clearance(place(s)[None, :d])[0])

        return not touches(clear, lambda a, b: b - a, length, slack=TUNING.rounding)

    def _eased(self, d: Array, points: Array, cell: float = 0.0) -> Array:
        """Raise distances (k,) [m] from points (k, 2) to obstacles where less than the safety margin counts.

        The planning radius then leaves as much clearance as a smaller radius does within the disc of a waiver. Where
        its rim takes over, interpolation in cells [m] is too high by half a cell, which is subtracted.
        """
        eased = d.copy()
        for x, y, disc, less in self._waivers:
            reach = self.footprint.radius + disc
            near = np.flatnonzero((np.abs(points[:, 0] - x) < reach) & (np.abs(points[:, 1] - y) < reach) & (d > 0.0))
            rim = reach - np.hypot(points[near, 0] - x, points[near, 1] - y)
            kink = np.where(np.abs(eased[near] - rim) < TUNING.kink_cells * cell, min(0.6 * cell, 0.5 * less), 0.0)
            eased[near] = np.maximum(eased[near], np.minimum(rim, d[near] + less)) - kink
        return eased

    def fitted(self, scene: Scene) -> Scene:
        """Return the scene with what its footprint requires around the start: of a disc nothing more."""
        return scene

    @property
    def least_radius(self) -> float:
        """Return the least radius with which the robot plans anywhere [m]."""
        return self.footprint.radius - float(self._waivers[:, 3].max(initial=0.0))

    def _hits(self, body: Any) -> bool:
        self.calls += 1
        found = fcl.CollisionData()
        self._tree.collide(body, found, fcl.defaultCollisionCallback)
        return bool(found.result.is_collision)


def _first_of_equals(obstacles: Sequence[Obstacle]) -> IntArray:
    """Return the index of the first obstacle of the same shape in the same place as each, (M,)."""
    known: dict[tuple[Any, ...], int] = {}
    first = np.empty(len(obstacles), dtype=np.int64)
    for i, o in enumerate(obstacles):
        shape = tuple(
            b"" if array is None else array.tobytes() for array in (o.size, o.position, o.rotation, o.vertices, o.faces)
        )
        first[i] = known.setdefault((o.kind, *shape), i)
    return first


def _capsule(radius: float, middle: Array, span: Array) -> Any:
    """Return the capsule that a sphere of a radius [m] sweeps along span (d,) [m] about `middle` (3,) [m]."""
    length = float(np.hypot.reduce(span))
    if length < 1e-9:
        return fcl.CollisionObject(fcl.Sphere(radius), fcl.Transform(middle))
    level = float(np.hypot(span[0], span[1]))
    c = span[0] / level if level > 0.0 else 1.0
    s = span[1] / level if level > 0.0 else 0.0
    flat = level / length
    rise = span[2] / length if len(span) == 3 else 0.0
    # The capsule's own axis is z: the last column.
    along_z = np.array([[-s, -c * rise, c * flat], [c, -s * rise, s * flat], [0.0, flat, rise]])
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
    return fcl.CollisionObject(
        shape, fcl.Transform(np.asarray(obstacle.rotation, dtype=float), np.asarray(obstacle.position, dtype=float))
    )
