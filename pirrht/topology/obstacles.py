"""Find topological obstacles: connected components of the obstacles inflated by the robot's radius.

Solids that the robot cannot pass between are one obstacle; a component that reaches the border cannot be encircled and
has no marker. An inflated shape P_i is the set of planar points p with d_i(p) at most the robot's radius; d_i, the
distance from a convex solid, is convex, and so is every minimisation below.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Kind, Obstacle
from pirrht.topology.tuning import TUNING

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Component:
    """Solids the robot cannot pass between."""

    members: tuple[int, ...]  # indices into scene.obstacles, in file order
    names: tuple[str, ...]  # their names
    marker: Array | None  # (2,) point that signatures wind around [m]; None when the border is joined
    joins_border: bool  # whether the robot cannot pass between the component and the border


def components(collision: Collision) -> tuple[Component, ...]:
    """Topological obstacles of a world, markers (2,) [m], ordered by their first member; without those out of reach.

    A common point of two inflated shapes certifies a joint. A gap micrometres too narrow may count as a passage.
    """
    planar = _Planar(collision)
    root = list(range(len(planar.obstacles)))
    for i, j in planar.candidates():
        if _find(root, i) != _find(root, j) and planar.meet(i, j):
            first, last = sorted((_find(root, i), _find(root, j)))
            root[last] = first
    groups: dict[int, list[int]] = {}
    for i in range(len(root)):
        groups.setdefault(_find(root, i), []).append(i)
    found = (_component(planar, members) for members in groups.values())
    return tuple(component for component in found if component is not None)


def continued(
    parts: Sequence[Component], before: Sequence[Component], collision: Collision, named: int
) -> tuple[Component, ...]:
    """Return the components of a changed world with a marker (2,) [m], in the order of earlier ones, then new ones.

    An earlier marker stays while an inflated solid covers it: signatures may wind around any point of a component, and
    around two of one. Else it is put outside of the workspace, where no path winds around it, until a later component
    takes its number. So turns about all that stays, and names of classes, keep their meaning. `parts` are the
    components now, `before` those that name the classes so far, of which `named` keep their number even if they are
    gone.
    """
    radius, (low, high) = collision.footprint.radius, collision.extents()
    part_of = {i: part for part in parts for i in part.members}

    def cover(marker: Array) -> Component | None:
        """The component in which it lies."""
        near = np.flatnonzero(np.all((low - radius <= marker) & (marker <= high + radius), axis=1)).tolist()
        found = (i for i in near if collision.obstacle_distance(i, marker[None])[0] <= radius)
        return next((part_of[i] for i in found if i in part_of), None)

    lower, upper = collision.world.lower, collision.world.upper
    gone = Component(members=(), names=(), marker=2.0 * upper - lower, joins_border=False)
    covers = [None if old.marker is None else cover(old.marker) for old in before]
    new = iter([part for part in parts if part.marker is not None and part not in covers])
    found = []
    for old, part in zip(before, covers, strict=True):
        if part is not None:
            found.append(replace(part, marker=old.marker))
        else:
            found.append(gone if old.members else next(new, gone))
    found += new
    while len(found) > named and not found[-1].members:
        found.pop()
    return tuple(found)


def _component(planar: _Planar, members: list[int]) -> Component | None:
    border = any(planar.joins_border(i) for i in members)
    if not border and not any(planar.within(i) for i in members):
        return None
    marker = None
    if not border:
        areas = np.array([projected_area(planar.obstacles[i]) for i in members])
        largest = members[int(np.flatnonzero(areas >= areas.max() * (1 - 1e-9))[0])]
        marker = planar.center(largest)
    return Component(
        members=tuple(members),
        names=tuple(planar.obstacles[i].name for i in members),
        marker=marker,
        joins_border=border,
    )


def projected_area(obstacle: Obstacle) -> float:
    """Area of the convex hull of a solid seen from above [m^2]."""
    a, b, c = (float(s) for s in obstacle.size)
    up = obstacle.rotation[2]  # the vertical in the solid's own frame
    lean = float(np.hypot(up[0], up[1]))
    match obstacle.kind:
        case Kind.BOX:
            return float(4 * np.abs(up) @ np.array([b * c, a * c, a * b]))
        case Kind.CYLINDER:
            return float(np.pi * a * a * abs(up[2]) + 4 * a * b * lean)
        case Kind.SPHERE:
            return float(np.pi * a * a)
        case Kind.CAPSULE:
            return float(np.pi * a * a + 4 * a * b * lean)
        case Kind.ELLIPSOID:
            return float(np.pi * np.linalg.norm(up * np.array([b * c, a * c, a * b])))
        case Kind.MESH:
            assert obstacle.vertices is not None
            p, q, r = obstacle.vertices[obstacle.faces].swapaxes(0, 1)
            return float(0.25 * np.abs(np.cross(q - p, r - p) @ up).sum())  # each point is covered twice


class _Planar:
    """The inflated shapes of one world and the questions asked about them."""

    def __init__(self, collision: Collision) -> None:
        self.collision, self.world, self.radius = collision, collision.world, collision.footprint.radius
        self.obstacles = self.world.obstacles
        low, high = collision.extents()
        self.low, self.high = low - self.radius, high + self.radius
        # the distance from an ellipsoid is uncertain by micrometres, so its slope takes a longer lever
        rough = np.array([o.kind is Kind.ELLIPSOID for o in self.obstacles], dtype=bool)
        self.offset = np.where(rough, 0.04, 1e-4) * self.radius
        self.doubt = np.where(rough, 1e-3, 1e-6)  # possible error of a slope

    def distance(self, i: int, point: Array) -> float:
        """d_i at a planar point (2,) [m]."""
        return float(self.collision.obstacle_distance(i, point[None])[0])

    def candidates(self) -> list[tuple[int, int]]:
        """Pairs whose inflated bounding rectangles overlap, found in their order along x."""
        order = np.argsort(self.low[:, 0], kind="stable")
        lows = self.low[order, 0]
        pairs = []
        for position, i in enumerate(order.tolist()):
            later = order[position + 1 : int(np.searchsorted(lows, self.high[i, 0], side="right"))]
            overlap = (self.low[later, 1] <= self.high[i, 1]) & (self.high[later, 1] >= self.low[i, 1])
            pairs += [(min(i, j), max(i, j)) for j in later[overlap].tolist()]
        return sorted(pairs)

    def meet(self, i: int, j: int) -> bool:
        """Return whether P_i and P_j intersect, by the centre-of-gravity method.

        It asks the centroid c of what is left of the common rectangle; if d(c) exceeds the radius, convexity excludes
        all q with d(c) + slope (q - c) > radius. Each round takes at least 37 % of the area.
        """
        low, high = np.maximum(self.low[i], self.low[j]), np.minimum(self.high[i], self.high[j])
        polygon = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        for _ in range(TUNING.cut_rounds):
            x, y, area = _centroid(polygon)
            excess = {k: self.distance(k, np.array([x, y])) - self.radius for k in (i, j)}
            if max(excess.values()) <= 0:
                return True
            size = max(abs(p - x) + abs(q - y) for p, q in polygon)
            for k in (i, j):
                if excess[k] > 0:
                    a, b = self.slope(k, x, y)
                    polygon = _clipped(polygon, a, b, a * x + b * y - excess[k] + min(self.doubt[k] * size, excess[k]))
            if len(polygon) < 3 or area < 1e-18:
                return False
        return False

    def slope(self, i: int, x: float, y: float) -> tuple[float, float]:
        """Gradient of d_i at a planar point."""
        h = self.offset[i]
        east, west, north, south = self.collision.obstacle_distance(
            i, np.array([[x + h, y], [x - h, y], [x, y + h], [x, y - h]])
        ).tolist()
        return (east - west) / (2 * h), (north - south) / (2 * h)

    def joins_border(self, i: int) -> bool:
        """Return whether P_i meets a side of the workspace."""
        lower, upper = self.world.lower, self.world.upper
        if np.any(self.low[i] > upper) or np.any(self.high[i] < lower):
            return False
        for axis in (0, 1):
            other = 1 - axis
            a, b = max(lower[other], self.low[i, other]), min(upper[other], self.high[i, other])
            for level in (lower[axis], upper[axis]):
                if not self.low[i, axis] <= level <= self.high[i, axis]:
                    continue
                side = np.zeros(2)
                side[axis] = level

                def along(t: float, side: Array = side, other: int = other) -> float:
                    side[other] = t
                    return self.distance(i, side)

                if _least(along, a, b, self.radius)[1] <= self.radius:
                    return True
        return False

    def within(self, i: int) -> bool:
        """Return whether P_i, known not to meet the border, is inside the workspace and not empty."""
        if np.any(self.low[i] > self.world.upper) or np.any(self.high[i] < self.world.lower):
            return False
        point = self.center(i)
        return self.world.contains(point) and self.distance(i, point) <= self.radius

    def center(self, i: int) -> Array:
        """The solid's centre seen from above, (2,) [m]; if that is outside P_i, where d_i is least."""
        center = np.array(self.obstacles[i].position[:2], dtype=float)
        if self.distance(i, center) <= self.radius:
            return center
        (left, low), (right, high) = self.low[i], self.high[i]

        def column(x: float) -> tuple[float, float]:
            return _least(lambda y: self.distance(i, np.array([x, y])), low, high, 0.0)

        x = _least(lambda x: column(x)[1], left, right, 0.0)[0]
        return np.array([x, column(x)[0]])


