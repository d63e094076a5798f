"""Describe the shape of a robot seen from above: a disc, or a convex polygon that turns with its heading."""

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.geometry.checks import number
from pirrht.geometry.tuning import TUNING

Corners = tuple[tuple[float, float], ...]
CENTRE: Corners = ((0.0, 0.0),)


@dataclass(frozen=True, slots=True)
class Footprint:
    """The shape as which a robot plans, in its own frame: the hull of corners, grown by a radius.

    The origin is the robot's reference point, which its state places; the x-axis is its heading. A disc has one corner,
    the origin. SceneError: the corners have no inside, are not convex or clockwise, or the origin lies outside.

    Attributes:
        corners: of the hull, counter-clockwise [m].
        rounding: by which the hull is grown [m]: radius of a disc, safety margin of a polygon.
        height: of the slice through the robot in which it meets obstacles, above the ground [m].

    Examples:
        >>> from pirrht import Footprint
        >>> cart = Footprint.rectangle(1.0, 0.4, 0.2)
        >>> cart
        Footprint(1 x 0.4 m)
        >>> cart.outline.tolist()  # its middle is 0.2 m ahead of the reference point
        [[-0.3, -0.2], [0.7, -0.2], [0.7, 0.2], [-0.3, 0.2]]
        >>> round(cart.reach, 3), cart.inscribed, cart.is_disc
        (0.728, 0.2, False)
        >>> Footprint.disc(0.3)
        Footprint(disc of 0.3 m)
    """

    corners: Corners = CENTRE
    rounding: float = 0.0
    height: float = TUNING.robot_height

    def __post_init__(self) -> None:
        if not isinstance(self.corners, tuple) or self.corners != CENTRE:
            object.__setattr__(self, "corners", tuple((float(x), float(y)) for x, y in _checked(self.corners)))

    @classmethod
    def disc(cls, radius: float, *, height: float = TUNING.robot_height) -> "Footprint":
        """Make the footprint of a robot that is round [m]; SceneError: the radius is not positive."""
        return cls(CENTRE, number(radius, "the robot radius", "a positive number [m]"), height)

    @classmethod
    def rectangle(
        cls, length: float, width: float, offset: float = 0.0, *, height: float = TUNING.robot_height
    ) -> "Footprint":
        """Make a rectangle, `length` along the heading, whose middle lies `offset` ahead of the reference point [m].

        SceneError: a size is not positive, or the reference point lies outside.
        """
        across = 0.5 * number(width, "the width of the footprint", "a positive number [m]")
        half = 0.5 * number(length, "the length of the footprint", "a positive number [m]")
        if not abs(offset) < half:
            raise SceneError(
                f"the offset is {offset:g} m, which puts the reference point outside of the footprint; one between "
                f"{-half:g} and {half:g} m works"
            )
        back, front = offset - half, offset + half
        return cls.polygon([(back, -across), (front, -across), (front, across), (back, across)], height=height)

    @classmethod
    def polygon(cls, points: ArrayLike, *, height: float = TUNING.robot_height) -> "Footprint":
        """Make a convex polygon of corners (k, 2), counter-clockwise around the reference point, the origin [m].

        SceneError: it has no inside, is not convex or clockwise, or the reference point lies outside.
        """
        return cls(points, 0.0, height)  # type: ignore[arg-type]  # checked, and made of tuples, like all corners

    def __repr__(self) -> str:
        low, high = np.min(self.corners, axis=0), np.max(self.corners, axis=0)
        grown = f", grown by {self.rounding:.3g} m" if self.rounding else ""

        if self.is_disc:
            return f"Footprint(disc of {self.rounding:.3g} m)"
        sides = f"{high[0] - low[0]:.3g} x {high[1] - low[1]:.3g} m"
        return f"Footprint({sides if self.is_rectangle else f'polygon of {len(self.corners)} corners'}{grown})"

    @property
    def is_disc(self) -> bool:
        """Return whether it is a disc about the reference point, so that the heading does not matter."""
        return len(self.corners) == 1

    @property
    def kind(self) -> str:
        """Return the name of its kind."""
        return "disc" if self.is_disc else "polygon"

    @property
    def is_rectangle(self) -> bool:
        """Return whether its corners are those of a rectangle along the heading."""
        return len(self.corners) == 4 and [*(len({point[k] for point in self.corners}) for k in (0, 1))] == [2, 2]

    @property
    def hull(self) -> Array:
        """Return the corners, (k, 2) [m]."""
        return np.array(self.corners)

    @property
    def inscribed(self) -> float:
        """Return the radius of the largest disc about the reference point that lies inside [m]."""
        return self.rounding + _measures(self.corners)[0]

    @property
    def radius(self) -> float:
        """Return the inscribed radius [m]: that of the disc for which a passage must have room at any heading."""
        return self.inscribed

    @property
    def reach(self) -> float:
        """Return the distance of its farthest point from the reference point [m]."""
        return self.rounding + _measures(self.corners)[1]

    @property
    def outline(self) -> Array:
        """Return the curve around it, counter-clockwise from corner to corner, (n, 2) [m]; round parts are arcs."""
        hull = self.hull
        if not self.rounding:
            return hull
        along = np.roll(hull, -1, axis=0) - hull
        begin = np.roll(np.arctan2(along[:, 1], along[:, 0]), 1) - 0.5 * np.pi  # of the normals around each corner
        turn = np.full(1, 2.0 * np.pi) if self.is_disc else np.mod(np.roll(begin, -1) - begin, 2.0 * np.pi)
        arcs = []
        for corner, first, angle in zip(hull, begin, turn, strict=True):
            pieces = max(1, math.ceil(angle * TUNING.outline_pieces / (2.0 * np.pi) - 1e-9))
            angles = first + angle * np.arange(pieces if self.is_disc else pieces + 1) / pieces
            arcs.append(corner + self.rounding * np.column_stack((np.cos(angles), np.sin(angles))))
        return np.concatenate(arcs)

    def at(self, pose: Array) -> Array:
        """Return its outline at poses x, y, heading [m, m, rad], (..., 3) -> (..., n, 2) [m]."""
        return placed(self.outline, pose)

    def grown(self, margin: float) -> "Footprint":
        """Return the footprint that is larger by a margin [m] all around; less than 0 takes off what was added."""
        return replace(self, rounding=self.rounding + margin)


