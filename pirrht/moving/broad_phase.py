"""List moving obstacles that may be near a path: by place and step of the grid for all paths, or anew for one path.

For all paths, time is cut into stretches of whole steps and space into cells. A cell of a stretch has all obstacles
within the cutoff of any of its places at any time of the stretch. Beyond that cutoff, or outside of the cells, all
obstacles count. For one path, a list is kept while none can have come nearer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import FASTEST, PERIOD, disc_of, of_body, outside_of, piece_of, restart_of
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.moving.tuning import CACHED_BODY, CACHED_LIST, CELL_STATE, TUNING

REACHES = TUNING.push_cutoff
CELL, PAST = range(CELL_STATE)
EVERYBODY, NOBODY = -1, -2


class Nearby(NamedTuple):
    """Moving obstacles near each cell in each stretch of T steps."""

    cutoff: float  # to which bodies count [m]; negative: nothing moves
    corner: tuple[float, float]  # least x and y of the cells [m]
    per: float  # one over the side of a cell [1/m]
    shape: tuple[int, int]  # number of cells along x and y
    stretch: IntArray  # (T,) number of the stretch that each step is in
    first: NDArray[np.int32]  # (cells + 1,) where in `body` those of a cell of a stretch begin, (stretch, x, y) in turn
    body: NDArray[np.int32]  # their numbers, ascending in each cell
    jumps: Array  # (k + 1,) when bodies are suddenly elsewhere, ascending, on their clock, and infinity [s]

    @classmethod
    def of(cls, moving: MovingObstacleArrays, frame: Sequence[float], times: Array, cutoff: float) -> Nearby:
        """Build cells for paths in a frame (x, y, X, Y) [m] whose steps end at times (T + 1,) [s], and a cutoff [m]."""
        stretch, bounds = _stretches(times)
        left, low, right, high = map(float, frame)
        wide, deep, most = right - left, high - low, TUNING.cells / (len(bounds) - 1)
        pitch = max(TUNING.cell_side * cutoff, math.sqrt(wide * deep / most), max(wide, deep) / most)
        shape = max(1, math.ceil(wide / pitch)), max(1, math.ceil(deep / pitch))
        cells = (left, low), 1.0 / pitch, shape
        first = np.zeros(shape[0] * shape[1] * (len(bounds) - 1) + 1, np.int32)
        _mark(moving, bounds, cells, cutoff + 1e-6, first[1:], np.empty(0, np.int32))
        np.cumsum(first, out=first)
        body = np.empty(first[-1], np.int32)
        _mark(moving, bounds, cells, cutoff + 1e-6, first[:-1].copy(), body)
        return cls(cutoff, *cells, stretch, first, body, _jumps(moving, times[0], times[-1]))


NO_NEARBY = Nearby(
    -1.0, (0.0, 0.0), 0.0, (0, 0),
    np.zeros(0, np.int64), np.zeros(1, np.int32), np.zeros(0, np.int32), np.full(1, np.inf),
)  # fmt: skip


def _stretches(times: Array) -> tuple[IntArray, Array]:
    """Assign steps that end at times (T + 1,) to stretches, (T,), and return the times that bound these."""
    stretch, bounds = np.zeros(len(times) - 1, np.int64), [float(times[0])]
    for i in range(len(stretch)):
        if times[i] - bounds[-1] >= TUNING.stretch:
            bounds.append(float(times[i]))
        stretch[i] = len(bounds) - 1
    return stretch, np.array([*bounds, float(times[-1])])


@kernel
def _jumps(moving, begin, end):  # type: ignore[no-untyped-def]
    """Return times between two [s] at which obstacles are suddenly elsewhere, ascending, and infinity."""
    found = [math.inf]
    for j in range(moving.J):
        t = restart_of(moving, j, begin)
        while t < end:
            found.append(t)
            t += of_body(moving, j, PERIOD)
    return np.sort(np.array(found))


@kernel
def _mark(moving, bounds, cells, cutoff, vacant, body):  # type: ignore[no-untyped-def]
    """Note which bodies count in which cells of stretches that begin, and end, at bounds (stretches + 1,) [s].

    `cells` are their corner [m], one over their side [1/m] and numbers; a cell is its middle, grown by half its
    diagonal. `vacant` (cells,) holds where in `body` its next one goes, counted up; without `body` it counts only.
    """
    _, per, shape = cells
    seen = np.full(shape[0] * shape[1], -1)
    for s in range(bounds.shape[0] - 1):
        for j in range(moving.J):
            t, far = bounds[s], disc_of(moving, j) + cutoff + math.sqrt(0.5) / per
            while t <= bounds[s + 1]:
                ox, oy, _, vx, vy, _, until = piece_of(moving, j, t)
                past = min(until, bounds[s + 1]) - t
                _mark_way((ox, oy, past * vx, past * vy), far, cells, (s, j, moving.J), seen, vacant, body)
                t = max(until, t + 1e-9)


@kernel
def _mark_way(way, far, cells, whose, seen, vacant, body):  # type: ignore[no-untyped-def]
    """Note one body (stretch, number, of so many) on a way from (ox, oy) by (dx, dy) [m], unless `seen` has."""
    ox, oy, dx, dy = way
    (left, low), per, shape = cells
    s, j, J = whose
    square, stamp = dx * dx + dy * dy, s * J + j
    for u in _columns(ox + min(dx, 0.0) - far - left, ox + max(dx, 0.0) + far - left, per, shape[0]):
        for v in _columns(oy + min(dy, 0.0) - far - low, oy + max(dy, 0.0) + far - low, per, shape[1]):
            px, py = left + (u + 0.5) / per - ox, low + (v + 0.5) / per - oy
            share = min(max((px * dx + py * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            px, py, cell = px - share * dx, py - share * dy, u * shape[1] + v
            if seen[cell] == stamp or px * px + py * py > far * far:
                continue
            seen[cell] = stamp
            at = s * shape[0] * shape[1] + cell
            if body.shape[0] > 0:
                body[vacant[at]] = j
            vacant[at] += 1


@inlined
def _columns(begin, end, per, count):  # type: ignore[no-untyped-def]
    """Return columns of cells, of so many, from a place to another [m]."""
    return range(max(math.floor(begin * per), 0), min(math.floor(end * per) + 1, count))


@inlined
def begin_list(held):  # type: ignore[no-untyped-def]
    """Empty the list for another path; no jump is past."""
    held[CELL], held[PAST] = NOBODY, 0


@inlined
def list_everybody(bodies, held, candidates):  # type: ignore[no-untyped-def]
    """List all of so many bodies; return how many."""
    if held[CELL] != EVERYBODY:
        held[CELL] = EVERYBODY
        for j in range(bodies):
            candidates[j] = j
    return bodies


@inlined
def list_around(cells, bodies, i, x, y, within, count, held, candidates):  # type: ignore[no-untyped-def]
    """List bodies that may come so near (x, y) [m] in step i; return how many.

    `count`, `held` (CELL_STATE,) and `candidates` (bodies,), ascending, are what the last call has left.
    """
    u, v = (x - cells.corner[0]) * cells.per, (y - cells.corner[1]) * cells.per
    if not (within <= cells.cutoff and 0.0 <= u < cells.shape[0] and 0.0 <= v < cells.shape[1]):
        return list_everybody(bodies, held, candidates)
    cell = (cells.stretch[i] * cells.shape[0] + int(u)) * cells.shape[1] + int(v)
    if cell != held[CELL]:
        held[CELL], begin = cell, cells.first[cell]
        count = cells.first[cell + 1] - begin
        for k in range(count):
            candidates[k] = cells.body[begin + k]
    return count


@inlined
def next_jump(cells, t, held):  # type: ignore[no-untyped-def]
    """Return the next time after t [s] at which an obstacle is suddenly elsewhere; times of one path do not fall."""
    while cells.jumps[held[PAST]] <= t:
        held[PAST] += 1
    return cells.jumps[held[PAST]]


@inlined
def surely(held, speed, x, y, t):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance of (x, y) [m] at t [s] from all obstacles that are not on the list [m]."""
    if not t < held[4]:
        return -math.inf
    away = math.sqrt((x - held[1]) * (x - held[1]) + (y - held[2]) * (y - held[2]))
    return held[0] - away - speed * abs(t - held[3])


