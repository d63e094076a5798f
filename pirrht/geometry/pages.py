"""Saddles of the clearance field of a large world: the two sweeps of `saddles` where it lies in blocks.

Squares of grid points lie in pages, one for every coarsest block near a solid. Away from all solids a page is one room
of the greatest clearance that the field tells, and all around the workspace is one obstacle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Field, border, cell_of, interpolate
from pirrht.jit.jit import inlined, kernel

ROOM = 1.0  # a room is deeper than its door by this many spacings of the field, or it is grain
SOLID = 0.5  # an obstacle is deeper than the gap by this share of the robot's radius; its inside by all of it
BLOCKS = 2.0  # of the field's points that make a block, per radius: the thinnest obstacle still blocks one
STEPS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])  # four meet at sides
FINE = 2  # levels below this are looked at point by point: wider cells hold whole squares


class Pages(NamedTuple):
    """Squares of the field by pages: those near solids first, then the empty pages, then the surroundings."""

    first: IntArray  # (rows, columns) first square of each page, or the only one
    place: IntArray  # (k, 2) row and column of the k pages near solids
    near: int  # k
    side: int  # squares along a side of a page
    empty: int  # index of the first empty page's square
    value: Array  # (n,) greatest clearance in each square [m]


def saddles_of_pages(field: Field, stride: int, radius: float) -> NDArray[np.int64]:
    """Rows and columns (k, 2) of squares of `stride` points in which two rooms or two obstacles meet, narrowest first.

    A robot of some radius [m] may pass there, and the clearance is less than the field's greatest.
    """
    pages = _pages_of(field, stride, radius)
    value, surroundings = pages.value, len(pages.value) - 1
    near = np.flatnonzero(value[: pages.empty] < REACH)
    level = np.rint((value[near] + radius) * (65535.0 / (REACH + radius))).astype(np.uint16)
    rising = near[np.argsort(level, kind="stable")].astype(np.int32)  # a radix sort
    found = np.zeros(len(value), dtype=np.bool_)
    root = np.full(len(value), -1, dtype=np.int32)
    open_space = np.flatnonzero(value[:-1] >= REACH).astype(np.int32)
    _sweep(pages, open_space, STEPS, np.inf, root, np.zeros_like(found))
    _sweep(pages, rising[::-1], STEPS, ROOM * field.spacing, root, found)
    root[:] = -1
    root[surroundings] = surroundings
    _sweep(pages, rising, STEPS[:4], SOLID * radius, root, found)
    at = np.flatnonzero(found & (value > -field.spacing))  # a gap on whose axis no grid point lies may look closed
    at = at[np.argsort(value[at], kind="stable")]
    page, square = np.divmod(at, pages.side**2)
    places: NDArray[np.int64] = pages.place[page] * pages.side + np.column_stack(np.divmod(square, pages.side))
    return places


def _pages_of(field: Field, stride: int, radius: float) -> Pages:
    assert field.blocks is not None
    side = ((field.stride - 1) << (LEVELS - 1)) // stride
    near = (field.blocks[:: 1 << (LEVELS - 1), :: 1 << (LEVELS - 1)] >> LEVEL_BITS) != 0
    place, lonely = np.argwhere(near), np.argwhere(~near)
    first = np.empty(near.shape, dtype=np.int64)
    empty = len(place) * side**2
    first[near] = np.arange(len(place)) * side**2
    first[~near] = empty + np.arange(len(lonely))
    value = np.full(empty + len(lonely) + 1, REACH)
    value[-1] = -radius
    _fill(field, place, side, stride, radius, value)
    return Pages(first, np.vstack((place, lonely)), len(place), side, empty, value)


@kernel
def _fill(field, place, side, stride, radius, value):  # type: ignore[no-untyped-def]
    """Write the greatest clearance [m] of every square of the pages near solids."""
    at = 0
    for page in range(len(place)):
        for a in range(side):
            for b in range(side):
                value[at] = _greatest(field, (place[page, 0] * side + a) * stride, (place[page, 1] * side + b) * stride,
                                      stride, radius)  # fmt: skip
                at += 1


@inlined
def _greatest(field, i, j, stride, radius):  # type: ignore[no-untyped-def]
    """That of the square that begins at a grid point (i, j), between -radius and REACH."""
    h = field.spacing
    x, y = field.x0 + (i + 0.5) * h, field.y0 + (j + 0.5) * h
    wide = cell_of(field, x, y)[3] * h * (1 << FINE) <= 1.0  # then the greatest value is at a corner
    step = stride if wide else 1
    best = -radius
    for k in range(0, stride + (1 if wide else 0), step):
        for m in range(0, stride + (1 if wide else 0), step):
            x, y = field.x0 + (i + k) * h, field.y0 + (j + m) * h
            best = max(best, min(border(field, x, y), interpolate(field, field.nearest, x, y)))
    return min(best, REACH)


@inlined
def _find(root, p):  # type: ignore[no-untyped-def]
    while root[p] != p:
        root[p] = root[root[p]]
        p = root[p]
    return p


@inlined
def _beside(pages, page, i, j, a, b):  # type: ignore[no-untyped-def]
    """The square (a, b) of the page in row i and column j, or of the page beside it where those lie beyond its sides.

    Empty pages only meet their like: -1 where one meets another.
    """
    side, (rows, columns) = pages.side, pages.first.shape
    i, j = i + (-1 if a < 0 else (1 if a >= side else 0)), j + (-1 if b < 0 else (1 if b >= side else 0))
    if not (0 <= i < rows and 0 <= j < columns):
        return len(pages.value) - 1
    q = pages.first[i, j]
    if q >= pages.empty:
        return q
    return -1 if page >= pages.near else q + (a % side) * side + b % side


@kernel
def _sweep(pages, order, steps, least, root, found):  # type: ignore[no-untyped-def]
    """Add squares in an order and mark where two parts meet that are both deeper than `least` [m] there.

    What lies beside an empty page is added later than that and meets it.
    """
    value, place, side, area = pages.value, pages.place, pages.side, pages.side * pages.side
    for k in range(order.shape[0]):
        p = order[k]
        root[p] = p
        lonely = p >= pages.empty
        page = pages.near + p - pages.empty if lonely else p // area
        square = 0 if lonely else p % area
        i, j, a, b = place[page, 0], place[page, 1], square // side, square % side
        for s in range(len(steps)):
            di, dj = steps[s, 0], steps[s, 1]
            if lonely:
                di, dj = di * side, dj * side
            if 0 <= a + di < side and 0 <= b + dj < side:
                q = p + di * side + dj
            else:
                q = _beside(pages, page, i, j, a + di, b + dj)
            if q < 0 or root[q] < 0:
                continue
            one, other = _find(root, p), _find(root, q)
            if one == other:
                continue
            deep, deeper = abs(value[one] - value[p]), abs(value[other] - value[p])
            if min(deep, deeper) > least:
                found[p] = True
            if deep < deeper:
                root[one] = other
            else:
                root[other] = one
