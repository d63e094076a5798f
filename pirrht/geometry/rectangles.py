"""Few rectangles whose union is a set of cells.

Rectangles may overlap: a cross needs two of them, and three or more that do not. The least number is NP-hard to find
(Culberson and Reckhow 1994); greedily taken is the rectangle of occupied cells that holds most cells not yet covered,
component by component, and whatever others cover in the end is left out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pirrht.compiled.jit import kernel

Cells = NDArray[np.bool_]
Rectangles = NDArray[np.int64]


def cover(occupied: Cells, progress: Callable[[int], object] | None = None) -> Rectangles:
    """Rectangles (k, 4) of cells (rows, columns): first row, row after the last, and the same of columns.

    Args:
        progress: told how many more cells are covered, now and then.
    """
    labels, count = ndimage.label(occupied)
    found = [np.zeros((0, 4), np.int64)]
    for label, (rows, columns) in enumerate(ndimage.find_objects(labels, count), start=1):
        corner = np.array([rows.start, rows.start, columns.start, columns.start])
        found.append(corner + _needed(_greedy(labels[rows, columns] == label, progress)))
    return np.vstack(found)


def union(rectangles: Rectangles, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """How many rectangles cover each cell of a grid."""
    depth = np.zeros(shape, np.int64)
    for r0, r1, c0, c1 in rectangles:
        depth[r0:r1, c0:c1] += 1
    return depth


def _greedy(occupied: Cells, progress: Callable[[int], object] | None) -> Rectangles:
    missing, found = occupied.copy(), []
    while missing.any():
        sums = np.zeros((occupied.shape[0] + 1, occupied.shape[1] + 1), np.int64)
        np.cumsum(np.cumsum(missing, axis=0), axis=1, out=sums[1:, 1:])
        best = np.zeros(4, np.int64)
        gain = _best(occupied, sums, best)
        missing[best[0] : best[1], best[2] : best[3]] = False
        found.append(best)
        if progress is not None:
            progress(int(gain))
    return np.array(found)


def _needed(rectangles: Rectangles) -> Rectangles:
    """Without those that the others cover."""
    depth = union(rectangles, tuple(rectangles[:, [1, 3]].max(axis=0)))
    keep = np.ones(len(rectangles), np.bool_)
    for i in np.argsort(np.prod(rectangles[:, 1::2] - rectangles[:, ::2], axis=1), kind="stable"):
        r0, r1, c0, c1 = rectangles[i]
        if depth[r0:r1, c0:c1].min() > 1:
            depth[r0:r1, c0:c1] -= 1
            keep[i] = False
    return rectangles[keep]


@kernel
def _best(occupied, sums, best):  # type: ignore[no-untyped-def]
    """Fill `best` with the occupied rectangle that holds most missing cells; `sums` are their prefix sums."""
    rows, columns = occupied.shape
    height = np.zeros(columns + 1, np.int64)
    start, level = np.empty(columns + 1, np.int64), np.empty(columns + 1, np.int64)
    most = 0
    for r in range(rows):
        top = 0
        for c in range(columns + 1):
            if c < columns:
                height[c] = height[c] + 1 if occupied[r, c] else 0
            begin = c
            while top > 0 and level[top - 1] > height[c]:
                top -= 1
                begin, up = start[top], r + 1 - level[top]
                gain = sums[r + 1, c] - sums[up, c] - sums[r + 1, begin] + sums[up, begin]
                if gain > most:
                    most = gain
                    best[0], best[1], best[2], best[3] = up, r + 1, begin, c
            if height[c] > 0 and (top == 0 or level[top - 1] < height[c]):
                start[top], level[top] = begin, height[c]
                top += 1
    return most
