"""Find the two nearest walls: the nearest of many solids, and the nearest in another direction.

Sampled paths are killed at both, each taken as flat. The next box of a wall made of several adds nothing to that;
the facing wall of a passage does, and so does the other side of a concave corner.
"""

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.geometry.shapes import PROBE, Solids, distance_from, offset_from, square_to
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import borrowing, jitable, over_ranges, part

APART_COSINE = TUNING.apart_cosine
RISE_SINE = TUNING.rise_sine


class Found(NamedTuple):
    """Nearest walls of k points."""

    first: Array  # (k,) distance to the nearest solid [m]
    second: Array  # (k,) distance to the nearest that stands elsewhere [m]
    which: NDArray[np.int64]  # (k,) index of the nearest solid, -1 where none is known
    away: Array  # (k, d) vector from its nearest point, seen from above in the plane [m], zero inside
    other: Array  # (k,) distance to the nearest of all others, wherever it stands [m]


@jitable
def stands_apart(along: float, square: float, other: float) -> bool:
    """Return whether a solid is a wall of its own next to a nearer one, by products e.a, a.a and e.e [m^2].

    e is the vector from its nearest point, a that from the nearer one's.

    Their directions are more than 60 degrees apart, and the point rises from the plane of the nearer wall, as that of
    a box does not which stands in line with it further on. From within a solid and from below all are apart.
    """
    if along <= 0.0:
        return True
    rise = square - along  # times the nearer distance, as the next one

    if rise <= 0.0 or rise * rise < RISE_SINE * RISE_SINE * square * (square - 2.0 * along + other):
        return False
    return along * along < APART_COSINE * APART_COSINE * square * other


@part
def products(e, a, d):  # type: ignore[no-untyped-def]
    """Return e.a, a.a and e.e of the first d numbers of two vectors."""
    along, square, other = 0.0, 0.0, 0.0
    for c in range(d):
        along += e[c] * a[c]
        square += a[c] * a[c]
        other += e[c] * e[c]
    return along, square, other


class Bins(NamedTuple):
    """Solids that may be near, by square cells in rows along y."""

    left: float  # corner of the first cell [m]
    low: float  # [m]
    width: float  # of a cell [m]
    columns: int  # along x
    rows: int  # along y
    first: NDArray[np.int64]  # (columns rows + 1,) where the solids of each cell begin
    member: NDArray[np.int64]  # (k,) solids, in the order of their indices within a cell


def bins_of(solids: Solids, members: IntArray, points: Array, cutoff: float) -> Bins:
    """Sort solids `members` (l,) that may be nearer than `cutoff` [m] to a place among points (k, d) [m] into cells."""
    corner, end = (np.array([extreme(points[:, k]) for k in (0, 1)]) for extreme in (np.min, np.max))
    width = max(cutoff, float((end - corner).max()) / TUNING.bins_per_side)
    counts = ((end - corner) / width).astype(np.int64) + 1
    wide = cutoff * (1.0 + 1e-9) + 1e-9
    low = np.floor((solids.low[members, :2] - wide - corner) / width)
    high = np.floor((solids.high[members, :2] + wide - corner) / width)
    here = np.all((high >= 0) & (low < counts), axis=1)
    low = np.clip(low[here], 0, counts - 1).astype(np.int64)
    sides = np.clip(high[here], 0, counts - 1).astype(np.int64) - low + 1
    covered = sides.prod(axis=1)
    m = np.repeat(np.arange(len(covered)), covered)
    i, j = np.divmod(np.arange(len(m)) - (np.cumsum(covered) - covered)[m], sides[m, 1])
    cell = (low[m, 0] + i) * counts[1] + low[m, 1] + j
    first = np.cumsum(np.bincount(cell + 1, minlength=counts.prod() + 1))
    member = members[here][m[np.argsort(cell, kind="stable")]]
    return Bins(float(corner[0]), float(corner[1]), width, int(counts[0]), int(counts[1]), first, member)


@part
def bin_at(bins, x, y):  # type: ignore[no-untyped-def]
    """Return where the solids near (x, y) [m] begin and end among `bins.member`."""
    i = min(max(int((x - bins.left) / bins.width), 0), bins.columns - 1)
    j = min(max(int((y - bins.low) / bins.width), 0), bins.rows - 1)
    return bins.first[i * bins.rows + j], bins.first[i * bins.rows + j + 1]


@part
def above(solids, m, z, d):  # type: ignore[no-untyped-def]
    """Return in space the square of the distance of a height from the box around a solid [m^2], else 0."""
    rise = max(max(solids.low[m, 2] - z, z - solids.high[m, 2]), 0.0) if d == 3 else 0.0
    return rise * rise


@borrowing
def _two_nearest(solids, bins, points, height, found):  # type: ignore[no-untyped-def]
    """Put the two nearest walls of points (k, 2) [m] at a height [m], or of points in space (k, 3), into `found`."""
    first, second, which, away, other = found
    d = points.shape[1]
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        z = height if d == 2 else points[i, 2]
        begin, end = bin_at(bins, x, y)

        best = first[i]
        later = first[i]
        at = -1

        for k in range(begin, end):
            m = bins.member[k]
            if square_to(solids.low, solids.high, m, x, y) + above(solids, m, z, d) >= later * later:
                continue
            gap = distance_from(solids, m, x, y, z)
            gap = 0.0 if gap <= PROBE else gap
            if gap < best:
                best, later, at = gap, best, m
            else:
                later = min(later, gap)
        first[i], other[i], which[i] = best, later, at
        if at >= 0 and best > 0.0:
            offset = offset_from(solids, at, x, y, z)
            for c in range(d):
                away[i, c] = offset[c]
        best = second[i]
        for k in range(begin, end):
            m = bins.member[k]
            if m == at or square_to(solids.low, solids.high, m, x, y) + above(solids, m, z, d) >= best * best:
                continue
            gap = distance_from(solids, m, x, y, z)
            if gap <= PROBE:
                best = 0.0
            elif gap < best:
                along, square, length = products(offset_from(solids, m, x, y, z), away[i], d)
                if stands_apart(along, square, length):
                    best = gap
        second[i] = best


def nearest_walls(solids: Solids, members: IntArray, points: Array, height: float, cutoff: float) -> Found:
    """Find the two nearest walls of each point (k, 2) [m], robot centres at one height [m], or (k, 3) in space.

    `members` (l,) are the indices of the solids that count; no distance above the cutoff [m] is reported.
    """
    k = len(points)
    first, second, other = np.full((3, k), cutoff)
    found = Found(first, second, np.full(k, -1, dtype=np.int64), np.zeros(points.shape), other)
    if k == 0:
        return found
    bins = bins_of(solids, members, points, cutoff)
    threads = len(os.sched_getaffinity(0))

    def work(start: int, stop: int) -> None:
        part = slice(start, stop)
        _two_nearest(solids, bins, points[part], height, Found._make(values[part] for values in found))

    over_ranges(work, k, threads if k >= TUNING.parallel else 1)
    return found
