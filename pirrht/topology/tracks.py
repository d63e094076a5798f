"""Follow the markers of moving obstacles; measure turns of steps in space and time about them, in kernels.

A turn is the angle of a path as a marker sees it, summed up piece by piece. For closed paths it is a whole number: how
often they cross one ray.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Motion, Mover, Obstacle
from pirrht.geometry.scene import Workspace
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.jit.jit import inlined, kernel, load_float64, load_int64
from pirrht.jit.records import Held
from pirrht.topology.obstacles import components
from pirrht.topology.tuning import TUNING

MARKER_OFFSET = (1.7e-3, -2.9e-3)  # of moving markers from the middle [robot radii]: off lines
BOX = 4  # numbers of a box: least x and y, greatest x and y [m]


class TrajectoryTable(NamedTuple):
    """Trajectories of J markers, straight between places at times, as numbers that kernels take cheaply."""

    J: int  # number of markers
    first: int  # address of int64 (J + 1,): where the places of each begin
    time: int  # address of float64 (k,) [s]
    x: int  # address of float64 (k,) [m]
    y: int  # address of float64 (k,) [m]
    period: int  # address of float64 (J,): after which a marker's track starts over [s]; 0 where it does not
    waited: int  # address of int64 (k,): crossings of the ray until then by a point that waits at the goal point
    lap: int  # address of int64 (J,): the same in a lap, the jump to its beginning included
    boxes: int  # address of float64 (l, BOX): where each is within `box_span` of its clock, that begins with it
    first_box: int  # address of int64 (J + 1,): where the boxes of each begin


class MarkerTrajectories(Held, TrajectoryTable):
    """A `TrajectoryTable` together with the arrays that the addresses point to."""

    @classmethod
    def of(cls, paths: Sequence[Array], periods: Sequence[float], goal: Array) -> "MarkerTrajectories":
        """Follow paths (k, 3) of times [s] and places [m], repeated after periods [s] if not 0; goal point (2,) [m]."""
        every = np.vstack([np.zeros((0, 3)), *paths])
        columns = (np.ascontiguousarray(column) for column in every.T)
        begun = [path - [path[0, 0], 0.0, 0.0] for path in paths]
        boxes = [_boxes_of(path, repeat=again > 0.0) for path, again in zip(begun, periods, strict=True)]
        firsts = (np.cumsum([0, *map(len, parts)]).astype(np.int64) for parts in (paths, boxes))
        first, first_box = firsts
        every_box = np.ascontiguousarray(np.vstack([np.zeros((0, BOX)), *boxes]))
        crossed = [_crossed(goal - path[:, 1:]) for path in paths]
        waited = np.concatenate([np.zeros(0, np.int64), *(each[:-1] for each in crossed)])
        lap = np.array([each[-1] for each in crossed], dtype=np.int64)
        every_period = np.array(periods, dtype=float)
        return cls.holding(len(paths), first, *columns, every_period, waited, lap, every_box, first_box)


def _boxes_of(path: Array, *, repeat: bool) -> Array:
    """Return boxes (k, BOX) [m] of a path (n, 3) of t, x, y, span by span from 0 on.

    The first is right for earlier times as well. If the path does not start over, the last is where it stays.
    """
    edges = TUNING.box_span * np.arange(max(1, math.ceil(path[-1, 0] / TUNING.box_span)) + 1)
    times = np.union1d(edges, path[:, 0])
    places = np.column_stack([np.interp(times, path[:, 0], path[:, k]) for k in (1, 2)])
    at = np.searchsorted(times, edges)
    low, high = (extreme(extreme.reduceat(places, at[:-1]), places[at[1:]]) for extreme in (np.minimum, np.maximum))
    boxes = np.hstack([low, high])
    return boxes if repeat else np.vstack([boxes, np.tile(path[-1, 1:3], 2)])


def _crossed(seen: Array) -> IntArray:
    """Count crossings of a marker's ray by places (k, 2) that it sees [m] until each, and back at the first: k + 1."""
    (ax, ay), (bx, by) = seen.T, np.roll(seen, -1, axis=0).T
    turned = ax * by - ay * bx
    steps = np.where((ay >= 0.0) & (by < 0.0) & (turned > 0.0), 1, 0)
    return np.cumsum([0, *(steps - ((ay < 0.0) & (by >= 0.0) & (turned < 0.0)))])