@cache
def _measures(corners: Corners) -> tuple[float, float]:
    """Return how near to the origin the edges of a hull come, and how far from it a corner lies [m]."""
    hull = np.array(corners)
    return 0.0 if len(corners) == 1 else -float(depths(hull, np.zeros((1, 2)))[0]), float(np.hypot(*hull.T).max())


def placed(points: Array, pose: Array) -> Array:
    """Return points (n, 2) [m] of the robot's frame where poses (..., 3) [m, m, rad] put them, (..., n, 2)."""
    pose = np.asarray(pose, dtype=float)[..., None, :]
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = points.T
    return np.stack((pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y), axis=-1)


def depths(hull: Array, points: Array) -> Array:
    """Return signed distances of points (..., 2) from the nearest edge's line of a convex hull (k, 2); < 0 inside."""
    along = np.roll(hull, -1, axis=0) - hull
    normal = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(*along.T)[:, None]
    found: Array = np.einsum("...ki,ki->...k", points[..., None, :] - hull, normal).max(axis=-1)
    return found


def _checked(points: ArrayLike) -> Array:
    """Return the corners of a polygon (k, 2) [m], or refuse them."""
    form = "give the corners of a convex polygon in their counter-clockwise order around the robot's reference point"
    try:
        corners = np.array(points, dtype=float)
    except (TypeError, ValueError):
        corners = np.full((0, 2), np.nan)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.all(np.isfinite(corners)):
        raise SceneError(f"the footprint is no polygon of three or more corners x, y [m]; {form}")
    if np.abs(corners).max() > TUNING.widest_footprint:
        raise SceneError(
            f"the footprint has a corner {np.abs(corners).max():g} m away; at most {TUNING.widest_footprint:g} m works"
        )
    along = np.roll(corners, -1, axis=0) - corners
    following = np.roll(along, -1, axis=0)
    bend = along[:, 0] * following[:, 1] - along[:, 1] * following[:, 0]
    size = np.hypot(*along.T)
    if size.min() < TUNING.smallest:
        raise SceneError(f"two corners of the footprint are the same; {form}")
    turns = np.arctan2(bend, np.einsum("ki,ki->k", along, following)).sum() / (2.0 * np.pi)
    if np.any(bend <= TUNING.askew * size * np.roll(size, -1)) or round(turns) != 1:
        straight = np.abs(bend) <= TUNING.askew * size * np.roll(size, -1)
        order = "clockwise" if np.all(bend < 0.0) else "straight at a corner" if straight.any() else "not convex"
        raise SceneError(f"the footprint is {order}; {form}")
    if depths(corners, np.zeros((1, 2)))[0] > -TUNING.smallest:
        raise SceneError(f"the reference point (0, 0) is not inside of the footprint; {form}")
    return corners


