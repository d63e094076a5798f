"""Sample the clearance field of a large world in square blocks of points, fine where walls bend or change, else coarse.

Blocks of one level have the same number of points and spacing 2^level h; the table names for every place the finest
block that covers it. Every point of a block is queried, so it errs by what interpolation between its own points can be
too high by, and by nothing next to flat faces (`flat`), where a coarse block therefore serves as well as a fine one.
Where no solid is within cutoff all places share one constant block.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import LEVEL_BITS, LEVELS, REACH, Arrays, Field
from pirrht.geometry.flat import CURVED, FLAT
from pirrht.geometry.tuning import TUNING
from pirrht.geometry.walls import Found
from pirrht.jit.jit import inlined, kernel

TOP = LEVELS - 1

Origins = NDArray[np.int64]  # (k, 2) first cells of blocks, in the finest spacing


class TooLarge(Exception):
    """A field would take more than there is; `share` of the workspace's sides would do."""

    def __init__(self, share: float) -> None:
        super().__init__(share)
        self.share = share


def build_blocks(collision: Collision, members: Sequence[int], h: float) -> Field:
    """Sample clearances [m] from the solids that count in blocks, the finest of spacing h [m].

    Raises:
        TooLarge: the table, the blocks or the queries would be too many.
    """
    builder = _Builder.of(collision, members, h)
    origins = builder.near_blocks()
    for level in range(TOP, -1, -1):
        builder.reserve(level, origins)
        origins = np.concatenate(
            [
                builder.add(level, origins[i : i + TUNING.blocks_at_once])
                for i in range(0, len(origins), TUNING.blocks_at_once)
            ]
            or [origins]
        )
    return Field.in_blocks(collision.world, h, builder.table, builder.arrays())


def block_width(span: Array, h: float) -> int:
    """Cells on a side of a block for a workspace's span (2,) [m].

    Raises:
        TooLarge: the table would be too large with any.
    """
    for cells in (8, 16, 32):  # wider ones make the table smaller and waste more points
        places = float(np.prod(_tops(span, h, cells) * 2.0**TOP))
        if places <= TUNING.table_places:
            return cells
    raise TooLarge(float(np.sqrt(TUNING.table_places / places)))


def _tops(span: Array, h: float, cells: int) -> Array:
    """Count the coarsest blocks along each side."""
    tops: Array = np.ceil(span / (h * cells * 2**TOP) - 1e-9)
    return tops


