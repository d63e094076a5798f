"""Find saddles of the clearance field: free space narrows there before it widens again.

The points with more clearance than c fall into parts, and those with less as well. At a saddle two parts meet: two
rooms with c falling (a doorway), or two obstacles with c rising (the last gap between them). Every passage is one or
the other, also where both sides belong to one component. A sweep in the order of clearance finds them (union-find);
that the shallower of two parts must be of some depth tells a passage from the grain of the grid.

Squares of grid points lie in pages: one in a small world, one for every coarsest block near a solid in a large one.
Away from all solids a page is one room of the field's greatest clearance, and all around the workspace is one obstacle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Field, border, cell_of, value_at
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel


class Pages(NamedTuple):
    """Squares of the field by pages: those near solids first, then the empty pages, then the surroundings."""

    first: IntArray  # (rows, columns) first square of each page, or the only one
    place: IntArray  # (k, 2) row and column of the k pages near solids
    near: int  # k
    side: int  # squares along a side of a page
    empty: int  # index of the first empty page's square
    value: Array  # (n,) greatest clearance in each square [m]


def narrow_places(field: Field, radius: float) -> tuple[int, NDArray[np.int64]]:
    """Return squares in which two rooms or two obstacles meet and a robot of a radius [m] may pass, narrowest first.

    Returns: the side of a square in grid points, and (row, column) of the squares (k, 2). The first point of a square
        is that many times (row, column).
    """
    stride = max(1, int(radius / (TUNING.squares_per_radius * field.spacing)))
    squares = _pages_of(field, stride, radius)
    value, surroundings = squares.value, len(squares.value) - 1
    near = np.flatnonzero(value[: squares.empty] < REACH)
    level = np.rint((value[near] + radius) * (65535.0 / max(value.max() + radius, 1e-9))).astype(np.uint16)
    rising = near[np.argsort(level, kind="stable")].astype(np.int32)  # a radix sort
    found = np.zeros(len(value), dtype=np.bool_)
    root = np.full(len(value), -1, dtype=np.int32)
    steps = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]])  # four meet at sides
    open_space = np.flatnonzero(value[:-1] >= REACH).astype(np.int32)
    _sweep(squares, open_space, steps, np.inf, root, np.zeros_like(found))
    _sweep(squares, np.ascontiguousarray(rising[::-1]), steps, TUNING.room_depth * field.spacing, root, found)
    root[:] = -1
    root[surroundings] = surroundings
    _sweep(
        squares, rising, steps[:4], TUNING.solid_depth * radius, root, found
    )  # what is blocked must not meet at corners
    at = np.flatnonzero(found & (value > -field.spacing))  # a gap on whose axis no grid point lies may look closed
    at = at[np.argsort(value[at], kind="stable")]
    page, square = np.divmod(at, squares.side**2)
    places: NDArray[np.int64] = squares.place[page] * squares.side + np.column_stack(np.divmod(square, squares.side))
    return stride, places


def _pages_of(field: Field, stride: int, radius: float) -> Pages:
    if field.blocks is None:
        side, near = max(-(-field.nx // stride), -(-field.ny // stride)), np.ones((1, 1), dtype=np.bool_)
    else:
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
                i, j = (place[page, 0] * side + a) * stride, (place[page, 1] * side + b) * stride
                value[at] = _greatest(field, i, j, stride, radius)
                at += 1


@inlined
def _greatest(field, i, j, stride, radius):  # type: ignore[no-untyped-def]
    """Return the greatest clearance [m], from -radius to REACH, in the square that begins at grid point (i, j)."""
    h, best = field.spacing, -radius
    x, y = field.x0 + (i + 0.5) * h, field.y0 + (j + 0.5) * h
    wide = cell_of(field, x, y)[3] * h * 4.0 <= 1.0  # its cells hold whole squares: the greatest value is at a corner
    step = stride if wide else 1
    for k in range(i, min(i + stride + (1 if wide else 0), field.nx), step):
        for m in range(j, min(j + stride + (1 if wide else 0), field.ny), step):
            best = max(best, min(border(field, field.x0 + k * h, field.y0 + m * h), value_at(field, k, m)))
    return min(best, REACH)


@inlined
def _find(root, p):  # type: ignore[no-untyped-def]
    while root[p] != p:
        root[p] = root[root[p]]
        p = root[p]
    return p


@inlined
def _next_square(squares, page, i, j, a, b):  # type: ignore[no-untyped-def]
    """Return square (a, b) of the page in row i and column j, or of the page next to it beyond its sides.

    Empty pages only meet their like: -1 where one meets another.
    """
    side, (rows, columns) = squares.side, squares.first.shape
    i, j = i + (-1 if a < 0 else (1 if a >= side else 0)), j + (-1 if b < 0 else (1 if b >= side else 0))
    if not (0 <= i < rows and 0 <= j < columns):
        return len(squares.value) - 1
    q = squares.first[i, j]
    if q >= squares.empty:
        return q
    return -1 if page >= squares.near else q + (a % side) * side + b % side


@kernel
def _sweep(squares, order, steps, least, root, found):  # type: ignore[no-untyped-def]
    """Add squares in an order and mark where two parts meet that are both deeper than `least` [m] there.

    A square next to an empty page is added later than that page and meets it.
    """
    value, place, side = squares.value, squares.place, squares.side
    for k in range(order.shape[0]):
        p = order[k]
        root[p] = p
        lonely = p >= squares.empty
        page = squares.near + p - squares.empty if lonely else p // (side * side)
        square = 0 if lonely else p % (side * side)
        i, j, a, b = place[page, 0], place[page, 1], square // side, square % side
        for s in range(len(steps)):
            di, dj = steps[s, 0], steps[s, 1]
            if lonely:
                di, dj = di * side, dj * side
            if 0 <= a + di < side and 0 <= b + dj < side:
                q = p + di * side + dj
            else:
                q = _next_square(squares, page, i, j, a + di, b + dj)
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
