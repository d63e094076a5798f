"""Topological obstacles: connected components of the obstacles inflated by the robot's radius.

Where the robot cannot pass between two solids they are one obstacle, and a component that reaches the border cannot be
encircled, so it has no marker. An inflated shape P_i is the set of planar points p with d_i(p) <= robot radius; d_i is
the exact distance of a convex solid, so P_i is convex and so is every minimisation below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pirrht.collision import Collision
from pirrht.scene import Array, Kind, Obstacle, Scene

STEPS = 300  # subgradient steps before two inflated shapes count as apart
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Component:
    """Solids the robot cannot pass between."""

    members: tuple[int, ...]  # indices into scene.obstacles, in file order
    names: tuple[str, ...]  # their names
    marker: Array | None  # (2,) point that signatures wind around [m]; None when the border is joined
    joins_border: bool  # whether the robot cannot pass between the component and the border


def components(scene: Scene, collision: Collision) -> tuple[Component, ...]:
    """Topological obstacles of a scene, ordered by their first member; those out of the robot's reach are left out.

    A joint is certified by a common point of two inflated shapes. Gaps only micrometres narrower than the robot may go
    unnoticed; a gap that is wider never joins.
    """
    planar = _Planar(scene, collision)
    root = list(range(len(scene.obstacles)))
    for i, j in planar.candidates():
        if _find(root, i) != _find(root, j) and planar.meet(i, j):
            first, last = sorted((_find(root, i), _find(root, j)))
            root[last] = first
    groups: dict[int, list[int]] = {}
    for i in range(len(root)):
        groups.setdefault(_find(root, i), []).append(i)
    found = (_component(scene, planar, members) for members in groups.values())
    return tuple(component for component in found if component is not None)


def _component(scene: Scene, planar: _Planar, members: list[int]) -> Component | None:
    border = any(planar.joins_border(i) for i in members)
    if not border and not any(planar.within(i) for i in members):
        return None
    marker = None
    if not border:
        areas = np.array([projected_area(scene.obstacles[i]) for i in members])
        largest = members[int(np.flatnonzero(areas >= areas.max() * (1 - 1e-9))[0])]
        marker = planar.center(largest)
    return Component(
        members=tuple(members),
        names=tuple(scene.obstacles[i].name for i in members),
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
    """The inflated shapes of one scene and the questions asked about them."""

    def __init__(self, scene: Scene, collision: Collision) -> None:
        self.scene = scene
        self.collision = collision
        self.radius = scene.robot_radius
        low, high = collision.extents()
        self.low, self.high = low - self.radius, high + self.radius
        offset = (
            0.01 * self.radius
        )  # wide against FCL's errors, narrow against the curvature of inflated shapes
        self.star = offset * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=float)
        self.offset = offset

    def distance(self, i: int, point: Array) -> float:
        """d_i at a planar point (2,) [m]."""
        return float(self.collision.obstacle_distance(i, point[None])[0])

    def candidates(self) -> list[tuple[int, int]]:
        """Pairs whose inflated bounding rectangles overlap, found by a sweep along x."""
        order = np.argsort(self.low[:, 0], kind="stable")
        starts = self.low[order, 0]
        pairs = []
        for position, i in enumerate(order.tolist()):
            later = order[position + 1 : int(np.searchsorted(starts, self.high[i, 0], side="right"))]
            overlap = (self.low[later, 1] <= self.high[i, 1]) & (self.high[later, 1] >= self.low[i, 1])
            pairs += [(min(i, j), max(i, j)) for j in later[overlap].tolist()]
        return sorted(pairs)

    def meet(self, i: int, j: int) -> bool:
        """Whether P_i and P_j intersect: steps of Polyak's length down max(d_i, d_j) until it is at most the radius."""
        low, high = np.maximum(self.low[i], self.low[j]), np.minimum(self.high[i], self.high[j])
        point = 0.5 * (low + high)
        for _ in range(STEPS):
            d_i, d_j = self.distance(i, point), self.distance(j, point)
            worse, d = (i, d_i) if d_i >= d_j else (j, d_j)
            if d <= self.radius:
                return True
            near = self.collision.obstacle_distance(worse, point + self.star)
            slope = np.array([near[1] - near[2], near[3] - near[4]]) / (2 * self.offset)
            steepness = float(slope @ slope)
            if steepness < 1e-8:
                return False  # a level stretch above the radius: the shape is empty
            point = point - (d - self.radius) / steepness * slope
        return False

    def joins_border(self, i: int) -> bool:
        """Whether P_i meets a side of the workspace."""
        lower, upper = self.scene.lower, self.scene.upper
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
        """Whether P_i, known not to meet the border, is inside the workspace and not empty."""
        if np.any(self.low[i] > self.scene.upper) or np.any(self.high[i] < self.scene.lower):
            return False
        point = self.center(i)
        return self.scene.contains(point) and self.distance(i, point) <= self.radius

    def center(self, i: int) -> Array:
        """The solid's centre seen from above, (2,) [m]; where that is outside P_i, the nearest approach to the solid."""
        center = np.array(self.scene.obstacles[i].position[:2], dtype=float)
        if self.distance(i, center) <= self.radius:
            return center
        (left, low), (right, high) = self.low[i], self.high[i]

        def column(x: float) -> tuple[float, float]:
            return _least(lambda y: self.distance(i, np.array([x, y])), low, high, 0.0)

        x = _least(lambda x: column(x)[1], left, right, 0.0)[0]
        return np.array([x, column(x)[0]])


def _least(f: Callable[[float], float], a: float, b: float, enough: float) -> tuple[float, float]:
    """Golden-section search for where a convex function is least on [a, b], or at most `enough`: place and value."""
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
