"""Find topological obstacles: connected components of the obstacles inflated by the robot's radius.

Solids that the robot cannot pass between are one obstacle; a component that reaches the border cannot be encircled and
has no marker. An inflated shape P_i is the set of planar points p with d_i(p) at most the robot's radius; d_i, the
distance from a convex solid, is convex, and so is every minimisation below.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Kind, Obstacle
from pirrht.topology.tuning import TUNING

NOWHERE = np.full(2, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Component:
    """Solids the robot cannot pass between."""

    members: tuple[int, ...]  # indices into scene.obstacles, in file order
    names: tuple[str, ...]  # their names
    marker: Array | None  # (d,) point that signatures wind around [m]; None: no path winds around it


def components(collision: Collision) -> tuple[Component, ...]:
    """Topological obstacles of a world, markers (2,) [m], ordered by their first member; without those out of reach.

    A common point of two inflated shapes certifies a joint. A gap micrometres too narrow may count as a passage.
    """
    planar = _Planar(collision)
    label = collision.first.copy()

    def join(i: int, j: int) -> None:
        first, last = sorted((label[i], label[j]))
        label[label == last] = first

    unsure = list[tuple[int, IntArray]]()
    for i, near in planar.candidates():
        sure = planar.sure(i, near)
        unsure.append((i, near[~sure]))
        for j in near[sure & (label[near] != label[i])].tolist():
            join(i, j)
    for i, near in unsure:
        for j in near[label[near] != label[i]].tolist():
            if label[i] != label[j] and planar.meeting_point(*sorted((i, j))) is not None:
                join(i, j)
    groups = (np.flatnonzero(label == first).tolist() for first in np.unique(label))
    return tuple(
        component for component in (_component(planar, members) for members in groups) if component is not None
    )


def continued(
    parts: Sequence[Component], before: Sequence[Component], collision: Collision, named: int, earlier: Collision
) -> tuple[tuple[Component, ...], tuple[int, ...]]:
    """Return the components of a changed world with a marker (2,) [m], in the order of earlier ones, then new ones.

    An earlier marker stays while an inflated solid covers it: signatures may wind around any point of a component, and
    around two of one. If none does, but some of the component is left, the marker moves there; the second result has
    the numbers of those. Else it is put outside of the workspace, where no path winds around it, until a later
    component takes its number. So turns about all that stays, and names of classes, keep their meaning. `parts` are
    those of now, `before` those that name the classes so far, of which `named` keep their number even if they are gone;
    `earlier` has their solids.
    """
    radius, (low, high) = collision.footprint.radius, collision.extents()
    part_of = {i: part for part in parts for i in part.members}

    def cover(marker: Array) -> Component | None:
        near = np.flatnonzero(np.all((low - radius <= marker) & (marker <= high + radius), axis=1)).tolist()
        found = (i for i in near if collision.obstacle_distance(i, marker[None])[0] <= radius)
        return next((part_of[i] for i in found if i in part_of), None)

    gone = Component(members=(), names=(), marker=2.0 * collision.world.upper - collision.world.lower)
    covers = [None if old.marker is None else cover(old.marker) for old in before]
    kept = [
        None if part is None else replace(part, marker=old.marker) for old, part in zip(before, covers, strict=True)
    ]
    taken = [part for part in covers if part is not None]
    moved = []
    for number, old in enumerate(before):
        if kept[number] is None and (heir := _heir(old, parts, taken, collision, earlier)) is not None:
            part, place = heir
            kept[number] = replace(part, marker=place)
            taken.append(part)
            moved.append(number)
    new = [part for part in parts if part.marker is not None and part not in taken]
    return numbered(before, kept, new, gone, named), tuple(moved)


def _heir(
    old: Component, parts: Sequence[Component], taken: Sequence[Component], collision: Collision, earlier: Collision
) -> tuple[Component, Array] | None:
    """Return what is left of a component that lost its marker, and the nearest place in it (2,) [m].

    Parts that are `taken` already or that reach the border are no heirs; None: there is none.
    """
    if old.marker is None or not old.members:
        return None
    low, high = (side[list(old.members)] for side in earlier.extents())
    best: tuple[float, Component, Array] | None = None
    for part in parts:
        if part.marker is None or part in taken:
            continue
        for i in part.members:
            place = collision.world.obstacles[i].position[:2]
            away = float(np.hypot(*(place - old.marker)))
            inside = np.any(np.all((low <= place) & (place <= high), axis=1))
            if inside and (best is None or away < best[0]):
                best = away, part, np.array(place, dtype=float)
    return None if best is None else best[1:]


def numbered(
    before: Sequence[Component], kept: Sequence[Component | None], new: Sequence[Component], gone: Component, named: int
) -> tuple[Component, ...]:
    """Return earlier components that are `kept`, in their order, then new ones, also in the places of what is `gone`.

    The first `named` keep their number even if they are gone.
    """
    later = iter(new)
    found = [part or (gone if old.members else next(later, gone)) for old, part in zip(before, kept, strict=True)]
    found += later
    while len(found) > named and not found[-1].members:
        found.pop()
    return tuple(found)


def _component(planar: "_Planar", members: list[int]) -> Component | None:
    distinct = np.unique(planar.collision.first[members]).tolist()
    inside = [i for i in distinct if planar.enters(i)]
    if not inside:
        return None
    joins_border = any(map(planar.leaves, inside))
    areas = np.prod(planar.high[members] - planar.low[members], axis=1)
    largest = members[int(np.flatnonzero(areas >= areas.max() * (1 - 1e-9))[0])]
    names = tuple(planar.obstacles[i].name for i in members)
    return Component(members=tuple(members), names=names, marker=None if joins_border else planar.center(largest))


class _Planar:
    """The inflated shapes of one world and the questions asked about them."""

    def __init__(self, collision: Collision) -> None:
        self.collision, self.world, self.radius = collision, collision.world, collision.footprint.radius
        self.obstacles = self.world.obstacles
        low, high = collision.extents()
        self.low = low - self.radius
        self.high = high + self.radius
        # the distance from an ellipsoid is uncertain by micrometres, so its slope takes a longer lever
        rough = np.array([o.kind is Kind.ELLIPSOID for o in self.obstacles], dtype=bool)
        self.offset = np.where(rough, 0.04, 1e-4) * self.radius
        self.doubt = np.where(rough, 1e-3, 1e-6)  # possible error of a slope
        self.upright = np.array([self._is_upright(o) for o in self.obstacles], dtype=bool)
        self.exact = self.upright & (not self.world.waivers)  # whether the bounds are those of the inflated shape

    def _is_upright(self, o: Obstacle) -> bool:
        """Tell whether a solid is a box along the axes with the robot's centre between its bottom and its top."""
        level = abs(o.position[2] - self.collision.footprint.height) < o.size[2]
        return bool(o.kind is Kind.BOX and level and np.array_equal(o.rotation, np.eye(3)))

    def distance(self, i: int, *point: float) -> float:
        """d_i at a planar point [m]."""
        return float(self.collision.obstacle_distance(i, np.array([point]))[0])

    def candidates(self) -> Iterator[tuple[int, IntArray]]:
        """Find every pair of distinct solids whose inflated rectangles overlap: each solid with others (k,)."""
        distinct = np.unique(self.collision.first)
        order = distinct[np.argsort(self.low[distinct, 0], kind="stable")]
        lows = self.low[order, 0]
        for position, i in enumerate(order.tolist()):
            later = order[position + 1 : int(np.searchsorted(lows, self.high[i, 0], side="right"))]
            yield i, later[(self.low[later, 1] <= self.high[i, 1]) & (self.high[later, 1] >= self.low[i, 1])]

    def sure(self, i: int, near: IntArray) -> BoolArray:
        """Check which solids near (k,) the i-th one certainly joins, (k,): upright boxes both, by one point of both.

        The point is the middle of the rectangle that is common to their bounds, if the whole margin counts there.
        Cells of a map and walls of scans are such boxes.
        """
        middle = 0.5 * (np.maximum(self.low[near], self.low[i]) + np.minimum(self.high[near], self.high[i]))
        sure: BoolArray = self.upright[near] & self.upright[i]
        for low, high in ((self.low[near], self.high[near]), (self.low[i], self.high[i])):
            sure &= np.hypot(*np.maximum(np.maximum(low - middle, middle - high) + self.radius, 0.0).T) < self.radius
        if sure.any():
            sure &= self.collision.waived(middle) == 0.0
        return sure

    def common(
        self, i: int, j: int, lower: Array = -NOWHERE, upper: Array = NOWHERE, shrunk: float = 0.0
    ) -> Array | None:
        """Find a point (2,) of P_i and P_j, shrunk [m], between two corners (2,) [m]; None: no such.

        The centre-of-gravity method asks the centroid c of what is left of the common rectangle; if d(c) exceeds the
        radius, convexity excludes all q with d(c) + slope (q - c) > radius: at least 37 % of the area each time.
        """
        low = np.maximum.reduce([self.low[i], self.low[j], lower])
        high = np.minimum.reduce([self.high[i], self.high[j], upper])
        if np.any(low > high):
            return None
        polygon = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
        for _ in range(TUNING.cut_rounds):
            center, area = _centroid(polygon)
            excess = {k: self.distance(k, *center) - self.radius + shrunk for k in {i, j}}
            if max(excess.values()) <= 0:
                return center
            size = float(np.abs(polygon - center).sum(axis=1).max())
            for k, more in excess.items():
                if more > 0:
                    slope = self.slope(k, *center)
                    most = slope @ center - more + min(self.doubt[k] * size, more)
                    polygon = _clipped(polygon, polygon @ slope - most)
            if len(polygon) < 3 or area < 1e-18:
                break
        return None

    def meeting_point(self, i: int, j: int, lower: Array = -NOWHERE, upper: Array = NOWHERE) -> Array | None:
        """Find a common point (2,) as `common` does, of smaller shapes if less margin counts there."""
        point = self.common(i, j, lower, upper)
        less = 0.0 if point is None else float(self.collision.waived(point[None])[0])
        return point if less == 0.0 else self.common(i, j, lower, upper, less)

    def slope(self, i: int, x: float, y: float) -> Array:
        """Gradient of d_i at a planar point, (2,)."""
        h = self.offset[i]
        d = self.collision.obstacle_distance(i, np.array([[x + h, y], [x, y + h], [x - h, y], [x, y - h]]))
        return np.asarray((d[:2] - d[2:]) / (2 * h))

    def enters(self, i: int) -> bool:
        """Return whether some of P_i is in the workspace."""
        if self.upright[i] and self.world.contains(self.obstacles[i].position[:2]):
            return True
        return self.common(i, i, self.world.lower, self.world.upper) is not None

    def leaves(self, i: int) -> bool:
        """Return whether some of P_i is not in the workspace."""
        if self.exact[i]:
            return bool(np.any(self.low[i] < self.world.lower) or np.any(self.high[i] > self.world.upper))
        sides = [(-NOWHERE, np.where(axis, self.world.lower, np.inf)) for axis in np.eye(2, dtype=bool)]
        sides += [(np.where(axis, self.world.upper, -np.inf), NOWHERE) for axis in np.eye(2, dtype=bool)]
        return any(self.meeting_point(i, i, *side) is not None for side in sides)

    def center(self, i: int) -> Array:
        """The solid's centre seen from above, (2,) [m]; else a point of P_i, of the solid if there is one."""
        center = np.array(self.obstacles[i].position[:2], dtype=float)
        if self.distance(i, *center) <= self.radius:
            return center
        inside = self.common(i, i, shrunk=self.radius)
        return np.asarray(self.common(i, i) if inside is None else inside)


def _centroid(polygon: Array) -> tuple[Array, float]:
    """Centroid (2,) and area of a convex polygon (k, 2); the mean of its corners where it has no area."""
    p = polygon - polygon[0]
    q = np.roll(p, -1, axis=0)
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]  # twice the triangles
    twice = float(cross.sum())
    return (polygon.mean(axis=0), 0.0) if twice < 2e-20 else (polygon[0] + cross @ (p + q) / (3.0 * twice), 0.5 * twice)


def _clipped(polygon: Array, heights: Array) -> Array:
    """The part of a convex polygon (k, 2) where a linear function, known at its corners (k,), is at most 0."""
    kept = []
    for k, (corner, height) in enumerate(zip(polygon, heights, strict=True)):
        before = heights[k - 1]
        if (before > 0) != (height > 0):
            kept.append(polygon[k - 1] + before / (before - height) * (corner - polygon[k - 1]))
        if height <= 0:
            kept.append(corner)
    return np.array(kept).reshape(-1, 2)
