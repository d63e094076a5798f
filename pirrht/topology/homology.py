"""Classes of planar paths about static and moving obstacles: rays that they cross, and angles (paper, section IV-A)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array, IntArray
from pirrht.geometry.arcs import turns_of_chord
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.jit.jit import as_tuple, kernel
from pirrht.topology.crossings import Cuts, spread, straight_turns
from pirrht.topology.moving_crossings import NO_RAYS, MarkerTable, RayTable, crossings_of_leg
from pirrht.topology.signature import Signature, hash_weights, integers
from pirrht.topology.tracks import NO_TRACKS, MarkerTrajectories, trajectories_of, turns_of_step


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Homology(Signature):
    """Signature of paths about S static and J moving markers, M = S + J in this order; often J = 0.

    About a static marker, the base of a point is the straight line to the goal point. Its integer counts how often a
    path crosses the ray that leaves the marker away from the goal point.

    About a moving marker, H is the turn of x(t) - o(t). The base goes straight to the goal point at the best speed, as
    if nothing was in the way. Paths are closed by waiting there until the later of two arrivals.

    Points are (n,), x and y first [m]. Where J > 0 they are x, y [m] and t [s].
    """

    markers: Array  # (S, 2) one point inside each static topological obstacle [m]
    goal: Array  # (2,) goal representative point [m]
    named: int | None = None  # names of classes give so many turns at least: they last while obstacles are added
    names: tuple[str, ...] = ()  # (J,) of the moving obstacles that moving markers belong to
    tracks: MarkerTrajectories = NO_TRACKS  # of the moving markers
    speed: float = 1.0  # of bases about moving markers, sqrt(2 q / r) [m/s]
    cuts: Cuts = field(init=False)  # the static markers sorted, for kernels that must not query all of them

    def __post_init__(self) -> None:
        object.__setattr__(self, "cuts", Cuts.of(self.markers, self.goal, hash_weights(len(self.markers))))

    def __repr__(self) -> str:
        return f"Homology({self.M} markers, goal {formatting.vector(self.goal)})"

    M = property(lambda self: len(self.markers) + len(self.names), doc="Number of all markers.")

    @property
    def J(self) -> int:
        """Number of moving markers."""
        return len(self.names)

    @property
    def static(self) -> Homology:
        """Signature about the static markers only (J = 0)."""
        return replace(self, names=(), tracks=NO_TRACKS) if self.J else self

    def with_moving(self, movers: Sequence[Mover], footprint: Footprint) -> Homology:
        """Signature about the same static markers and other moving obstacles."""
        names, tracks = trajectories_of(movers, footprint, self.goal)
        return replace(self, names=names, tracks=tracks)

    def at(self, x: Array, time: float) -> Array:
        """Point of a state x (n,) at a time [s]: the state, or place and time (3,) [m, m, s] where J > 0."""
        return np.array([x[0], x[1], time]) if self.J else x

    def base(self, x: Array) -> Array:
        """H of the base from x (n,), (M,) [turns], without the leading 1; 0 about moving markers at an open time."""
        out = np.empty(self.M)
        write_base(self.markers, self.tracks, self.goal, self.speed, np.ascontiguousarray(x, dtype=float), out)
        return out

    def crossings(self, a: Array, b: Array) -> list[tuple[int, int]]:
        """(marker, turn) pairs that a straight segment from a (n,) to b (n,) adds to the class of b."""
        whole = self.along(np.array([a, b]))
        return [(int(k), int(whole[k])) for k in np.flatnonzero(whole)]

    def along(self, path: Array) -> IntArray:
        """Sum of the crossings of a path's segments, path (k, n), (M,) [turns]."""
        pairs = max(1, len(path) - 1) * self.M
        marker = np.empty(pairs, np.int32)
        turn = np.empty(pairs, np.int16)
        count = _crossings(MarkerTable(self.cuts, self.tracks, self.speed), self._timed(path), marker, turn)
        return spread(marker[:count], turn[:count], self.M)

    def turns(self, path: Array) -> Array:
        """H of a path (k, n) whose times do not fall, (M,) [turns], without the leading 1."""
        out = np.zeros(self.M)
        _turns(self._timed(path), self.markers, self.tracks, out)
        return out

    def winding(self, path: Array) -> tuple[int, ...]:
        """Class, M [turns], of a path (k, n), completed straight to the goal point, where it then waits."""
        path = self._timed(path)
        return integers(self.closed(self.turns(path), path[0], path[-1]))

    def most_turned(self, path: Array) -> float:
        """Return the greatest |H_i| about a static marker of what is left of a path (k, n) at its points [turns].

        It is completed straight to the goal point. A tree has the path if its limit is no less.
        """
        line = np.vstack([path[:, :2], self.goal])
        away = line[:, None] - self.markers
        angle = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=0)
        return float(np.abs(angle[-1] - angle).max(initial=0.0)) / math.tau

    def closed(self, turns: Array, first: Array, last: Array) -> Array:
        """H of a path from `first` to `last` (n,), completed to the goal point, over the base's, (M,) [turns]."""
        S = len(self.markers)
        whole = turns.copy()
        whole[:S] += self.base(last)[:S] - self.base(first)[:S]
        if self.J:
            arrival = self.arrival(first)
            waits = np.array([[*self.goal, min(last[2], arrival)], [*self.goal, max(last[2], arrival)]])
            to_goal = self.turns(np.array([last, [*self.goal, last[2]]]))
            wait = math.copysign(1.0, arrival - last[2]) * self.turns(waits)
            whole[S:] += (to_goal + wait - self.base(first))[S:]
        return whole

    def arrival(self, x: Array) -> float:
        """Time at which the base that leaves x (3,) [m, m, s] arrives [s]."""
        return float(x[2] + math.dist(self.goal, x[:2]) / self.speed)

    def rays(self, x: Array, times: Array) -> RayTable:
        """Moving markers' rays for paths from x (n,) over steps that end at times (T + 1,) [s]."""
        if not self.J:
            return NO_RAYS
        weight = self.hash_weights[len(self.markers) :]
        arrival = self.arrival(self.at(x, float(times[0])))

        return RayTable.of(self.tracks, weight, self.goal, x, times, arrival)

    def _timed(self, path: Array) -> Array:
        """Rows (k, 3) of a path (k, n); times are 0 where nothing moves."""
        times = path[:, 2] if self.J else np.zeros(len(path))
        return np.column_stack([path[:, :2], times])


