"""Find the cuts that a path crosses, without asking every marker.

The cut of a marker is the ray that leaves it away from the goal point. Seen from the goal point it lies in one
direction, so a segment can only cross cuts whose directions it passes: markers are sorted by direction, and a table of
equal buckets tells where a sector begins. Markers of a sector are tested exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.arcs import turns_of_chord
from pirrht.jit.addresses import load_float64, load_int32, load_int64
from pirrht.jit.jit import inlined, kernel

FEW = 8  # up to so many markers are all asked: that is faster than finding their sector
WIDER = 1e-9  # sectors are widened by this much for rounding, of 4 for a whole turn
THROUGH = 1e-6  # a segment that passes the goal point this close, against its length, may pass it on either side


class Index(NamedTuple):
    """Markers by direction from the goal point and by position, as numbers that kernels can take cheaply."""

    goal_x: float  # goal point [m]
    goal_y: float  # [m]
    M: int  # number of markers
    buckets: int  # B sectors of equal width; 1: all markers are always asked
    start: int  # address of int32 (2B+1,): first marker of each sector, twice around
    x: int  # address of float64 (2M,): markers by direction, twice around [m]
    y: int  # address of float64 (2M,) [m]
    weight: int  # address of int64 (2M,): their additive keys
    marker: int  # address of int32 (2M,): their indices in all signatures
    left: float  # corner of a lattice over the markers [m]
    low: float  # [m]
    cell: float  # its cells' width [m]
    columns: int  # along x
    rows: int  # along y
    first: int  # address of int32 (columns * rows + 1,): first member of each cell
    member: int  # address of int32 (M,): indices in the order by direction


class Cuts(Index):
    """An index together with the arrays that its addresses point to."""

    arrays: tuple[NDArray[np.float64] | NDArray[np.int64] | NDArray[np.int32], ...]

    @classmethod
    def of(cls, markers: Array, goal: Array, weights: NDArray[np.int64]) -> Cuts:
        """Sort markers (M, 2) around the goal point (2,) [m]; `weights` (M,) are the additive keys of one turn."""
        M = len(markers)
        B = M if M > FEW else 1
        away = np.array([direction(dx, dy) for dx, dy in markers - goal]).reshape(M)
        order = np.argsort(away, kind="stable")
        start = np.searchsorted(np.minimum((away[order] * (0.25 * B)).astype(np.int64), B - 1), np.arange(B + 1))
        twice = np.concatenate([order, order])
        left, low, cell, columns, rows, first, member = _lattice(markers[order])
        arrays = (
            np.concatenate([start[:B], start + M]).astype(np.int32), np.ascontiguousarray(markers[twice, 0]),
            np.ascontiguousarray(markers[twice, 1]), weights[twice], twice.astype(np.int32), first, member,
        )  # fmt: skip
        at = [array.ctypes.data for array in arrays]
        cuts = cls(
            goal_x=float(goal[0]), goal_y=float(goal[1]), M=M, buckets=B,
            start=at[0], x=at[1], y=at[2], weight=at[3], marker=at[4],
            left=left, low=low, cell=cell, columns=columns, rows=rows, first=at[5], member=at[6],
        )  # fmt: skip
        cuts.arrays = arrays
        return cuts


def _lattice(markers: Array) -> tuple[float, float, float, int, int, NDArray[np.int32], NDArray[np.int32]]:
    """Lay about as many square cells as markers (M, 2); list the markers of each."""
    M = len(markers)
    low, span = (markers.min(axis=0), np.ptp(markers, axis=0)) if M else (np.zeros(2), np.zeros(2))
    cell = float(max(np.sqrt(span.prod() / max(M, 1)), span.max() / max(M, 1), 1e-9))
    columns, rows = (int(n) for n in np.floor(span / cell) + 1)
    at = np.floor((markers - low) / cell).astype(np.int64)
    number = np.minimum(at[:, 0], columns - 1) * rows + np.minimum(at[:, 1], rows - 1)
    member = np.argsort(number, kind="stable")
    first = np.searchsorted(number[member], np.arange(columns * rows + 1))
    return float(low[0]), float(low[1]), cell, columns, rows, first.astype(np.int32), member.astype(np.int32)


@inlined
def direction(dx, dy):  # type: ignore[no-untyped-def]
    """Return a number from 0 to 4 that grows with the angle of (dx, dy); 0 where there is none."""
    size = abs(dx) + abs(dy)
    if size == 0.0:
        return 0.0
    part = dy / size
    if dx < 0.0:
        return 2.0 - part
    return part if part >= 0.0 else 4.0 + part


@inlined
def sector(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Range, end excluded, by direction of all markers whose cuts the segment (ax, ay) to (cx, cy) [m] can cross."""
    B = cuts.buckets
    if B == 1:
        return 0, cuts.M
    ux, uy, vx, vy = ax - cuts.goal_x, ay - cuts.goal_y, cx - cuts.goal_x, cy - cuts.goal_y
    cross, dot = ux * vy - uy * vx, ux * vx + uy * vy
    if dot <= 0.0 and abs(cross) <= -THROUGH * dot:
        return 0, cuts.M
    low, high = direction(ux, uy), direction(vx, vy)
    if cross < 0.0:
        low, high = high, low
    if high < low - WIDER:
        high += 4.0
    first = math.floor((low - WIDER) * 0.25 * B)
    last = math.floor((high + WIDER) * 0.25 * B)
    if first < 0:
        first, last = first + B, last + B
    last = min(last, first + B - 1)
    return load_int32(cuts.start, first), load_int32(cuts.start, last + 1)


@inlined
def turn_at_cut(mx, my, gx, gy, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Turn, -1, 0 or 1, that the segment from a to c [m] adds by crossing the cut of the marker (mx, my).

    (gx, gy) is the goal point [m]. Points on the cut count as on its right (`straight_turns`); left turns are positive.
    """
    bx, by = gx - mx, gy - my
    ax, ay, cx, cy = ax - mx, ay - my, cx - mx, cy - my
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
    ax, ay, bx, by = px - mx, py - my, gx - mx, gy - my
    # On the cut itself the angle jumps; it counts as the right side, as `cross > 0` does at crossings.
    on_cut = ax * by - ay * bx == 0.0 and ax * bx + ay * by < 0.0
    return -0.5 if on_cut else turns_of_chord(ax, ay, bx, by)


@kernel
def key_of_segment(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Additive key of the turns that the segment from (ax, ay) to (cx, cy) [m] adds."""
    return key_of_step(cuts, ax, ay, cx, cy)


@inlined
def key_of_step(cuts, ax, ay, cx, cy):  # type: ignore[no-untyped-def]
    """Additive key of the turns that the segment from (ax, ay) to (cx, cy) [m] adds; inlined for long loops."""
    key = np.int64(0)
    begin, end = sector(cuts, ax, ay, cx, cy)
    for i in range(begin, end):
        mx, my = load_float64(cuts.x, i), load_float64(cuts.y, i)
        turn = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, ax, ay, cx, cy)
        if turn != 0:
            key += turn * load_int64(cuts.weight, i)
    return key


@inlined
def crossed(cuts, ax, ay, bx, by, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs of a segment from (ax, ay) to (bx, by) [m] to marker, turn (l,) [turns]; number of pairs."""
    begin, end = sector(cuts, ax, ay, bx, by)
    for k in range(begin, end):
        mx, my = load_float64(cuts.x, k), load_float64(cuts.y, k)
        whole = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, ax, ay, bx, by)
        if whole != 0:
            marker[count], turn[count] = load_int32(cuts.marker, k), whole
            count += 1
    return count
