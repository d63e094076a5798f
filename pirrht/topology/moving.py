"""Ways around bodies that move: how far a path in space and time turns about each of them.

H_i is the turn of x(t) - o_i(t), with a marker o_i in every topological obstacle of every moving body. Between two rows
of either motion that is a straight line, so it turns by one angle of at most half a turn. Paths that arrive at
different times are closed by waiting at the goal point until the later of the two; whoever waits on waits with the
other. The class of a path is by how many whole turns it differs from the base: straight to the goal point at the best
speed, as if nothing was in the way, and then waiting.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.compiled.addresses import load_float64, load_int64
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.collision import Collision
from pirrht.geometry.motion import SHAPES, Motion, Mover
from pirrht.geometry.obstacle import Obstacle
from pirrht.geometry.scene import Footprint, World
from pirrht.geometry.spans import BOX, boxes_of
from pirrht.topology.homology import integers
from pirrht.topology.obstacles import components

PLANE = 1e3  # half the side of the plane in which a body is looked at on its own [m]
ASIDE = np.array([1.7e-3, -2.9e-3])  # markers from the middle of what they mark [robot radii]
LONG = 2.0  # span of time of the boxes that markers are in [s]
OFF = 0.25  # a marker's way may be replaced by its chord if that is off by so many robot radii


class Lanes(NamedTuple):
    """Where J markers are, as numbers and addresses that kernels can take cheaply.

    They are at places at times, move straight in between, and stand still before the first and after the last.
    """

    J: int  # number of markers
    first: int  # address of int64 (J + 1,): where the places of each begin
    time: int  # address of float64 (k,) [s]
    x: int  # address of float64 (k,) [m]
    y: int  # address of float64 (k,) [m]
    period: int  # address of float64 (J,): after which a marker's track starts over [s]; 0 where it does not
    boxes: int  # address of float64 (l, BOX): where each is within LONG seconds of its clock, that begins with it
    first_box: int  # address of int64 (J + 1,): where the boxes of each begin


class Tracks(Lanes):
    """The same together with the arrays that the addresses point to."""

    arrays: tuple[Array | IntArray, ...]

    @classmethod
    def of(cls, ways: Sequence[Array], periods: Sequence[float]) -> Tracks:
        """Those of ways (k, 3) of times [s] and places [m], which start over after periods [s] that are not 0."""
        every = np.vstack([np.zeros((0, 3)), *ways])
        columns = (np.ascontiguousarray(column) for column in every.T)
        begun = [way - [way[0, 0], 0.0, 0.0] for way in ways]
        boxes = [boxes_of(way, repeat=again > 0.0, span=LONG) for way, again in zip(begun, periods, strict=True)]
        firsts = (np.cumsum([0, *map(len, parts)]).astype(np.int64) for parts in (ways, boxes))
        first, first_box = firsts
        every_box = np.ascontiguousarray(np.vstack([np.zeros((0, BOX)), *boxes]))
        arrays = first, *columns, np.array(periods, dtype=float), every_box, first_box
        tracks = cls(len(ways), *(array.ctypes.data for array in arrays))
        tracks.arrays = arrays
        return tracks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingHomology:
    """Turns of paths in space and time about J markers that move; paths are (k, 3) of x, y [m] and t [s]."""

    names: tuple[str, ...]  # (J,) of the bodies that the markers belong to
    tracks: Tracks
    goal: Array  # (2,) goal representative point [m]
    speed: float  # of the base, sqrt(2 q / r) [m/s]

    @classmethod
    def of(cls, movers: Sequence[Mover], footprint: Footprint, goal: Array, speed: float) -> MovingHomology:
        """Markers of bodies for a robot, a goal point (2,) [m] and the best unhindered speed [m/s]."""
        rows = [(m, point) for m in movers for point in markers_of(m, footprint)]
        ways = [_way(mover.motion, point, OFF * footprint.radius) for mover, point in rows]
        tracks = Tracks.of(ways, [m.motion.rows[-1, 0] if m.motion.repeat else 0.0 for m, _ in rows])
        return cls(names=tuple(m.name for m, _ in rows), tracks=tracks, goal=np.array(goal, dtype=float), speed=speed)

    @property
    def J(self) -> int:
        """Number of markers that move."""
        return len(self.names)

    def turns(self, path: Array) -> Array:
        """H of a path (k, 3) [m, m, s] whose times do not fall, (J,) [turns]."""
        out = np.zeros(self.J)
        add_turns(self.tracks, np.ascontiguousarray(path, dtype=float), out)
        return out

    def wait(self, begin: float, end: float) -> Array:
        """H of waiting at the goal point from one time to a later one [s], (J,) [turns]."""
        return self.turns(np.array([[*self.goal, begin], [*self.goal, end]]))

    def arrival(self, x: Array, t: float) -> float:
        """When the base that leaves x (2,) [m] at t arrives [s]."""
        return t + float(np.hypot(*(self.goal - x[:2]))) / self.speed

    def base(self, x: Array, t: float, until: float) -> Array:
        """H of the base that leaves x (2,) [m] at t and waits, if it arrives before, until a time [s], (J,) [turns]."""
        arrival = self.arrival(x, t)
        way = self.turns(np.array([[*x[:2], t], [*self.goal, arrival]]))
        return way + self.wait(arrival, until) if until > arrival else way

    def winding(self, path: Array) -> tuple[int, ...]:
        """Class, J [turns], of a path (k, 3) [m, m, s] that is completed straight to the goal point when it ends."""
        x, t, end = path[0, :2], float(path[0, 2]), float(path[-1, 2])
        until = max(end, self.arrival(x, t))
        closed = np.vstack([path, [*self.goal, end], [*self.goal, until]])
        return integers(self.turns(closed) - self.base(x, t, until))


def markers_of(mover: Mover, footprint: Footprint) -> Array:
    """Points inside the topological obstacles of a body, in its own frame, (m, 2) [m]; one for solids that touch.

    They lie a little beside the middle: bodies often come to stand with that on the straight way to the goal.
    """
    return _inside(mover.solids, footprint) + ASIDE * footprint.radius


@lru_cache(maxsize=SHAPES)  # bodies keep their solids when what they do is foretold anew
def _inside(solids: tuple[Obstacle, ...], footprint: Footprint) -> Array:
    """A point inside each of the topological obstacles that solids make, (m, 2) [m]."""
    plane = np.full(2, PLANE)
    parts = components(Collision(World(-plane, plane, solids), footprint))
    return np.array([part.marker for part in parts if part.marker is not None], dtype=float).reshape(-1, 2)


def _way(motion: Motion, point: Array, off: float) -> Array:
    """Times [s] and places [m] of a point (2,) [m] of a body, (k, 3); chords are off by at most `off` [m]."""
    arm = float(np.hypot(*point))
    most = 2.0 * math.acos(max(1.0 - off / arm, 0.0)) if arm > off else math.inf
    times = [motion.rows[:1, 0]]
    for a, b in zip(motion.rows[:-1], motion.rows[1:], strict=True):
        pieces = max(1, math.ceil(abs(b[3] - a[3]) / most)) if arm > 0.0 else 1
        times.append(np.linspace(a[0], b[0], pieces + 1)[1:])
    t = np.concatenate(times)
    x, y, yaw = (np.interp(t, motion.rows[:, 0], motion.rows[:, k]) for k in (1, 2, 3))
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([t - motion.lead, x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]])


@inlined
def lane_of(tracks, j):  # type: ignore[no-untyped-def]
    """Where the places of marker j begin and end, and after which it starts over [s] (0: never)."""
    return load_int64(tracks.first, j), load_int64(tracks.first, j + 1), load_float64(tracks.period, j)


@kernel
def turns_of_step(tracks, j, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """Turn [turns] about marker j of a step that goes straight from (ax, ay) [m] at s to (bx, by) at t >= s [s]."""
    begin, end, period = lane_of(tracks, j)
    shift = shift_of(tracks, begin, period, s)
    k = next_place(tracks, begin, end, s - shift)
    mx, my = _place(tracks, begin, end, k, s - shift)
    fx, fy = ax - mx, ay - my
    total, now = 0.0, s
    while True:
        knot = load_float64(tracks.time, k) + shift if k < end else math.inf
        until = min(knot, t)
        share = (until - s) / (t - s) if t > s else 1.0
        px, py = ax + share * (bx - ax), ay + share * (by - ay)
        mx, my = _place(tracks, begin, end, k, until - shift)
        total += turns_of_chord(fx, fy, px - mx, py - my)
        fx, fy, now = px - mx, py - my, until
        if now >= t:
            return total
        k += 1
        if k == end and period > 0.0:
            k, shift = begin + 1, shift + period
            gx, gy = px - load_float64(tracks.x, begin), py - load_float64(tracks.y, begin)
            total += turns_of_chord(fx, fy, gx, gy)  # nothing but where the body jumps
            fx, fy = gx, gy


@kernel
def crossings_of_step(tracks, j, ax, ay, s, bx, by, t, fx, fy):  # type: ignore[no-untyped-def]
    """How often a straight step, seen from marker j, crosses the ray to the left, counter-clockwise less clockwise.

    It goes from (ax, ay) [m] at s to (bx, by) at t >= s [s], and is seen at (fx, fy) [m] first. Returns that, and where
    it is seen at last (x, y) [m]: a whole number only of steps that are closed.
    """
    begin, end, period = lane_of(tracks, j)
    shift = shift_of(tracks, begin, period, s)
    k, count = next_place(tracks, begin, end, s - shift), 0
    pace = 1.0 / (t - s) if t > s else 0.0
    while True:
        knot = load_float64(tracks.time, k) + shift if k < end else math.inf
        if knot >= t:
            mx, my = _place(tracks, begin, end, k, t - shift)
            px, py = bx - mx, by - my
            return count + _crossing(fx, fy, px, py), px, py
        share = (knot - s) * pace
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
        px, py = x - load_float64(tracks.x, k), y - load_float64(tracks.y, k)
        count += _crossing(fx, fy, px, py)
        fx, fy, k = px, py, k + 1
        if k == end and period > 0.0:  # the body jumps
            k, shift = begin + 1, shift + period
            px, py = x - load_float64(tracks.x, begin), y - load_float64(tracks.y, begin)
            count += _crossing(fx, fy, px, py)
            fx, fy = px, py


@inlined
def _crossing(ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """1 if the way from a to b [m] crosses the ray from the origin to the left counter-clockwise, -1 if clockwise."""
    if (ay >= 0.0) == (by >= 0.0):
        return 0
    turned = ax * by - ay * bx
    if ay >= 0.0:
        return 1 if turned > 0.0 else 0
    return -1 if turned < 0.0 else 0


@inlined
def shift_of(tracks, begin, period, t):  # type: ignore[no-untyped-def]
    """How much later than its first lap the one is that a track, whose places begin there, is on at t [s]."""
    if period == 0.0 or not t > load_float64(tracks.time, begin):
        return 0.0
    return math.floor((t - load_float64(tracks.time, begin)) / period) * period


@inlined
def next_place(tracks, begin, end, t):  # type: ignore[no-untyped-def]
    """The first of the places from begin to end that comes after t [s] of its own clock; `end` if none does."""
    while begin < end:
        middle = (begin + end) // 2
        if load_float64(tracks.time, middle) <= t:
            begin = middle + 1
        else:
            end = middle
    return begin


@inlined
def _place(tracks, begin, end, k, t):  # type: ignore[no-untyped-def]
    """Where a marker is at t [s] of its own clock, if place k is the next of those from begin to end."""
    if k == begin:
        return load_float64(tracks.x, begin), load_float64(tracks.y, begin)
    if k >= end:
        return load_float64(tracks.x, end - 1), load_float64(tracks.y, end - 1)
    share = (t - load_float64(tracks.time, k - 1)) / (load_float64(tracks.time, k) - load_float64(tracks.time, k - 1))
    x = load_float64(tracks.x, k - 1) + share * (load_float64(tracks.x, k) - load_float64(tracks.x, k - 1))
    return x, load_float64(tracks.y, k - 1) + share * (load_float64(tracks.y, k) - load_float64(tracks.y, k - 1))


@kernel
def place_at(tracks, j, t):  # type: ignore[no-untyped-def]
    """Where marker j is at t [s], (x, y) [m]; the earlier place where it jumps at that moment."""
    begin, end, period = lane_of(tracks, j)
    if period > 0.0 and t > load_float64(tracks.time, begin):
        t -= max(math.ceil((t - load_float64(tracks.time, begin)) / period) - 1.0, 0.0) * period
    return _place(tracks, begin, end, next_place(tracks, begin, end, t), t)


@kernel
def places_at(tracks, times, out):  # type: ignore[no-untyped-def]
    """Write where all markers are at times (T,) [s] to `out` (J, T, 2) [m]."""
    for j in range(out.shape[0]):
        for i in range(times.shape[0]):
            out[j, i, 0], out[j, i, 1] = place_at(tracks, j, times[i])


@kernel
def add_turns(tracks, path, out):  # type: ignore[no-untyped-def]
    """Add H of a path (k, 3) [m, m, s] to `out` (J,) [turns]."""
    for j in range(out.shape[0]):
        for k in range(path.shape[0] - 1):
            a, b = path[k], path[k + 1]
            out[j] += turns_of_step(tracks, j, a[0], a[1], a[2], b[0], b[1], b[2])