def cover(footprint: Footprint, excess: float) -> Array:
    """Cover a polygon by discs x, y, radius [m], (k, 3), largest first: their union contains it.

    No disc reaches more than `excess` [m] beyond the polygon. Each is the largest disc inside that touches an edge at
    some place, larger by the excess; they are chosen greedily until they contain the edges, then the inside.
    """
    if footprint.is_disc:
        return np.array([[0.0, 0.0, footprint.rounding]])
    discs: Array = _covering(tuple(map(tuple, footprint.hull.tolist())), excess).copy()
    discs[:, 2] += footprint.rounding
    return discs[np.argsort(-discs[:, 2], kind="stable")]


@lru_cache(maxsize=8)
def _covering(corners: tuple[tuple[float, float], ...], excess: float) -> Array:
    """Cover a hull; a robot that maps asks for the same discs again and again."""
    hull = np.array(corners)
    slack = TUNING.cover_slack * excess
    along = np.roll(hull, -1, axis=0) - hull
    size = np.hypot(*along.T)
    normal = np.column_stack((-along[:, 1], along[:, 0])) / size[:, None]
    near = 0.5 * np.linspace(0.0, 1.0, TUNING.cover_candidates) ** 2  # shares of an edge, denser near its ends
    centres, edges = [], []
    for corner, side, length, inward in zip(hull, along, size, normal, strict=True):
        places = corner + np.concatenate((near, 1.0 - near))[:, None] * side
        # The disc that touches this edge here touches edge j when its radius is the distance there over 1 - n.n_j.
        away = np.einsum("pki,ki->pk", places[:, None] - hull, normal)
        apart = 1.0 - normal @ inward
        centres.append(
            places + np.where(apart > 1e-9, away / np.maximum(apart, 1e-9), np.inf).min(axis=1)[:, None] * inward
        )
        edges.append(corner + np.linspace(0.0, 1.0, math.ceil(length / slack) + 1)[:, None] * side)
    candidates = np.concatenate(centres)
    samples = np.concatenate(edges)
    radii = excess - depths(hull, candidates)
    holds = np.hypot(*np.moveaxis(candidates[:, None] - samples, -1, 0)) <= (radii - 0.5 * slack)[:, None]
    chosen = []
    left = np.ones(len(samples), dtype=bool)
    first = [*np.flatnonzero((samples[:, None] == hull).all(axis=2).any(axis=1))]  # corners, by their largest discs
    while left.any():
        gain = np.count_nonzero(holds & left, axis=1) if not first else np.where(holds[:, first.pop()], radii, 0.0)
        best = int(np.argmax(gain + radii / radii.max() * 0.5))
        if np.any(holds[best] & left):
            chosen.append([*candidates[best], radii[best]])
            left &= ~holds[best]
    return _filled(hull, np.array(chosen), excess, slack)


def _filled(hull: Array, discs: Array, excess: float, slack: float) -> Array:
    """Add discs until they contain the inside of a hull: squares that are in no disc are divided, then covered."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    cells, half = 0.5 * (low + high)[None], 0.5 * float((high - low).max())
    while len(cells):
        diagonal = math.sqrt(2.0) * half
        inside = depths(hull, cells) < diagonal
        held = (np.hypot(*np.moveaxis(cells[:, None] - discs[:, :2], -1, 0)) + diagonal <= discs[:, 2]).any(axis=1)
        cells = cells[inside & ~held]
        if diagonal < 0.25 * slack and len(cells):
            depth = depths(hull, cells)
            deepest = int(np.argmin(depth))
            discs = np.vstack((discs, [*cells[deepest], excess - depth[deepest]]))
            continue
        half *= 0.5
        cells = (cells[:, None] + half * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])).reshape(-1, 2)
    return discs
