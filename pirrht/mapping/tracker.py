"""Track moving obstacles from scan to scan: discs of constant velocity, by a Kalman filter each.

What is hit where it had been free, and where rays of an earlier scan went on, may move. Along a wall rays pass its
cells before they hit it, so the map alone cannot tell. What may move is tracked from then on, and once it moves beyond
doubt it is no part of the map. A hit belongs to the circle that it is expected nearest to, so two things that cross
stay two.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from math import inf

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan
from pirrht.mapping.tuning import TRACKS, TrackTuning


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """A disc that moves, as the last scan has it."""

    number: int  # no other one has had it
    state: Array  # x, y [m] and velocity [m/s], (4,)
    cov: Array  # of the state, (4, 4)
    radius: float  # [m]
    origin: Array  # where it was noticed, (2,) [m]
    born: float  # when that was [s]
    seen: float  # when it was seen last [s]
    sightings: int = 1
    outlines: int = 0  # scans that showed its whole width
    moves: bool = False  # beyond doubt
    stands: float = inf  # since when it does [s]

    def at(self, ahead: float) -> Array:
        """Return its centre (2,) [m] a time [s] ahead."""
        return np.asarray(self.state[:2] + ahead * self.state[2:])

    @property
    def speed(self) -> float:
        """Return its speed [m/s]."""
        return float(np.hypot(*self.state[2:]))

    def predicted(self, dt: float, agility: float) -> "Track":
        """Return it a time [s] later."""
        on = np.eye(4) + dt * np.eye(4, k=2)
        push = np.vstack([0.5 * dt * dt * np.eye(2), dt * np.eye(2)])
        return replace(self, state=on @ self.state, cov=on @ self.cov @ on.T + agility**2 * push @ push.T)

    def corrected(self, center: Array, noise: Array) -> "Track":
        """Return it once its centre (2,) [m] has been measured, with a covariance (2, 2)."""
        gain = self.cov[:, :2] @ np.linalg.inv(self.cov[:2, :2] + noise)
        return replace(self, state=self.state + gain @ (center - self.state[:2]), cov=self.cov - gain @ self.cov[:2, :])


@dataclass(slots=True, eq=False)
class Tracker:
    """All that is tracked, from scan to scan.

    Examples:
        >>> from pirrht.mapping.tracker import Tracker
        >>> Tracker().moving
        []
    """

    tuning: TrackTuning = TRACKS
    known: list[Track] = field(default_factory=list)
    time: float = 0.0  # of the last scan [s]
    _scans: deque[Scan] = field(default_factory=lambda: deque(maxlen=TRACKS.before))
    _numbers: "count[int]" = field(default_factory=lambda: count(1))

    @property
    def moving(self) -> list[Track]:
        """Return those that move beyond doubt."""
        return [one for one in self.known if one.moves]

    def see(self, scan: Scan, grid: OccupancyMap) -> BoolArray:
        """Track what a scan shows, before it is in the map; clear moving things of it.

        Return which of its rays (k,) hit them.
        """
        tuning = self.tuning
        dt = scan.time - self.time
        self.time = scan.time

        rays = np.flatnonzero(np.isfinite(scan.ranges))
        points = scan.points
        new = grid.surprises(points)
        expected = [one.predicted(dt, tuning.agility) for one in self.known]
        owner = self._owners(expected, points, new)
        found = list[Track]()
        for k, one in enumerate(expected):
            own = owner == k
            certain = np.count_nonzero(own) >= 2 and new[own].mean() >= tuning.new
            found.append(self._seen(one, scan, rays[own], points[own]) if certain else one)
        born = self._born(scan, rays, points, new & (owner < 0) & self._passed(points), found)
        self._scans.append(scan)

        passing = np.zeros(len(scan.ranges), dtype=np.bool_)
        for k, one in enumerate(found):
            if one.moves:
                passing[rays[owner == k]] = True
                since = one.born - tuning.trail if not expected[k].moves else scan.time
                for ahead in np.arange(0.0, since - scan.time - 1e-9, -0.1):
                    grid.clear(one.at(ahead), one.radius + grid.cell)
        self.known = self._kept([*found, *born])
        return passing

    def _passed(self, points: Array) -> BoolArray:
        """Return which of the places (h, 2) [m] rays of an earlier scan passed."""
        tuning = self.tuning
        found = np.zeros(len(points), dtype=np.bool_)
        for scan in self._scans:
            far, angles = scan.polar(points)
            after = np.searchsorted(scan.angles, angles)
            around = np.clip(after[:, None] + np.arange(-2, 2), 0, len(scan.angles) - 1)
            found |= (after < len(scan.angles)) & (scan.ranges[around].min(axis=1) > far + tuning.passed)
        return found

    def _owners(self, expected: Sequence[Track], points: Array, new: BoolArray) -> IntArray:
        """Return which circle each of the points (h, 2) [m] belongs to, -1 for none, (h,)."""
        if not expected or not len(points):
            return np.full(len(points), -1)
        tuning = self.tuning
        off = np.array([np.abs(np.hypot(*(points - one.state[:2]).T) - one.radius) for one in expected])
        loose = np.array([tuning.gate + np.sqrt(np.trace(one.cov[:2, :2])) for one in expected])
        nearest = off.argmin(axis=0)
        least = off[nearest, np.arange(len(points))]
        within = least < np.where(new, loose[nearest], tuning.near)
        return np.where(within, nearest, -1)

    def _seen(self, one: Track, scan: Scan, rays: IntArray, points: Array) -> Track:
        """Return a track after a scan that showed it by some rays (h,), whose hits are (h, 2) [m]."""
        tuning = self.tuning
        radius, outlines = one.radius, one.outlines
        whole = self._width(scan, rays)
        if whole is not None:
            outlines = min(outlines + 1, 10)
            radius += (whole - radius) / outlines
        center, noise = self._center(points, one.state[:2], radius)
        one = one.corrected(center, noise)
        spread = np.sqrt(np.trace(one.cov[2:, 2:]))
        sightings = one.sightings + 1
        gone = np.hypot(*(one.state[:2] - one.origin))
        certain = min(sightings - 1, outlines) >= tuning.sightings and gone > tuning.gone
        fast = one.speed > max(tuning.slow, 3.0 * spread)
        far = gone > tuning.far and one.speed > tuning.slow
        moves = one.moves or (certain and (fast or far))
        stands = min(one.stands, scan.time) if one.speed < tuning.still else inf
        return replace(
            one, radius=radius, outlines=outlines, seen=scan.time, sightings=sightings, stands=stands,
            moves=bool(moves) and scan.time - stands < tuning.rest,
        )  # fmt: skip

    def _center(self, points: Array, guess: Array, radius: float) -> tuple[Array, Array]:
        """Return the centre of a circle of a radius [m] through points (h, 2), next to a guess, and its covariance."""
        center = guess
        for _ in range(self.tuning.fits):
            away = center - points
            far = np.maximum(np.hypot(*away.T), 1e-6)
            along = away / far[:, None]
            square = along.T @ along / len(points) + 1e-3 * np.eye(2)
            center = center - np.linalg.solve(square, along.T @ (far - radius) / len(points))
        tuning = self.tuning
        return center, tuning.noise**2 * np.eye(2) + tuning.hit**2 * np.linalg.inv(square)

    def _width(self, scan: Scan, rays: IntArray) -> float | None:
        """Return the radius [m] of a disc that some rays (h,) hit; None if it is not all in view."""
        first, last = rays[0], rays[-1]
        if first == 0 or last == len(scan.ranges) - 1 or last - first >= 2 * len(rays):
            return None
        if scan.ranges[first - 1] < scan.ranges[first] or scan.ranges[last + 1] < scan.ranges[last]:
            return None
        ends = scan.angles[last : last + 2].mean() - scan.angles[first - 1 : first + 1].mean()
        sine = np.sin(min(0.5 * ends, 1.2))
        nearest = scan.ranges[rays].min()
        return float(np.clip(nearest * sine / (1.0 - sine), self.tuning.least, 0.5 * self.tuning.widest))

    def _born(
        self, scan: Scan, rays: IntArray, points: Array, new: BoolArray, others: Sequence[Track]
    ) -> list[Track]:  # fmt: skip
        """Return tracks of what is hit where it had been free, by points (h, 2) that are `new` (h,)."""
        tuning = self.tuning
        fresh = np.flatnonzero(new)
        if not len(fresh):
            return []
        jumps = (np.diff(rays) > 1) | (np.hypot(*np.diff(points, axis=0).T) > tuning.gap)
        cluster = np.append(0, np.cumsum(jumps))
        born = list[Track]()
        for number in np.unique(cluster[fresh]):
            some = np.flatnonzero(cluster == number)
            wide = np.hypot(*(points[some[-1]] - points[some[0]])) > tuning.widest
            if wide or np.count_nonzero(new[some]) < max(tuning.fewest, tuning.new * len(some)):
                continue
            whole = self._width(scan, rays[some])
            radius = tuning.first if whole is None else whole
            middle = points[some].mean(axis=0)
            ray = middle - scan.pose[:2]
            center, noise = self._center(points[some], middle + radius * ray / np.hypot(*ray), radius)
            if any(np.hypot(*(center - one.state[:2])) < one.radius for one in [*others, *born]):
                continue
            cov = np.zeros((4, 4))
            cov[:2, :2] = noise
            cov[2:, 2:] = tuning.fastest**2 * np.eye(2)
            born.append(
                Track(
                    number=next(self._numbers), state=np.append(center, [0.0, 0.0]), cov=cov, radius=radius,
                    origin=center, born=scan.time, seen=scan.time, outlines=int(whole is not None),
                )
            )  # fmt: skip
        return born

    def _kept(self, found: Sequence[Track]) -> list[Track]:
        """Leave out what was not seen for long, and what has come to stand for long."""
        tuning = self.tuning
        return [
            one for one in found
            if self.time - one.seen <= tuning.unseen and self.time - one.stands < tuning.rest
        ]  # fmt: skip