@kernel
def write_base(markers, tracks, goal, speed, x, out):  # type: ignore[no-untyped-def]
    """Write H of the base from x, 2 or 3 [m, m, s], to `out` (M,) [turns]: about `markers` (S, 2) [m], then tracks."""
    gx, gy = goal[0], goal[1]
    static = markers.shape[0]

    for k in range(static):
        out[k] = straight_turns(x[0], x[1], markers[k, 0], markers[k, 1], gx, gy)
    for j in range(tracks.J):
        out[static + j] = 0.0
        if x[2] < math.inf:
            arrival = x[2] + math.hypot(gx - x[0], gy - x[1]) / speed
            out[static + j] = turns_of_step(tracks, j, (x[0], x[1], x[2]), (gx, gy, arrival))


@kernel
def _turns(path, markers, tracks, out):  # type: ignore[no-untyped-def]
    static = markers.shape[0]
    for i in range(path.shape[0] - 1):
        a = as_tuple(path[i], 3)
        b = as_tuple(path[i + 1], 3)

        for k in range(static):
            x, y = markers[k, 0], markers[k, 1]
            out[k] += turns_of_chord(a[0] - x, a[1] - y, b[0] - x, b[1] - y)
        for j in range(tracks.J):
            out[static + j] += turns_of_step(tracks, j, a, b)


@kernel
def _crossings(markers, path, marker, turn):  # type: ignore[no-untyped-def]
    count = 0
    for i in range(path.shape[0] - 1):
        a = as_tuple(path[i], 3)
        b = as_tuple(path[i + 1], 3)
        count = crossings_of_leg(markers, a, b, False, marker, turn, count)
    return count


class Driven:
    """Class of a run that left x (n,) at a time [s] of the moving obstacles' clock, `offset` (M,) turns before that."""

    def __init__(self, homology: Homology, x: Array, time: float = 0.0, offset: Sequence[int] | Array = ()) -> None:
        whole = np.array(offset, dtype=np.int64) if len(offset) else np.zeros(homology.M, dtype=np.int64)
        self._homology, self._known = homology, (whole, np.array([x[0], x[1], time]))  # class, place and time
        self._now = self._known

    def observe(self, states: Array, until: float = 0.0) -> None:
        """Add the states (k, n), evenly spaced in time until now, `until` [s]; they replace expected ones."""
        self._known = self._now = self._on(states, until)

    def expect(self, states: Array, until: float = 0.0) -> None:
        """Suppose that the robot drives through the states (k, n) next, until a time [s]."""
        self._now = self._on(states, until)

    def _on(self, states: Array, until: float) -> tuple[IntArray, Array]:
        whole, last = self._known
        times = np.linspace(last[2], max(until, last[2]), len(states) + 1)[1:]
        path = np.vstack([last, np.column_stack([states[:, :2], times])])
        return whole + self._homology.along(path), path[-1]

    @property
    def here(self) -> Array:
        """Place of the robot, as far as is known or expected, (2,) [m]."""
        return self._now[1][:2]

    def enter(self, homology: Homology) -> None:
        """Continue among other static markers, to the same goal; turns about new ones count from here on."""
        old, (known, last), (now, here) = self._homology, self._known, self._now
        M = min(old.M, homology.M)
        stay = np.flatnonzero(np.all(old.markers[:M] == homology.markers[:M], axis=1))
        since = np.zeros(homology.M, dtype=np.int64)
        whole = homology.along(np.array([last, here]))
        since[stay] = known[stay]
        whole[stay] = now[stay]

        self._homology = homology
        self._known = (since, last)
        self._now = (whole, here)

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the base from its end."""
        return tuple(self._now[0].tolist())
