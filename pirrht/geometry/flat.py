"""Find cells in which distances are linear: next to a flat face interpolation is exact, however wide the cell is.

A convex distance whose gradient is the same at the corners of a cell is linear in it. A cell is certified if this is so
for every solid that can be the nearest anywhere in the cell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.shapes import PROBE, Solids, bin_at, bins_of, distance_from, offset_from
from pirrht.geometry.walls import Found, square_to
from pirrht.jit.jit import inlined, kernel

CURVED, BENT, FLAT = 0, 1, 2  # what is known of a cell: nothing; several faces, each of them flat; one face only


def flat_cells(
    solids: Solids, closed: BoolArray, members: IntArray, points: Array, found: Found, height: float, cutoff: float
) -> NDArray[np.int8]:
    """Return CURVED, BENT or FLAT for the cells of square blocks, (k, S - 1, S - 1).

    Args:
        solids: M obstacles.
        closed: whether a solid has a closed form, (M,).
        members: indices of the solids that count, (l,).
        points: of blocks, (k, S, S, 2) [m], all at one height [m].
        found: nearest walls as (k, S, S, ...), distances continued below 0 within solids.
        height: of all points [m].
        cutoff: cells about as far from the nearest solid are CURVED, without a query; at most the
            cutoff of `found` [m].
    """
    k, S = points.shape[:2]
    out = np.zeros((k, S - 1, S - 1), dtype=np.int8)
    bins = bins_of(solids, members, points.reshape(-1, 2), cutoff)
    width = float(points[0, 1, 0, 0] - points[0, 0, 0, 0])
    _judge(solids, closed, bins, points, found, width, height, cutoff, out)
    return out


@kernel
def _judge(solids, closed, bins, points, found, width, height, cutoff, out):  # type: ignore[no-untyped-def]
    near = solids.low, solids.high, bins.member  # taken out of the records once: that costs more than a cell
    corner = np.empty((4, 5))  # x, y, distance, and the vector from the nearest point [m]
    label = np.empty(4, dtype=np.int64)
    for b in range(out.shape[0]):
        first, which, away = found.first[b], found.which[b], found.away[b]
        for i in range(out.shape[1]):
            for j in range(out.shape[2]):
                low = min(min(first[i, j], first[i + 1, j]), min(first[i, j + 1], first[i + 1, j + 1]))
                high = max(max(first[i, j], first[i + 1, j]), max(first[i, j + 1], first[i + 1, j + 1]))
                # Some point of the cell is as near to a solid as to the nearest: this far from the middle at most.
                most = max(low, 0.0) + 3.0 * math.sqrt(0.5) * width
                if most >= cutoff or high <= 0.0:
                    continue
                for c in range(4):
                    p, q = i + c // 2, j + c % 2
                    corner[c, 0], corner[c, 1], corner[c, 2] = points[b, p, q, 0], points[b, p, q, 1], first[p, q]
                    corner[c, 3], corner[c, 4], label[c] = away[p, q, 0], away[p, q, 1], which[p, q]
                out[b, i, j] = _kind(solids, closed, bins, near, corner, label, most, low <= 0.0, height)


@inlined
def _kind(solids, closed, bins, near, corner, label, most, entered, height):  # type: ignore[no-untyped-def]
    """Return the kind of one cell, whose solids are at most so far from its middle [m]; `entered` by one of them."""
    x, y = 0.5 * (corner[0, 0] + corner[3, 0]), 0.5 * (corner[0, 1] + corner[3, 1])
    begin, end = bin_at(bins, x, y)
    left, right, member = near
    kind, count, nx, ny = FLAT, 0, 0.0, 0.0
    for k in range(begin, end):
        m = member[k]
        if square_to(left, right, m, x, y) >= most * most:
            continue
        if not closed[m]:
            return CURVED
        mine = m == label[0] or m == label[1] or m == label[2] or m == label[3]
        if not mine and distance_from(solids, m, x, y, height) >= most:
            continue
        flat, ux, uy = _face(solids, m, corner, label, height)
        if not flat or (entered and count > 0):
            return CURVED
        if count > 0 and not _same(nx, ny, ux, uy):
            kind = BENT
        count, nx, ny = count + 1, ux, uy
    return kind


@inlined
def _same(nx, ny, ux, uy):  # type: ignore[no-untyped-def]
    return abs(nx * uy - ny * ux) < 1e-7 and nx * ux + ny * uy > 0.0


@inlined
def _face(solids, m, corner, label, height):  # type: ignore[no-untyped-def]
    """Return whether corners outside of solid m see one flat face of it, and the unit vector (x, y) away from that.

    At corners inside the distance has to be continued at most as far up as the face allows.
    """
    nx, ny, level, known = 0.0, 0.0, 0.0, False
    for c in range(4):
        x, y, d = corner[c, 0], corner[c, 1], corner[c, 2]
        if d <= 0.0:
            continue
        ex, ey = corner[c, 3], corner[c, 4]
        if label[c] != m:
            d = distance_from(solids, m, x, y, height)
            if d <= PROBE:
                return False, 0.0, 0.0
            ex, ey = offset_from(solids, m, x, y, height)
        if abs(math.sqrt(ex * ex + ey * ey) - d) > 1e-9 * (1.0 + d):  # rounding
            return False, 0.0, 0.0
        ex, ey = ex / d, ey / d
        if known and not _same(nx, ny, ex, ey):
            return False, 0.0, 0.0
        nx, ny, level, known = ex, ey, d - ex * x - ey * y, True
    for c in range(4):
        if corner[c, 2] <= 0.0 and corner[c, 2] > level + nx * corner[c, 0] + ny * corner[c, 1] + 1e-9:  # rounding
            return False, 0.0, 0.0
    return known, nx, ny
