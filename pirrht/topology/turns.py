"""Count whole turns of curves as (marker, turn) pairs, found at the cuts that they cross, and sum them.

A path crosses few cuts, however many markers there are; all others keep the integer 0 and are never written down.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.geometry.arcs import along, center_of, turns_of_piece
from pirrht.jit.addresses import load_float64, load_int32
from pirrht.jit.jit import inlined, kernel
from pirrht.topology.cuts import sector, straight_turns, turn_at_cut


class Turns(NamedTuple):
    """Whole turns of k curves; those of curve i are the pairs first[i] to first[i+1]."""

    first: NDArray[np.int64]  # (k+1,)
    marker: NDArray[np.int32]  # (pairs,) index in all signatures
    turn: NDArray[np.int16]  # (pairs,) [turns]

    def dense(self, i: int, M: int) -> NDArray[np.int64]:
        """The integers of curve i for all markers, (M,) [turns]."""
        part = slice(self.first[i], self.first[i + 1])
        return spread(self.marker[part], self.turn[part], M)


def spread(marker: NDArray[np.int32], turn: NDArray[np.int16], M: int) -> NDArray[np.int64]:
    """Pairs, 2 x (pairs,), as integers for all markers, (M,) [turns]."""
    whole = np.zeros(M, dtype=np.int64)
    np.add.at(whole, marker, turn)
    return whole


class Piece(NamedTuple):
    """One arc or straight piece of a curve."""

    x: float  # where it begins [m]
    y: float  # [m]
    theta: float  # direction there [rad]
    curvature: float  # [1/m]
    length: float  # [m]


@inlined
def _column(x, left, cell, columns):  # type: ignore[no-untyped-def]
    return min(max(int((x - left) / cell), 0), columns - 1)


@kernel
def _around(cuts, piece, ex, ey, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append pairs of the markers inside the circle of an arc; number of pairs.

    An arc and its chord turn through different angles there, so the integer is the rounded sum of angles.
    """
    x, y, theta, curvature, length = piece
    gx, gy, r = cuts.goal_x, cuts.goal_y, 1.0 / abs(curvature)
    mid_x, mid_y = center_of(x, y, theta, curvature)
    low, high = _column(mid_y - r, cuts.low, cuts.cell, cuts.rows), _column(mid_y + r, cuts.low, cuts.cell, cuts.rows)
    west = _column(mid_x - r, cuts.left, cuts.cell, cuts.columns)
    east = _column(mid_x + r, cuts.left, cuts.cell, cuts.columns)
    for column in range(west, east + 1):
        begin = load_int32(cuts.first, column * cuts.rows + low)
        end = load_int32(cuts.first, column * cuts.rows + high + 1)
        for j in range(begin, end):
            i = load_int32(cuts.member, j)
            mx, my = load_float64(cuts.x, i), load_float64(cuts.y, i)
            if (mx - mid_x) ** 2 + (my - mid_y) ** 2 < 1.0 / curvature**2:
                own = turns_of_piece(x, y, theta, curvature, length, mx, my)
                rest = straight_turns(ex, ey, mx, my, gx, gy) - straight_turns(x, y, mx, my, gx, gy)
                whole = math.floor(own + rest + 0.5)
                if whole != 0:
                    marker[count], turn[count] = load_int32(cuts.marker, i), whole
                    count += 1
    return count


@kernel
def _pairs_of_piece(cuts, piece, ex, ey, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs (at most M) of a piece that ends at (ex, ey); number of pairs."""
    x, y, theta, curvature, length = piece
    bends = abs(curvature) * length >= 1e-9
    mid_x, mid_y, square = 0.0, 0.0, -1.0
    if bends:
        mid_x, mid_y = center_of(x, y, theta, curvature)
        square = 1.0 / curvature**2
    begin, end = sector(cuts, x, y, ex, ey)
    for i in range(begin, end):
        mx, my = load_float64(cuts.x, i), load_float64(cuts.y, i)
        whole = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, x, y, ex, ey)
        if whole != 0 and not (bends and (mx - mid_x) ** 2 + (my - mid_y) ** 2 < square):
            marker[count], turn[count] = load_int32(cuts.marker, i), whole
            count += 1
    return _around(cuts, piece, ex, ey, marker, turn, count) if bends else count


@kernel
def pairs_of_curve(cuts, start, curvature, length, to_goal, hx, hy, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs of a curve, in which a marker may come up more than once; number of pairs.

    Args: `Cuts`; the curve as in `Curves`, (3,) [m, m, rad], (P,) [1/m], (P,) [m]; whether it goes on straight from its
        end to the goal point, which crosses no cut; else the state (hx, hy) at its end [m]; pairs, 2 x (l,) [turns],
        with room for M more per piece, and how many are there already.
    """
    last = length.shape[0] - 1
    while last > 0 and length[last] <= 0.0:
        last -= 1
    x, y, theta = start[0], start[1], start[2]
    for p in range(last + 1):
        if length[p] > 0.0:
            ex, ey, end = along(x, y, theta, curvature[p], length[p])
            if p == last and not to_goal:  # the state itself: its side of a cut must not depend on rounding
                ex, ey = hx, hy
            piece = Piece(x, y, theta, curvature[p], length[p])
            count = _pairs_of_piece(cuts, piece, ex, ey, marker, turn, count)
            x, y, theta = ex, ey, end
    return count


@kernel
def summed(total, marker, turn, begin, count):  # type: ignore[no-untyped-def]
    """Sum pairs begin to count of one marker into one, in place, and drop zeros; the new count.

    Pairs are marker, turn (l,) [turns]; `total` (M,) are zeros, and zeros again afterwards.
    """
    for i in range(begin, count):
        total[marker[i]] += turn[i]
    kept = begin
    for i in range(begin, count):
        k = marker[i]
        if total[k] != 0:
            marker[kept], turn[kept] = k, total[k]
            total[k] = 0
            kept += 1
    return kept


@kernel
def key_of_pairs(marker, turn, begin, count, weights):  # type: ignore[no-untyped-def]
    """Additive key of pairs begin to count of marker, turn (l,) [turns], by weights (M,)."""
    key = np.int64(0)
    for i in range(begin, count):
        key += turn[i] * weights[marker[i]]
    return key
