"""Count the whole turns of segments and arcs about static markers at the cuts that they cross.

The cut of a marker is the ray that leaves it away from the goal point. Seen from the goal point it lies in one
direction, so a segment can only cross cuts whose directions it passes: markers are sorted by direction, and a table of
equal buckets tells where a sector begins. Markers of a sector are tested exactly. A path crosses few cuts, however many
markers there are: its turns are (marker, turn) pairs, all other integers are 0 and never written down.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.arcs import along, center_of, turns_of_chord, turns_of_piece
from pirrht.jit.jit import borrowing, inlined, load_float64, load_int32, load_int64
from pirrht.jit.records import Held
from pirrht.topology.tuning import TUNING


class CutTable(NamedTuple):
    """Markers by direction from the goal point, as numbers that kernels can take cheaply."""

    goal_x: float  # goal point [m]
    goal_y: float  # [m]
    M: int  # number of markers
    buckets: int  # B sectors of equal width; 1: all markers are always asked
    start: int  # address of int32 (2B+1,): first marker of each sector, twice around
    x: int  # address of float64 (2M,): markers by direction, twice around [m]
    y: int  # address of float64 (2M,) [m]
    weight: int  # address of int64 (2M,): their additive keys
    marker: int  # address of int32 (2M,): their indices in all signatures


class Cuts(Held, CutTable):
    """A `CutTable` together with the arrays that its addresses point to."""

    @classmethod
    def of(cls, markers: Array, goal: Array, weights: NDArray[np.int64]) -> "Cuts":
        """Sort markers (M, 2) around the goal point (2,) [m]; `weights` (M,) are the additive keys of one turn."""
        M = len(markers)
        B = M if TUNING.few_markers < M else 1
        away = np.array([direction(dx, dy) for dx, dy in markers - goal]).reshape(M)
        order = np.argsort(away, kind="stable")
        start = np.searchsorted(np.minimum((away[order] * (0.25 * B)).astype(np.int64), B - 1), np.arange(B + 1))
        twice = np.concatenate([order, order])
        x, y = (np.ascontiguousarray(column[twice]) for column in markers.T)
        arrays = np.concatenate([start[:B], start + M]).astype(np.int32), x, y, weights[twice], twice.astype(np.int32)
        return cls.holding(float(goal[0]), float(goal[1]), M, B, *arrays)


@inlined
def direction(dx, dy):  # type: ignore[no-untyped-def]
    """Return a number from 0 to 4 that grows with the angle of (dx, dy); 0 where there is none."""
    if dx == 0.0 and dy == 0.0:
        return 0.0
    part = dy / (abs(dx) + abs(dy))
    if dx < 0.0:
        return 2.0 - part
    return part if part >= 0.0 else 4.0 + part


@inlined
def sector(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Range, end excluded, by direction of all markers whose cuts the segment (ax, ay) to (cx, cy) [m] can cross."""
    B = cuts.buckets
    if B == 1:
        return 0, cuts.M

    ux = ax - cuts.goal_x
    uy = ay - cuts.goal_y
    vx = cx - cuts.goal_x
    vy = cy - cuts.goal_y

    cross = ux * vy - uy * vx
    dot = ux * vx + uy * vy

    if dot <= 0.0 and abs(cross) <= -TUNING.goal_margin * dot:
        return 0, cuts.M
    low = direction(ux, uy)
    high = direction(vx, vy)

    if cross < 0.0:
        low, high = high, low
    if high < low - TUNING.sector_margin:
        high += 4.0
    first = math.floor((low - TUNING.sector_margin) * 0.25 * B)
    last = math.floor((high + TUNING.sector_margin) * 0.25 * B)
    if first < 0:
        first = first + B
        last = last + B
    last = min(last, first + B - 1)
    return load_int32(cuts.start, first), load_int32(cuts.start, last + 1)


@inlined
def turn_at_cut(mx, my, gx, gy, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Turn, -1, 0 or 1, that the segment from a to c [m] adds by crossing the cut of the marker (mx, my).

    (gx, gy) is the goal point [m]. Points on the cut count as on its right (`straight_turns`); left turns are positive.
    """
    bx, by = gx - mx, gy - my
    ax, ay = ax - mx, ay - my
    cx, cy = cx - mx, cy - my
    other = cx * by - cy * bx > 0.0
    if (ax * by - ay * bx > 0.0) == other:
        return 0
    left = ax * cy - ay * cx >= 0.0
    if other:
        return 1 if left else 0
    return 0 if left else -1


@inlined
def straight_turns(px, py, mx, my, gx, gy):  # type: ignore[no-untyped-def]
    """Angle [turns] of the straight line from p to the goal point g as seen from a marker (mx, my) [m]."""
    ax, ay = px - mx, py - my
    bx, by = gx - mx, gy - my
    # On the cut itself the angle jumps; it counts as the right side, as `cross > 0` does at crossings.
    on_cut = ax * by - ay * bx == 0.0 and ax * bx + ay * by < 0.0
    return -0.5 if on_cut else turns_of_chord(ax, ay, bx, by)


@inlined
def key_of_step(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Additive key of the turns that the segment from (ax, ay) to (cx, cy) [m] adds; inlined for long loops."""
    key = np.int64(0)
    begin, end = sector(cuts, ax, ay, cx, cy)
    for i in range(begin, end):
        mx = load_float64(cuts.x, i)
        my = load_float64(cuts.y, i)
        turn = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, ax, ay, cx, cy)
        if turn != 0:
            key += turn * load_int64(cuts.weight, i)
    return key


