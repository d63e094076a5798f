"""Cover a set of cells by few rectangles, in time linear in their number.

Rectangles may overlap: a cross takes two of them, and three or more that do not. The least number is NP-hard to find
(Culberson and Reckhow 1994). Candidates are the maximal runs of each row and each column, stretched sideways as far as
they stay occupied. Taken are, largest first, those that cover a cell which no earlier one covers, then of these,
smallest first, those that cover a cell which no later one covers; whatever others cover in the end is left out.

Boxes in space do not overlap. They are runs along an axis, joined to slabs and these to boxes where their ends agree.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from pirrht.jit.jit import inlined, kernel

Cells = NDArray[np.bool_]
Rectangles = NDArray[np.int64]


def cover(occupied: Cells) -> Rectangles:
    """Return rectangles (k, 4) of cells, largest first: first row, row after the last, and so for columns."""
    found = np.unique(
        np.vstack([_stretched(occupied), _stretched(np.ascontiguousarray(occupied.T))[:, [2, 3, 0, 1]]]), axis=0
    )
    found = found[np.argsort(-np.prod(found[:, 1::2] - found[:, ::2], axis=1), kind="stable")]
    for _ in range(2):  # largest first, then smallest first
        found = found[_taken(found, *occupied.shape)][::-1]
    return _needed(found[::-1], occupied.shape)[::-1]


def blocks(occupied: Cells) -> Rectangles:
    """Return boxes (k, 6) that cover the occupied of voxels (nx, ny, nz) once: first of each axis, then after the last.

    Of the orders in which axes can be joined, that with the fewest boxes counts.
    """
    return min((_joined(occupied, axes) for axes in permutations(range(3))), key=len)


def _joined(occupied: Cells, axes: Sequence[int]) -> Rectangles:
    """Return boxes of runs along the last of the axes, joined along the second and then along the first."""
    step = np.diff(np.pad(occupied.transpose(axes), ((0, 0), (0, 0), (1, 1))).view(np.int8), axis=2)
    found = np.hstack([np.argwhere(step > 0), np.argwhere(step < 0) + np.array([1, 1, 0])])
    for axis in (1, 0):
        others = [column for column in range(6) if column % 3 != axis]
        found = found[np.lexsort(found[:, [axis, *others]].T)]
        apart = np.any(found[1:, others] != found[:-1, others], axis=1) | (found[1:, axis] != found[:-1, axis + 3])
        ends = found[np.append(apart, True)[: len(found)], axis + 3]
        found = found[np.append(True, apart)[: len(found)]]
        found[:, axis + 3] = ends
    order = np.argsort(axes)
    return found[:, [*order, *(order + 3)]]


def union(rectangles: Rectangles, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """Count the rectangles that cover each cell of a grid."""
    r0, r1, c0, c1 = rectangles.T
    depth = np.zeros((shape[0] + 1, shape[1] + 1), np.int32)
    for rows, columns, sign in ((r0, c0, 1), (r1, c1, 1), (r0, c1, -1), (r1, c0, -1)):
        np.add.at(depth, (rows, columns), sign)
    for axis in (0, 1):
        np.cumsum(depth, axis=axis, out=depth)
    return depth[:-1, :-1]


def _stretched(occupied: Cells) -> Rectangles:
    """Return the maximal run of each row, stretched over rows above and below in which all its cells are occupied."""
    rows, columns = occupied.shape
    step = np.diff(np.pad(occupied, ((0, 0), (1, 1))).view(np.int8), axis=1)
    row, first = np.nonzero(step > 0)
    end = np.nonzero(step < 0)[1]
    if not len(row):
        return np.zeros((0, 4), np.int64)
    runs = np.column_stack([row * columns + first, row * columns + end]).ravel()
    occupied_along = np.zeros((2, rows * columns + 1), np.int32)  # in a row, upwards and downwards from each
    for heights, order in zip(occupied_along, (range(rows), range(rows - 1, -1, -1)), strict=True):
        grid = heights[:-1].reshape(rows, columns)
        last = np.zeros(columns, np.int32)

        for r in order:
            last = grid[r] = (last + 1) * occupied[r]
    up, down = (np.minimum.reduceat(heights, runs)[::2] for heights in occupied_along)
    return np.column_stack([row - up + 1, row + down, first, end])


def _needed(rectangles: Rectangles, shape: tuple[int, ...]) -> Rectangles:
    """Return the rectangles without those that the others cover; only few are in doubt."""
    depth = union(rectangles, shape)
    alone = np.zeros((shape[0] + 1, shape[1] + 1), np.int32)  # cells covered once, left of and above each corner
    np.cumsum(np.cumsum(depth == 1, axis=0, dtype=np.int32), axis=1, out=alone[1:, 1:])
    r0, r1, c0, c1 = rectangles.T
    keep = np.ones(len(rectangles), np.bool_)
    for i in np.flatnonzero(alone[r1, c1] - alone[r0, c1] - alone[r1, c0] + alone[r0, c0] == 0).tolist():
        part = depth[r0[i] : r1[i], c0[i] : c1[i]]
        if part.min() > 1:
            part -= 1
            keep[i] = False
    return rectangles[keep]


@kernel
def _taken(rectangles, rows, columns):  # type: ignore[no-untyped-def]
    """Return which rectangles (k,) cover a cell of a grid that no earlier one does.

    `right[r, c]` is where to look for the first column from c on that is not covered in row r, (rows, columns + 1);
    `down[c, r]` is the same of rows. A rectangle takes as many searches as its shorter side has cells, and one for
    each cell it covers first: together at most as many as there are cells, since each candidate has a run for a side.
    """
    right = np.empty((rows, columns + 1), np.int32)
    down = np.empty((columns, rows + 1), np.int32)
    right[:] = np.arange(columns + 1)
    down[:] = np.arange(rows + 1)
    taken = np.zeros(len(rectangles), np.bool_)
    for k in range(len(rectangles)):
        r0, r1, c0, c1 = rectangles[k]
        taken[k] = _cover(right, down, r0, r1, c0, c1) if r1 - r0 <= c1 - c0 else _cover(down, right, c0, c1, r0, r1)
    return taken


@kernel
def _cover(along, across, first, end, low, high):  # type: ignore[no-untyped-def]
    """Cover the lines from `first` to `end`, each from `low` to `high`; return whether that is new to any cell."""
    new = False
    for line in range(first, end):
        at = root_of(along[line], low)
        while at < high:
            along[line, at] = at + 1
            across[at, line] = line + 1
            new = True
            at = root_of(along[line], at)
    return new


@inlined
def root_of(links, at):  # type: ignore[no-untyped-def]
    """Return the first place from `at` on that links to itself; the path there is halved."""
    while links[at] != at:
        links[at] = links[links[at]]
        at = links[at]
    return at