class _Builder(NamedTuple):
    """The blocks that have been sampled so far."""

    collision: Collision
    members: list[int]
    h: float
    cells: int  # on a side of a block
    table: NDArray[np.int32]  # (rows, columns)
    parts: list[Arrays]

    @classmethod
    def of(cls, collision: Collision, members: Sequence[int], h: float) -> _Builder:
        span = collision.world.upper - collision.world.lower
        cells = block_width(span, h)
        table = np.zeros((_tops(span, h, cells) * 2**TOP).astype(int), dtype=np.int32)
        table[:] = TOP  # block 0, which is constant
        far, shape = REACH if len(members) else TUNING.nothing, (1, cells + 1, cells + 1)
        constant = (np.full(shape, far, np.float32), np.full(shape, far, np.float32), np.full(shape, -1, np.int32))
        return cls(collision, list(members), h, cells, table, [constant])

    @property
    def size(self) -> int:
        """Count the blocks so far."""
        return sum(len(part[0]) for part in self.parts)

    def arrays(self) -> Arrays:
        nearest, second, label = (np.concatenate(values) for values in zip(*self.parts, strict=True))
        return nearest, second, label

    def near_blocks(self) -> Origins:
        """Return the coarsest blocks that may have a solid within the cutoff."""
        width = self.h * self.cells * 2**TOP
        near = np.zeros(tuple(n >> TOP for n in self.table.shape), dtype=bool)
        low, high = (side[self.members] - self.collision.world.lower for side in self.collision.extents())
        far = REACH + self.collision.footprint.radius
        first = np.clip(np.floor((low - far) / width), 0, near.shape).astype(int)
        last = np.clip(np.floor((high + far) / width) + 1, 0, near.shape).astype(int)
        for (i, j), (i_end, j_end) in zip(first.tolist(), last.tolist(), strict=True):
            near[i:i_end, j:j_end] = True
        origins: Origins = np.argwhere(near) * (self.cells << TOP)
        return origins

    def reserve(self, level: int, origins: Origins) -> None:
        """Refuse blocks (k, 2) that are too many or take too many queries; a finer level takes about twice as many."""
        points = (self.size + len(origins)) * (self.cells + 1) ** 2
        if points > TUNING.block_points:
            raise TooLarge(float(np.sqrt(TUNING.block_points / points)))
        if level == TOP and len(origins) * self.cells**2 > TUNING.coarse_cells:
            raise TooLarge(float(np.sqrt(TUNING.coarse_cells / (len(origins) * self.cells**2))))
        middles = self.collision.world.lower + (origins + (self.cells << level) / 2) * self.h
        cutoff = REACH + self.collision.footprint.radius + self.cells * 2**level * self.h
        queries = self.collision.queried_points(middles, self.members, cutoff) * (self.cells + 1) ** 2 << level
        if queries > TUNING.queries:
            raise TooLarge(float(np.sqrt(TUNING.queries / queries)))

    def add(self, level: int, origins: Origins) -> Origins:
        """Sample blocks (k, 2) of a level and enter them; return the required blocks of the next finer level."""
        r, S, width = self.collision.footprint.radius, self.cells + 1, self.h * 2**level
        steps = np.stack(np.meshgrid(np.arange(S), np.arange(S), indexing="ij"), axis=-1)
        points = self.collision.world.lower + (origins[:, None, None] + (steps << level)) * self.h
        shape, cutoff = points.shape[:3], REACH + r
        walls = self.collision.nearest_walls(points.reshape(-1, 2), self.members, cutoff, width)
        first, second = walls.first.reshape(shape), walls.second.reshape(shape)
        found = Found(first, second, walls.which.reshape(shape), walls.away.reshape(points.shape))
        _go_on_inside(found, width)
        kind = np.zeros((len(origins), self.cells, self.cells), dtype=np.int8)
        if level:  # on the finest level what flat faces spare is not worth the query
            kind = self.collision.flat_cells(points, found, self.members, min(cutoff, r + TUNING.exact_cells * width))
        nearest, farther, finer = np.empty(shape), np.empty(shape), np.zeros((len(origins), 2, 2), dtype=np.bool_)
        _finish(found, kind, width, r, level == 0, nearest, farther, finer)
        self._enter(level, origins)
        self.parts.append((nearest.astype(np.float32), farther.astype(np.float32), found.which.astype(np.int32)))
        return self._children(level, origins, finer) if level else origins[:0]

    def _enter(self, level: int, origins: Origins) -> None:
        numbers = (self.size + np.arange(len(origins))) << LEVEL_BITS | level
        steps = np.arange(1 << level)
        i, j = (origins // self.cells).T
        self.table[i[:, None, None] + steps[:, None], j[:, None, None] + steps] = numbers[:, None, None]

    def _children(self, level: int, origins: Origins, finer: BoolArray) -> Origins:
        b, i, j = np.nonzero(finer)
        children: Origins = origins[b] + np.column_stack((i, j)) * (self.cells << (level - 1))
        span = self.collision.world.upper - self.collision.world.lower
        return children[np.all(children * self.h < span, axis=1)]


@kernel
def _go_on_inside(found, width):  # type: ignore[no-untyped-def]
    """Continue the distances of blocks (k, S, S), of some spacing [m], below 0 within solids."""
    for b in range(found.first.shape[0]):
        first, away = found.first[b], found.away[b]
        for i in range(first.shape[0]):
            for j in range(first.shape[1]):
                if first[i, j] <= 0.0:
                    first[i, j] = _depth(first, away, i, j, width)


@kernel
def _finish(found, kind, width, radius, finest, nearest, second, finer):  # type: ignore[no-untyped-def]
    """Turn the distances of blocks into clearances that are never too high, and mark quarters that are too coarse.

    Args: nearest walls as (k, S, S), kinds of cells (k, S - 1, S - 1), spacing [m], the robot's radius [m], whether
        there is no finer level; out: clearances from both walls (k, S, S) [m], and in which quarters finer blocks are
        required (k, 2, 2).
    """
    k, S = nearest.shape[:2]
    margin = np.empty((S, S))
    for b in range(k):
        first, other, which = found.first[b], found.second[b], found.which[b]
        near, far = nearest[b], second[b]
        for i in range(S):
            for j in range(S):
                near[i, j] = first[i, j] - radius
                far[i, j] = other[i, j] - radius
        for i in range(S - 1):
            for j in range(S - 1):
                if not finest and _coarse(near, far, which, kind[b, i, j], i, j, width, radius):
                    finer[b, 2 * i // (S - 1), 2 * j // (S - 1)] = True
        margin[:] = 0.0
        for i in range(S - 1):
            for j in range(S - 1):
                if kind[b, i, j] == CURVED and not finer[b, 2 * i // (S - 1), 2 * j // (S - 1)]:
                    _spread(near, i, j, width, radius, margin)
        for i in range(S):
            for j in range(S):
                near[i, j] -= margin[i, j]
                far[i, j] -= margin[i, j]


@inlined
def _depth(first, away, i, j, width):  # type: ignore[no-untyped-def]
    """Return a depth [m], at most 0, of a point inside a solid: as far down as distances around it fall off linearly.

    Then interpolation between points inside and outside is linear where the face is flat, and not too high elsewhere.
    """
    depth = -width
    for k in range(max(i - 1, 0), min(i + 2, first.shape[0])):
        for m in range(max(j - 1, 0), min(j + 2, first.shape[1])):
            d = first[k, m]
            if d > 0.0:
                depth = max(depth, d + width * (away[k, m, 0] * (i - k) + away[k, m, 1] * (j - m)) / d)
    return min(depth, 0.0)


@inlined
def _spread(near, i, j, width, radius, margin):  # type: ignore[no-untyped-def]
    """Raise the margins of a curved cell's corners to what interpolation in it may be too high by."""
    least = min(min(near[i, j], near[i + 1, j]), min(near[i, j + 1], near[i + 1, j + 1])) + radius
    bound = width * width / (4.0 * max(least - np.sqrt(2.0) * width, 0.5 * radius))
    for k in range(i, i + 2):
        for m in range(j, j + 2):
            margin[k, m] = max(margin[k, m], bound)


@inlined
def _coarse(near, far, which, kind, i, j, width, radius):  # type: ignore[no-untyped-def]
    """Return whether a cell is too wide for the walls in it."""
    a, b, c, d = near[i, j], near[i + 1, j], near[i, j + 1], near[i + 1, j + 1]
    least = min(min(a, b), min(c, d))
    if max(max(a, b), max(c, d)) <= -1.5 * width or least >= max(TUNING.band * width, TUNING.sharp * radius):
        return False
    if kind == CURVED and least < TUNING.band * width:
        return True
    if least >= TUNING.sharp * radius:
        return False
    m = which[i, j]
    if kind != FLAT and (which[i + 1, j] != m or which[i, j + 1] != m or which[i + 1, j + 1] != m):
        return True
    a, b, c, d = far[i, j], far[i + 1, j], far[i, j + 1], far[i + 1, j + 1]
    lowest, highest = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    return highest - lowest > 1.5 * width and lowest < TUNING.sharp * radius