@inlined
def rows_of(tracks, j):  # type: ignore[no-untyped-def]
    """Begin and end of the places of marker j, and its period [s] (0: none)."""
    return load_int64(tracks.first, j), load_int64(tracks.first, j + 1), load_float64(tracks.period, j)


@inlined
def crossing(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """1 if the line from a to b [m] crosses the ray from the origin to the left counter-clockwise, -1 if clockwise."""
    if (ay >= 0.0) == (by >= 0.0):
        return 0
    turned = ax * by - ay * bx
    if ay >= 0.0:
        return 1 if turned > 0.0 else 0
    return -1 if turned < 0.0 else 0


@inlined
def _shift_of(tracks, begin, period, t):  # type: ignore[no-untyped-def]
    """Delay of a track's lap at t [s], whose places start at `begin`, from its first one [s]."""
    if period == 0.0 or not t > load_float64(tracks.time, begin):
        return 0.0
    return math.floor((t - load_float64(tracks.time, begin)) / period) * period


@inlined
def _next_place(tracks, begin, end, t):  # type: ignore[no-untyped-def]
    """Find the first of the places from begin to end that comes after t [s] of its own clock; `end` if none does."""
    while begin < end:
        middle = (begin + end) // 2
        if load_float64(tracks.time, middle) <= t:
            begin = middle + 1
        else:
            end = middle
    return begin


@inlined
def _place(tracks, begin, end, k, t):  # type: ignore[no-untyped-def]
    """Place a marker at t [s] of its own clock, if place k is the next of those from begin to end."""
    if k == begin:
        return load_float64(tracks.x, begin), load_float64(tracks.y, begin)
    if k >= end:
        return load_float64(tracks.x, end - 1), load_float64(tracks.y, end - 1)
    share = (t - load_float64(tracks.time, k - 1)) / (load_float64(tracks.time, k) - load_float64(tracks.time, k - 1))
    x = load_float64(tracks.x, k - 1) + share * (load_float64(tracks.x, k) - load_float64(tracks.x, k - 1))
    return x, load_float64(tracks.y, k - 1) + share * (load_float64(tracks.y, k) - load_float64(tracks.y, k - 1))


@inlined
def _laps(tracks, begin, period, t):  # type: ignore[no-untyped-def]
    """Count laps that are over before t [s]: at the moment of a jump the lap that ends there is not."""
    if period == 0.0 or not t > load_float64(tracks.time, begin):
        return 0
    return max(math.ceil((t - load_float64(tracks.time, begin)) / period) - 1, 0)


@kernel
def place_at(tracks, j, t):  # type: ignore[no-untyped-def]
    """Place marker j at t [s], (x, y) [m]; the earlier place where it jumps at that moment."""
    begin, end, period = rows_of(tracks, j)
    t -= _laps(tracks, begin, period, t) * period
    return _place(tracks, begin, end, _next_place(tracks, begin, end, t), t)


@kernel
def places_at(tracks, times, out):  # type: ignore[no-untyped-def]
    """Write the places of all markers at times (T,) [s] to `out` (J, T, 2) [m]."""
    for j in range(out.shape[0]):
        for i in range(times.shape[0]):
            out[j, i, 0], out[j, i, 1] = place_at(tracks, j, times[i])


@inlined
def seen_from(tracks, j, x, y, t):  # type: ignore[no-untyped-def]
    """Relative position of (x, y) [m], seen from marker j at t [s], (x, y) [m]."""
    mx, my = place_at(tracks, j, t)
    return x - mx, y - my


def _summed(measure: Any) -> Any:
    """Build the kernel that sums a measure of what marker j sees over the pieces of a straight step.

    It goes from a to a later b, (3) each [m, m, s], which the marker sees at `first` and `last`, (2) each [m].
    """

    @kernel
    def summed(tracks, j, a, b, first, last):  # type: ignore[no-untyped-def]
        ax, ay, s = a
        bx, by, t = b
        fx, fy = first
        lx, ly = last

        begin, end, period = rows_of(tracks, j)
        shift = _shift_of(tracks, begin, period, s)
        k, total = _next_place(tracks, begin, end, s - shift), 0
        if period > 0.0 and t > s:  # it may jump just now
            mx, my = _place(tracks, begin, end, k, s - shift)
            total += measure(fx, fy, ax - mx, ay - my)
            fx, fy = ax - mx, ay - my
        rate = 1.0 / (t - s) if t > s else 0.0
        while True:
            knot = load_float64(tracks.time, k) + shift if k < end else math.inf
            if knot >= t:
                return total + measure(fx, fy, lx, ly)
            share = (knot - s) * rate
            x = ax + share * (bx - ax)
            y = ay + share * (by - ay)
            px = x - load_float64(tracks.x, k)
            py = y - load_float64(tracks.y, k)
            total += measure(fx, fy, px, py)
            fx, fy, k = px, py, k + 1
            if k == end and period > 0.0:  # the body jumps
                k = begin + 1
                shift = shift + period
                px = x - load_float64(tracks.x, begin)
                py = y - load_float64(tracks.y, begin)
                total += measure(fx, fy, px, py)
                fx, fy = px, py

    return summed


crossings_of_step = _summed(crossing)  # of the ray to the left: a number with a meaning for closed steps together
_turned = _summed(turns_of_chord)


@kernel
def turns_of_step(tracks, j, a, b):  # type: ignore[no-untyped-def]
    """Turn [turns] about marker j of a step that goes straight from a to b, (3) each [m, m, s]."""
    return _turned(tracks, j, a, b, seen_from(tracks, j, a[0], a[1], a[2]), seen_from(tracks, j, b[0], b[1], b[2]))


@kernel
def crossings_of_waiting(tracks, j, gx, gy, t, lx, ly):  # type: ignore[no-untyped-def]
    """Count crossings while waiting at the goal point (gx, gy) [m], from when the track begins until t [s]."""
    begin, end, period = rows_of(tracks, j)
    laps = _laps(tracks, begin, period, t)
    k = _next_place(tracks, begin, end, t - laps * period)
    if k == begin:
        return 0
    px = gx - load_float64(tracks.x, k - 1)
    py = gy - load_float64(tracks.y, k - 1)

    return laps * load_int64(tracks.lap, j) + load_int64(tracks.waited, k - 1) + crossing(px, py, lx, ly)


NO_TRACKS = MarkerTrajectories.of([], [], np.zeros(2))


def trajectories_of(
    movers: Sequence[Mover], footprint: Footprint, goal: Array
) -> tuple[tuple[str, ...], MarkerTrajectories]:
    """Mark moving obstacles for a robot and a goal point (2,) [m]: their names (J,), and the markers' trajectories."""
    rows = [(mover, point) for mover in movers for point in markers_of(mover, footprint)]
    if not rows:
        return (), NO_TRACKS
    paths = [_path(mover.motion, point, TUNING.chord_error * footprint.radius) for mover, point in rows]
    periods = [mover.motion.rows[-1, 0] if mover.motion.repeat else 0.0 for mover, _ in rows]
    return tuple(mover.name for mover, _ in rows), MarkerTrajectories.of(paths, periods, goal)


def markers_of(mover: Mover, footprint: Footprint) -> Array:
    """Points inside the topological obstacles of a body, in its own frame, (m, 2) [m]; one for solids that touch.

    They lie a little off the middle: bodies often come to stand with that on the straight line to the goal.
    """
    return _inside(mover.solids, footprint) + np.array(MARKER_OFFSET) * footprint.radius


@lru_cache(maxsize=GEOMETRY.shapes)  # bodies keep their solids when their motion is predicted again
def _inside(solids: tuple[Obstacle, ...], footprint: Footprint) -> Array:
    """A point inside each of the topological obstacles that solids make, (m, 2) [m]."""
    plane = np.full(2, np.inf)
    parts = components(Collision(Workspace(-plane, plane, solids), footprint))
    return np.array([part.marker for part in parts if part.marker is not None], dtype=float).reshape(-1, 2)


def _path(motion: Motion, point: Array, off: float) -> Array:
    """Times [s] and places [m] of a point (2,) [m] of a body, (k, 3); chords are off by at most `off` [m]."""
    rows, arm = motion.rows, float(np.hypot(*point))
    most = 2.0 * math.acos(max(1.0 - off / arm, 0.0)) if arm > off else math.inf
    pieces = np.maximum(np.ceil(np.abs(np.diff(rows[:, 3])) / most), 1).astype(int)
    times = [np.linspace(a, b, n + 1)[1:] for a, b, n in zip(rows[:-1, 0], rows[1:, 0], pieces, strict=True)]
    t = np.concatenate([rows[:1, 0], *times])
    x, y, yaw = (np.interp(t, rows[:, 0], rows[:, k]) for k in (1, 2, 3))
    c = np.cos(yaw)
    s = np.sin(yaw)

    return np.column_stack([t - motion.offset, x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]])
