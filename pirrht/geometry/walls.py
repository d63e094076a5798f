"""Find the two nearest walls: the nearest of many solids, and the nearest in another direction.

Sampled paths are killed at both, each taken as flat. The next box of a wall made of several adds nothing to that;
the facing wall of a passage does, and so does the other side of a concave corner.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.shapes import PROBE, Bins, Solids, bin_at, bins_of, distance_from, offset_from, tiles
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, jitable, kernel

APART_COSINE = TUNING.apart_cosine
RISE_SINE = TUNING.rise_sine

Answer = tuple[float, float, float]  # distance and planar vector (x, y) from the nearest point [m], all 0 inside
Query = Callable[[int, Array], Answer]  # of a solid, at a point (3,) [m]


class Found(NamedTuple):
    """Nearest walls of k points."""

    first: Array  # (k,) distance to the nearest solid [m]
    second: Array  # (k,) distance to the nearest that stands elsewhere [m]
    which: NDArray[np.int64]  # (k,) index of the nearest solid, -1 where none is known
    away: Array  # (k, 2) planar vector from its nearest point [m], zero inside


@jitable
def stands_apart(ex: float, ey: float, ax: float, ay: float) -> bool:
    """Return whether a solid is a wall of its own next to a nearer one, by vectors from the nearest points e and a [m].

    Their directions are more than 60 degrees apart, and the point rises from the plane of the nearer wall, as that of
    a box does not which stands in line with it further on. From within a solid and from below all are apart.
    """
    along, square, other = ex * ax + ey * ay, ax * ax + ay * ay, ex * ex + ey * ey
    if along <= 0.0:
        return True
    rise, between = square - along, square - 2.0 * along + other  # the rise times the nearer distance
    if rise <= 0.0 or rise * rise < RISE_SINE * RISE_SINE * square * between:
        return False
    return along * along < APART_COSINE * APART_COSINE * square * other


@inlined
def square_to(low, high, m, x, y):  # type: ignore[no-untyped-def]
    """Return the square of the distance from (x, y) to the rectangle around a solid [m^2]."""
    dx, dy = max(max(low[m, 0] - x, x - high[m, 0]), 0.0), max(max(low[m, 1] - y, y - high[m, 1]), 0.0)
    return dx * dx + dy * dy


@kernel
def _nearest_of(solids, bins, points, rows, height, found):  # type: ignore[no-untyped-def]
    """Put the nearest of the solids in bins, which have closed forms, into `found` at rows of points (k, 2) [m]."""
    low, high, member = solids.low, solids.high, bins.member
    first, _, which, away = found
    for i in rows:
        x, y = points[i, 0], points[i, 1]
        best, at = first[i], which[i]
        begin, end = bin_at(bins, x, y)
        for k in range(begin, end):
            m = member[k]
            if square_to(low, high, m, x, y) >= best * best:
                continue
            d = distance_from(solids, m, x, y, height)
            d = 0.0 if d <= PROBE else d
            if d < best:
                best, at = d, m
        first[i], which[i] = best, at
        if at >= 0 and best > 0.0:
            away[i, 0], away[i, 1] = offset_from(solids, at, x, y, height)


@kernel
def _second_of(solids, bins, points, rows, height, found):  # type: ignore[no-untyped-def]
    """Put the nearest that stands apart from the nearest of all solids, which is known, into `found`."""
    low, high, member = solids.low, solids.high, bins.member
    _, second, which, away = found
    for i in rows:
        x, y = points[i, 0], points[i, 1]
        best = second[i]
        begin, end = bin_at(bins, x, y)
        for k in range(begin, end):
            m = member[k]
            if square_to(low, high, m, x, y) >= best * best or m == which[i]:
                continue
            d = distance_from(solids, m, x, y, height)
            if d <= PROBE:
                best = 0.0
            elif d < best:
                ex, ey = offset_from(solids, m, x, y, height)
                if stands_apart(ex, ey, away[i, 0], away[i, 1]):
                    best = d
        second[i] = best


@kernel
def _crowded(bins, points):  # type: ignore[no-untyped-def]
    """Return which of the points (k, 2) [m] have solids in their bins, (k,)."""
    out = np.zeros(len(points), dtype=np.bool_)
    for i in range(len(points)):
        begin, end = bin_at(bins, points[i, 0], points[i, 1])
        out[i] = end > begin
    return out


def nearest_walls(
    solids: Solids, closed: BoolArray, members: IntArray, query: Query, points: Array, height: float, cutoff: float
) -> Found:
    """Find the two nearest walls of each point.

    Args:
        solids: M obstacles.
        closed: whether a solid's closed form is used, (M,); otherwise it is queried.
        members: indices of the solids that count, (l,).
        query: returns distance and offset of a point from a solid.
        points: robot centres, (k, 2) [m], all at one height [m].
        height: of all points [m].
        cutoff: no distance above this is reported [m].
    """
    k = len(points)
    found = Found(np.full(k, cutoff), np.full(k, cutoff), np.full(k, -1, dtype=np.int64), np.zeros((k, 2)))
    if not k:
        return found
    plain, others = members[closed[members]], members[~closed[members]]
    rows, bins = np.arange(k), bins_of(solids, plain, points, cutoff)
    _nearest_of(solids, bins, points, rows, height, found)
    if len(others):
        doubtful = _crowded(bins_of(solids, others, points, cutoff), points)
        _query_others(solids, others, query, points, np.flatnonzero(doubtful), height, cutoff, found, bins)
        rows = np.flatnonzero(~doubtful)
    _second_of(solids, bins, points, rows, height, found)
    return found


def queried_points(solids: Solids, closed: BoolArray, members: IntArray, points: Array, cutoff: float) -> int:
    """Count points (k, 2) [m] that lie where solids without a closed form have to be queried."""
    others = members[~closed[members]]
    return int(_crowded(bins_of(solids, others, points, cutoff), points).sum()) if len(others) and len(points) else 0


def _query_others(
    solids: Solids,
    others: IntArray,
    query: Query,
    points: Array,
    rows: IntArray,
    height: float,
    cutoff: float,
    found: Found,
    bins: Bins,
) -> None:
    """Query solids (l,) at rows of the points, where the nearest of the plain ones in bins is known, and finish."""
    lifted = np.column_stack((points, np.full(len(points), height)))
    for tile, low, high in tiles(points[rows], cutoff):
        gap = np.maximum(np.maximum(solids.low[others] - high, low - solids.high[others]), 0.0)
        near = others[(gap * gap).sum(axis=1) < cutoff * cutoff]
        queries = _Queries(solids, near, query, lifted, rows[tile], cutoff)
        queries.nearest_of(found)
        _second_of(solids, bins, points, rows[tile], height, found)
        queries.second_of(found)


class _Queries:
    """Pairs of a point and a solid that is queried, each at most once."""

    def __init__(self, solids: Solids, members: IntArray, query: Query, points: Array, rows: IntArray, cutoff: float):
        bounds = _lower_bounds(solids, members, points[rows])
        at, columns = np.nonzero(bounds < cutoff)
        values = bounds[at, columns]
        order = np.lexsort((values, at))  # nearest first, so that most pairs are decided by their bound
        self.rows: list[int] = rows[at[order]].tolist()
        self.members: list[int] = members[columns[order]].tolist()
        self.bounds: list[float] = values[order].tolist()
        self.query, self.points = query, points
        self.answers: dict[tuple[int, int], Answer] = {}

    def nearest_of(self, found: Found) -> None:
        """Put the nearest of the queried solids into `found`."""
        first, _, which, away = found
        for row, m in self.closer_than(first):
            d, x, y = self.answers[row, m] = self.query(m, self.points[row])
            if d < first[row]:
                first[row], which[row], away[row] = d, m, (x, y)

    def second_of(self, found: Found) -> None:
        """Put the nearest queried solid that stands apart into `found`."""
        _, second, which, away = found
        for row, m in self.closer_than(second):
            if m == which[row]:
                continue
            d, x, y = self.answer(row, m)
            if d < second[row] and stands_apart(x, y, *away[row]):
                second[row] = d

    def closer_than(self, known: Array) -> Iterator[tuple[int, int]]:
        """Yield pairs (row, solid) that may be closer than the known distances (k,) [m], which may shrink meanwhile."""
        for row, m, bound in zip(self.rows, self.members, self.bounds, strict=True):
            if bound < known[row]:
                yield row, m

    def answer(self, row: int, m: int) -> Answer:
        known = self.answers.get((row, m))
        if known is None:
            known = self.answers[row, m] = self.query(m, self.points[row])
        return known


def _lower_bounds(solids: Solids, members: IntArray, points: Array) -> Array:
    """Return distances from points (k, 2) to the members' rectangles, (k, l) [m]."""
    low, high = solids.low[members], solids.high[members]
    x, y = points[:, :1], points[:, 1:2]
    dx = np.maximum(np.maximum(low[:, 0] - x, x - high[:, 0]), 0.0)
    dy = np.maximum(np.maximum(low[:, 1] - y, y - high[:, 1]), 0.0)
    bounds: Array = np.sqrt(dx * dx + dy * dy)
    return bounds
