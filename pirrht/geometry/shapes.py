"""Distances from boxes, cylinders, spheres and capsules in closed form, and the two nearest of many of them.

FCL computes the same numbers one at a time, through four Python calls; a clearance field needs a million.
`Collision` uses a closed form only where FCL has confirmed it for the solid at hand.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.scene import Kind, Obstacle

FORMS = (Kind.BOX, Kind.CYLINDER, Kind.SPHERE, Kind.CAPSULE)


class Solids(NamedTuple):
    """Obstacles as arrays."""

    form: NDArray[np.int64]  # (M,) place in FORMS, -1 for a solid without a closed form
    size: Array  # (M, 3) MuJoCo's sizes [m]
    position: Array  # (M, 3) centres [m]
    rotation: Array  # (M, 3, 3) body axes in world coordinates
    low: Array  # (M, 2) rectangles around them seen from above [m]
    high: Array  # (M, 2)

    @classmethod
    def of(cls, obstacles: Sequence[Obstacle], low: Array, high: Array) -> Solids:
        """Gather obstacles and their rectangles."""
        M = len(obstacles)
        return cls(
            np.array([FORMS.index(o.kind) if o.kind in FORMS else -1 for o in obstacles], dtype=np.int64),
            np.array([o.size for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.position for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.rotation for o in obstacles], dtype=float).reshape(M, 3, 3),
            np.ascontiguousarray(low),
            np.ascontiguousarray(high),
        )


@inlined
def _outside(form, a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Distance from a solid to a point in its own frame, at most 0 inside [m]."""
    if form == 0:
        x, y, z = max(abs(x) - a, 0.0), max(abs(y) - b, 0.0), max(abs(z) - c, 0.0)
        return math.sqrt(x * x + y * y + z * z)
    if form == 1:
        r, h = max(math.sqrt(x * x + y * y) - a, 0.0), max(abs(z) - b, 0.0)
        return math.sqrt(r * r + h * h)
    if form == 3:
        z = max(abs(z) - b, 0.0)
    return math.sqrt(x * x + y * y + z * z) - a


@kernel
def distance_from(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Distance from solid m, which has a closed form, to a point [m]; 0 inside."""
    dx, dy, dz = x - solids.position[m, 0], y - solids.position[m, 1], z - solids.position[m, 2]
    R, size = solids.rotation[m], solids.size[m]
    d = _outside(
        solids.form[m], size[0], size[1], size[2],
        R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz,
        R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz,
        R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz,
    )  # fmt: skip
    return max(d, 0.0)


@kernel
def nearest_two(solids, members, group, points, rows, height, least, first, second, which):  # type: ignore[no-untyped-def]
    """Improve distances to the nearest and second-nearest group by those from `members`, for some rows of points.

    Args:
        members: solids with a closed form.
        group: (M,) the group of each solid.
        points: (k, 2) [m].
        rows: those of the points that are asked.
        height: of all points [m].
        least: distances up to this count as 0 [m].
        first, second, which: (k,) the best so far; changed in place.
    """
    low, high = solids.low, solids.high
    for i in rows:
        x, y = points[i, 0], points[i, 1]
        for m in members:
            dx = max(max(low[m, 0] - x, x - high[m, 0]), 0.0)
            dy = max(max(low[m, 1] - y, y - high[m, 1]), 0.0)
            known = first[i] if group[m] == which[i] else second[i]
            if dx * dx + dy * dy >= known * known:
                continue
            d = distance_from(solids, m, x, y, height)
            if d <= least:
                d = 0.0
            if group[m] == which[i]:
                first[i] = min(d, first[i])
            elif d < first[i]:
                first[i], second[i], which[i] = d, first[i], group[m]
            else:
                second[i] = min(d, second[i])


def tiles(points: Array, width: float) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
    """Points (k, 2) by square tiles: rows, and the least and greatest corner of what lies in the tile."""
    if not len(points):
        return
    place = np.floor((points - points.min(axis=0)) / width).astype(np.int64)
    number = place[:, 0] * (place[:, 1].max() + 1) + place[:, 1]
    order = np.argsort(number, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(number[order])) + 1):
        yield rows, points[rows].min(axis=0), points[rows].max(axis=0)
