"""Where the clearance field has saddles: free space narrows there before it widens again.

The points with more clearance than c fall into parts, and those with less as well. At a saddle two parts meet: two
rooms with c falling (a doorway), or two obstacles with c rising (the last gap between them). Every passage is one or
the other, also where both sides belong to one component. A sweep in the order of clearance finds them (union-find);
that the shallower of two parts must be of some depth tells a passage from the grain of the grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.field import REACH, Field, value_at
from pirrht.geometry.pages import BLOCKS, ROOM, SOLID, saddles_of_pages
from pirrht.jit.jit import inlined, kernel


class Blocks(NamedTuple):
    """Square blocks of grid points in rows that are closed all around, each with the clearance of its best point."""

    value: Array  # (rows columns,) [m]
    columns: int
    stride: int  # grid points on a side of a block


def narrow_places(field: Field, radius: float) -> tuple[int, NDArray[np.int64]]:
    """Where a robot of some radius [m] may just pass: (row, column) of squares (k, 2), narrowest first.

    A square is so many grid points wide, which is returned first; its first point is that many times (row, column).
    """
    stride = max(1, int(radius / (BLOCKS * field.spacing)))
    if field.blocks is not None:
        return stride, saddles_of_pages(field, stride, radius)
    blocks = blocks_of(field, radius)
    at = saddles(blocks, field.spacing, radius)
    return stride, np.column_stack((at // blocks.columns, at % blocks.columns)) - 1


def blocks_of(field: Field, radius: float) -> Blocks:
    """The blocks of a field for a robot of some radius [m]."""
    stride = max(1, int(radius / (BLOCKS * field.spacing)))
    rows, columns = -(-field.nx // stride) + 2, -(-field.ny // stride) + 2
    value = np.full(rows * columns, -radius)
    _fill(field, stride, columns, value)
    return Blocks(np.clip(value, -radius, REACH), columns, stride)


def saddles(blocks: Blocks, spacing: float, radius: float) -> NDArray[np.int64]:
    """Blocks (k,) in which two rooms or two obstacles meet and a robot of some radius [m] may pass, narrowest first."""
    value = blocks.value
    level = np.rint((value - value.min()) * (65535.0 / max(np.ptp(value), 1e-9))).astype(np.uint16)
    rising = np.argsort(level, kind="stable")  # a radix sort
    found = np.zeros(len(value), dtype=np.bool_)
    root = np.empty(len(value), dtype=np.int64)
    _sweep(value, np.ascontiguousarray(rising[::-1]), _ring(blocks.columns, 8), ROOM * spacing, root, found)
    _sweep(value, rising, _ring(blocks.columns, 4), SOLID * radius, root, found)
    at = np.flatnonzero(found & (value > -spacing))  # a gap on whose axis no grid point lies may look closed
    return at[np.argsort(value[at], kind="stable")]


def _ring(columns: int, count: int) -> NDArray[np.int64]:
    """Steps to the 4 or 8 neighbours: free space meets at corners, then what is blocked must not."""
    return np.array([1, -1, columns, -columns, columns + 1, columns - 1, 1 - columns, -columns - 1])[:count]


@kernel
def _fill(field, stride, columns, value):  # type: ignore[no-untyped-def]
    """Write the greatest clearance in every block, but for those all around."""
    for i in range(field.nx):
        x, row = field.x0 + i * field.spacing, (i // stride + 1) * columns + 1
        side = min(x - field.left, field.right - x)
        for j in range(field.ny):
            y = field.y0 + j * field.spacing
            c = min(min(side, min(y - field.low, field.high - y)), value_at(field, i, j))
            at = row + j // stride
            if c > value[at]:
                value[at] = c


@inlined
def _find(root, p):  # type: ignore[no-untyped-def]
    while root[p] != p:
        root[p] = root[root[p]]
        p = root[p]
    return p


@kernel
def _sweep(value, order, ring, least, root, found):  # type: ignore[no-untyped-def]
    """Add blocks in an order and mark where two parts meet that are both deeper than `least` [m] there."""
    root[:] = -1
    for k in range(order.shape[0]):
        p = order[k]
        root[p] = p
        for step in ring:
            q = p + step
            if q < 0 or q >= root.shape[0] or root[q] < 0:
                continue
            a, b = _find(root, p), _find(root, q)
            if a == b:
                continue
            deep_a, deep_b = abs(value[a] - value[p]), abs(value[b] - value[p])
            if min(deep_a, deep_b) > least:
                found[p] = True
            if deep_a < deep_b:
                root[a] = b
            else:
                root[b] = a
