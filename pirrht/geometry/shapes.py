"""Compute distances from boxes, cylinders, spheres and capsules in closed form.

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
from pirrht.geometry.scene import Kind, Obstacle
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel

PROBE = TUNING.probe
FORMS = (Kind.BOX, Kind.CYLINDER, Kind.SPHERE, Kind.CAPSULE)


class Solids(NamedTuple):
    """Obstacles as arrays."""

    form: NDArray[np.int64]  # (M,) index in FORMS, -1 for a solid without a closed form
    size: Array  # (M, 3) MuJoCo's sizes [m]
    position: Array  # (M, 3) centres [m]
    rotation: Array  # (M, 3, 3) body axes in world coordinates, as columns
    low: Array  # (M, 2) rectangles around them seen from above [m]
    high: Array  # (M, 2) [m]

    @classmethod
    def of(cls, obstacles: Sequence[Obstacle]) -> Solids:
        """Gather M obstacles into arrays (M, ...) [m]."""
        M = len(obstacles)
        boxes = np.array([_rectangle(o) for o in obstacles]).reshape(M, 2, 2)
        return cls(
            np.array([FORMS.index(o.kind) if o.kind in FORMS else -1 for o in obstacles], dtype=np.int64),
            np.array([o.size for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.position for o in obstacles], dtype=float).reshape(M, 3),
            np.array([o.rotation for o in obstacles], dtype=float).reshape(M, 3, 3),
            np.ascontiguousarray(boxes[:, 0]),
            np.ascontiguousarray(boxes[:, 1]),
        )


def _rectangle(obstacle: Obstacle) -> tuple[Array, Array]:
    """Return corners of an axis-parallel rectangle that contains the solid seen from above, 2 x (2,) [m]."""
    a, b, c = (float(s) for s in obstacle.size)
    if obstacle.kind is Kind.MESH:
        assert obstacle.vertices is not None
        low, high = obstacle.vertices.min(axis=0), obstacle.vertices.max(axis=0)
    else:
        high = {
            Kind.CYLINDER: np.array([a, a, b]),
            Kind.SPHERE: np.array([a, a, a]),
            Kind.CAPSULE: np.array([a, a, a + b]),
        }.get(obstacle.kind, np.array([a, b, c]))
        low = -high
    middle = obstacle.position + obstacle.rotation @ (0.5 * (low + high))
    extent = np.abs(obstacle.rotation) @ (0.5 * (high - low)) + PROBE
    return (middle - extent)[:2], (middle + extent)[:2]


@inlined
def outside(form, a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance from a solid to a point in its own frame, at most 0 inside [m]."""
    if form == 0:
        x, y, z = max(abs(x) - a, 0.0), max(abs(y) - b, 0.0), max(abs(z) - c, 0.0)
        return math.sqrt(x * x + y * y + z * z)
    if form == 1:
        r, h = max(math.sqrt(x * x + y * y) - a, 0.0), max(abs(z) - b, 0.0)
        return math.sqrt(r * r + h * h)
    if form == 3:
        z = max(abs(z) - b, 0.0)
    return math.sqrt(x * x + y * y + z * z) - a