@inlined
def forget(held):  # type: ignore[no-untyped-def]
    """Forget the list and the clearances of all obstacles: another path begins."""
    held[4] = -math.inf
    for k in range(CACHED_LIST + CACHED_BODY - 1, held.shape[0], CACHED_BODY):
        held[k] = -math.inf


@inlined
def held_of(bodies):  # type: ignore[no-untyped-def]
    """Allocate an empty cache for so many obstacles."""
    held = np.zeros(CACHED_LIST + CACHED_BODY * bodies)
    forget(held)
    return held


@inlined
def far_from(moving, j, held, x, y, t, within):  # type: ignore[no-untyped-def]
    """Return whether the cache certifies that obstacle j is farther than `within` from (x, y) [m] at t [s]."""
    at = CACHED_LIST + CACHED_BODY * j
    free = held[at] - within - of_body(moving, j, FASTEST) * abs(t - held[at + 3]) - 1e-9  # rounding
    dx, dy = x - held[at + 1], y - held[at + 2]
    return free > 0.0 and dx * dx + dy * dy < free * free


@kernel
def listing(moving, x, y, t, within, held, candidates):  # type: ignore[no-untyped-def]
    """List bodies that may be so near (x, y) [m] at t [s]: numbers to `candidates` (J,); return how many.

    Those that surely are not, by earlier clearances in `held`, are not posed.
    """
    count, until = 0, math.inf
    for j in range(moving.J):
        at, ends = CACHED_LIST + CACHED_BODY * j, restart_of(moving, j, t)
        until = min(until, ends)
        if held[at + 3] <= t < held[at + 4] and far_from(moving, j, held, x, y, t, within):
            continue
        ox, oy, _, _, _, _, _ = piece_of(moving, j, t)
        d = outside_of(moving, j, ox, oy, x, y)
        held[at], held[at + 1], held[at + 2], held[at + 3], held[at + 4] = d, x, y, t, ends
        if d < within:
            candidates[count] = j
            count += 1
    held[0], held[1], held[2], held[3], held[4] = within, x, y, t, until
    return count