def _least(f: Callable[[float], float], a: float, b: float, enough: float) -> tuple[float, float]:
    """Minimise a convex function on [a, b], or down to `enough`, by golden sections: place and value."""
    c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_c, at_d = f(c), f(d)
    while b - a > 1e-9 and min(at_c, at_d) > enough:
        if at_c <= at_d:
            b, d, at_d = d, c, at_c
            c = b - _GOLDEN * (b - a)
            at_c = f(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + _GOLDEN * (b - a)
            at_d = f(d)
    return (c, at_c) if at_c <= at_d else (d, at_d)


def _find(root: list[int], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


def _centroid(polygon: list[tuple[float, float]]) -> tuple[float, float, float]:
    """Centroid and area of a convex polygon; the mean of its corners where it has no area."""
    x0, y0 = polygon[0]
    area = x = y = 0.0
    for (px, py), (qx, qy) in pairwise(polygon[1:]):
        triangle = 0.5 * ((px - x0) * (qy - y0) - (py - y0) * (qx - x0))
        area += triangle
        x += triangle * (px + qx - 2 * x0) / 3
        y += triangle * (py + qy - 2 * y0) / 3
    if area < 1e-20:
        return sum(p for p, _ in polygon) / len(polygon), sum(q for _, q in polygon) / len(polygon), 0.0
    return x0 + x / area, y0 + y / area, area


def _clipped(polygon: list[tuple[float, float]], a: float, b: float, c: float) -> list[tuple[float, float]]:
    """The part of a convex polygon where a x + b y <= c."""
    kept = []
    heights = [a * x + b * y - c for x, y in polygon]
    for k, (x, y) in enumerate(polygon):
        before = heights[k - 1]
        if (before > 0) != (heights[k] > 0):
            t = before / (before - heights[k])
            px, py = polygon[k - 1]
            kept.append((px + t * (x - px), py + t * (y - py)))
        if heights[k] <= 0:
            kept.append((x, y))
    return kept