@inlined
def _in_frame(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return a point (x, y, z) in solid m's own frame [m]."""
    dx, dy, dz = x - solids.position[m, 0], y - solids.position[m, 1], z - solids.position[m, 2]
    R = solids.rotation[m]
    return (
        R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz,
        R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz,
        R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz,
    )


@kernel
def distance_from(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance from solid m of `Solids`, which has a closed form, to a point (x, y, z) [m]; 0 inside."""
    size = solids.size[m]
    x, y, z = _in_frame(solids, m, x, y, z)
    return max(outside(solids.form[m], size[0], size[1], size[2], x, y, z), 0.0)


@inlined
def offset_of(form, a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the vector from a solid's nearest point to a point outside, in the solid's own frame [m]."""
    if form == 0:
        return x - min(max(x, -a), a), y - min(max(y, -b), b), z - min(max(z, -c), c)
    if form == 1:
        r = math.sqrt(x * x + y * y)
        share = 1.0 - a / r if r > a else 0.0
        return share * x, share * y, z - min(max(z, -b), b)
    if form == 3:
        z = z - min(max(z, -b), b)
    share = 1.0 - a / math.sqrt(x * x + y * y + z * z)
    return share * x, share * y, share * z


@kernel
def offset_from(solids, m, x, y, z):  # type: ignore[no-untyped-def]
    """Return the planar vector (x, y) from solid m's nearest point to a point (x, y, z) outside [m]."""
    size, R = solids.size[m], solids.rotation[m]
    x, y, z = _in_frame(solids, m, x, y, z)
    ex, ey, ez = offset_of(solids.form[m], size[0], size[1], size[2], x, y, z)
    return R[0, 0] * ex + R[0, 1] * ey + R[0, 2] * ez, R[1, 0] * ex + R[1, 1] * ey + R[1, 2] * ez


def tiles(points: Array, width: float) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
    """Yield points (k, 2) [m] by square tiles of a width [m]: rows (l,), least and greatest corner (2,) of those."""
    if not len(points):
        return
    tile = np.floor((points - points.min(axis=0)) / width).astype(np.int64)
    number = tile[:, 0] * (tile[:, 1].max() + 1) + tile[:, 1]
    order = np.argsort(number, kind="stable")
    begins = np.concatenate(([0], np.flatnonzero(np.diff(number[order])) + 1))
    least, most = (extreme.reduceat(points[order], begins, axis=0) for extreme in (np.minimum, np.maximum))
    yield from zip(np.split(order, begins[1:]), least, most, strict=True)


class Bins(NamedTuple):
    """Solids that may be near, by square cells in rows along y."""

    left: float  # corner of the first cell [m]
    low: float  # [m]
    width: float  # of a cell [m]
    columns: int  # along x
    rows: int  # along y
    first: NDArray[np.int64]  # (columns rows + 1,) where the solids of each cell begin
    member: NDArray[np.int64]  # (k,) solids, in the order of their indices within a cell


def bins_of(solids: Solids, members: NDArray[np.int64], points: Array, cutoff: float) -> Bins:
    """Sort solids `members` (l,) that may be nearer than `cutoff` [m] to a place among points (k, 2) [m] into cells."""
    corner, end = (np.array([extreme(points[:, k]) for k in (0, 1)]) for extreme in (np.min, np.max))
    width = max(cutoff, float((end - corner).max()) / TUNING.bins_per_side)
    counts = ((end - corner) / width).astype(np.int64) + 1
    wide = cutoff * (1.0 + 1e-9) + 1e-9
    low = np.floor((solids.low[members] - wide - corner) / width)
    high = np.floor((solids.high[members] + wide - corner) / width)
    here = np.all((high >= 0) & (low < counts), axis=1)
    low, high = np.clip(low[here], 0, counts - 1), np.clip(high[here], 0, counts - 1)
    first = np.zeros(counts.prod() + 1, dtype=np.int64)
    low, high = low.astype(np.int64), high.astype(np.int64)
    _count(low, high, int(counts[1]), first)
    np.cumsum(first, out=first)
    member = np.empty(first[-1], dtype=np.int64)
    _sort_in(low, high, members[here], int(counts[1]), first[:-1].copy(), member)
    return Bins(float(corner[0]), float(corner[1]), width, int(counts[0]), int(counts[1]), first, member)


@kernel
def _count(low, high, rows, first):  # type: ignore[no-untyped-def]
    """Count the rectangles of cells that cover each cell, written one place later."""
    for m in range(len(low)):
        for i in range(low[m, 0], high[m, 0] + 1):
            for j in range(low[m, 1], high[m, 1] + 1):
                first[i * rows + j + 1] += 1


@kernel
def _sort_in(low, high, members, rows, free, member):  # type: ignore[no-untyped-def]
    """Write each solid into the cells that it covers, from the places that are `free` there on."""
    for m in range(len(low)):
        for i in range(low[m, 0], high[m, 0] + 1):
            for j in range(low[m, 1], high[m, 1] + 1):
                at = i * rows + j
                member[free[at]] = members[m]
                free[at] += 1


@inlined
def bin_at(bins, x, y):  # type: ignore[no-untyped-def]
    """Return where the solids near (x, y) [m] begin and end among `bins.member`."""
    i = min(max(int((x - bins.left) / bins.width), 0), bins.columns - 1)
    j = min(max(int((y - bins.low) / bins.width), 0), bins.rows - 1)
    return bins.first[i * bins.rows + j], bins.first[i * bins.rows + j + 1]