@inlined
def keys_of_steps(cuts, f, rows, n, keys, at):  # type: ignore[no-untyped-def]
    """Add the keys of n segments, (x, y) to (to_x, to_y) [m] in f from four places on, to `keys` from `at` on."""
    X, Y, NX, NY = rows
    if TUNING.few_markers < cuts.M:
        for k in range(n):
            keys[at + k] += key_of_step(cuts, f[X + k], f[Y + k], f[NX + k], f[NY + k])
        return
    gx = np.float32(cuts.goal_x)
    gy = np.float32(cuts.goal_y)

    for c in range(cuts.M):
        mx = np.float32(load_float64(cuts.x, c))
        my = np.float32(load_float64(cuts.y, c))
        weight = load_int64(cuts.weight, c)
        for k in range(n):
            turn = turn_at_cut(mx, my, gx, gy, f[X + k], f[Y + k], f[NX + k], f[NY + k])
            keys[at + k] += turn * weight


@inlined
def crossed(cuts, ax, ay, bx, by, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs of a segment from (ax, ay) to (bx, by) [m] to marker, turn (l,) [turns]; number of pairs."""
    begin, end = sector(cuts, ax, ay, bx, by)
    for k in range(begin, end):
        mx = load_float64(cuts.x, k)
        my = load_float64(cuts.y, k)
        whole = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, ax, ay, bx, by)
        if whole != 0:
            marker[count], turn[count] = load_int32(cuts.marker, k), whole
            count += 1
    return count


@borrowing
def _pairs_of_piece(cuts, piece, ex, ey, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs (at most M) of a piece (x, y, theta, curvature, length) to (ex, ey) [m]; number of pairs.

    About markers inside the circle an arc and its chord turn differently: the integer is the rounded sum of angles.
    """
    x, y, theta, curvature, length = piece
    gx, gy, bends = cuts.goal_x, cuts.goal_y, abs(curvature) * length >= 1e-9
    mid_x, mid_y, square = 0.0, 0.0, -1.0
    if bends:
        mid_x, mid_y = center_of(x, y, theta, curvature)
        square = 1.0 / curvature**2
    begin, end = sector(cuts, x, y, ex, ey)
    for i in range(begin, end):
        mx = load_float64(cuts.x, i)
        my = load_float64(cuts.y, i)
        whole = turn_at_cut(mx, my, gx, gy, x, y, ex, ey)
        if whole != 0 and not (mx - mid_x) ** 2 + (my - mid_y) ** 2 < square:
            marker[count], turn[count] = load_int32(cuts.marker, i), whole
            count += 1
    for i in range(cuts.M if bends else 0):
        mx = load_float64(cuts.x, i)
        my = load_float64(cuts.y, i)

        if (mx - mid_x) ** 2 + (my - mid_y) ** 2 < square:
            rest = straight_turns(ex, ey, mx, my, gx, gy) - straight_turns(x, y, mx, my, gx, gy)
            whole = math.floor(turns_of_piece(x, y, theta, curvature, length, mx, my) + rest + 0.5)
            if whole != 0:
                marker[count], turn[count] = load_int32(cuts.marker, i), whole
                count += 1
    return count


@borrowing
def pairs_of_curve(cuts, curve, to_goal, head, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs of a curve to marker, turn (l,) [turns], with space for M more per piece; number of pairs.

    A marker may come up more than once. The curve is start (3,) [m, m, rad], curvature (P,) [1/m] and length (P,) [m];
    `to_goal` tells whether it goes on straight from its end to the goal point, which crosses no cut, and `head` (2) is
    the place at its end [m], exactly.
    """
    start, curvature, length = curve
    last = length.shape[0] - 1
    while last > 0 and length[last] <= 0.0:
        last -= 1
    x, y = start[0], start[1]
    theta = start[2]

    for p in range(last + 1):
        if length[p] > 0.0:
            ex, ey, end = along(x, y, theta, curvature[p], length[p])
            if p == last and not to_goal:  # the state itself: its side of a cut must not depend on rounding
                ex, ey = head
            count = _pairs_of_piece(cuts, (x, y, theta, curvature[p], length[p]), ex, ey, marker, turn, count)
            x, y, theta = ex, ey, end
    return count
