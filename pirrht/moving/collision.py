"""Measure exactly how far a robot is from moving obstacles and whether one passes over it, each in its own frame.

There its shape is static, and distances are those from any static obstacle. Seen from a pose, a distance changes no
faster than the body: by its speed and its turning times its reach. So a distance known at one pose and time leaves a
cone that is surely free, and another is measured only where that is not enough. Distances at both ends of ever shorter
pieces decide whether an obstacle passes over the robot. A motion that starts over somewhere else jumps: earlier
distances say nothing afterwards, and nothing is between.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import repeat
from math import cos, hypot, inf, remainder, sin, tau

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.geometry.collision import SHORTEST, Collision, touches
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.hulls import HullCollision
from pirrht.geometry.obstacle import Motion, Mover, Obstacle, rotation_of
from pirrht.geometry.scene import Workspace
from pirrht.geometry.shapes import Solids
from pirrht.geometry.tuning import TUNING as GEOMETRY


class Body:
    """One moving body, of a static `shape`: free distances at a time, and how fast they may change."""

    def __init__(self, mover: Mover, footprint: Footprint, shape: Collision | None = None) -> None:
        kind = Collision if footprint.is_disc else HullCollision
        motion = mover.motion
        far = np.full(3 if motion.in_space else 2, np.inf)
        self.shape = shape or kind(Workspace(-far, far, mover.solids), footprint)
        self._reach = _reach(mover, footprint)
        self._lap = (
            motion if not motion.repeat and motion.offset == 0.0 else Motion(rows=motion.rows)
        )  # once from the first row to the last
        self._offset = motion.offset
        self._length = float(motion.rows[-1, 0]) if motion.repeat else inf
        self._times: list[float] = motion.rows[:, 0].tolist()
        radius = radius_of(mover.solids, len(far))
        travelled = np.cumsum(travels(motion, radius))  # to each row but the first [m]
        self._travelled: list[float] = [0.0, *travelled.tolist()]
        self.speed = speed_bound(motion, radius)

    def lap(self, time: float) -> tuple[int, float]:
        """Return how often it has started over at a time [s], and the time of its rows then [s]."""
        t = time + self._offset
        count = int(t // self._length) if t > 0.0 else 0
        return count, t - count * self._length if count else t

    def until(self, time: float) -> float:
        """Return when it starts over next after a time [s]."""
        return (self.lap(time)[0] + 1) * self._length - self._offset

    def travel(self, begin: float, end: float) -> float:
        """Bound how far any of its points goes between two times [s], jumps aside [m]."""
        laps, s = self.lap(begin)
        more, t = self.lap(end)
        return (more - laps) * self._travelled[-1] + self._rows_travel(s, t)

    def _rows_travel(self, s: float, t: float) -> float:
        """Bound how far any of its points goes between two times of the rows [s], [m]."""
        gone = np.interp([s, t], self._times, self._travelled)
        return float(gone[1] - gone[0])

    def clearance(self, pose: Array, row_time: float) -> float:
        """Return the free distance of a robot at a pose (2,) or (3,) at a time of the rows [s]; 0 in contact."""
        return float(self.shape.clearance(_seen(pose, self._lap.pose_at(row_time)))[0])

    def meets(self, a: Array, begin: float, b: Array, end: float, undecided: bool) -> bool:
        """Return whether it touches a robot that goes straight from a to b, poses, from `begin` to `end` [s]."""
        return any(self._meets(*piece, undecided) for piece in self._pieces(a, begin, b, end))

    def _meets(self, a: Array, s: float, b: Array, t: float, undecided: bool) -> bool:
        """Return whether it touches the robot between two times of the rows [s]; clearances to either side tell."""
        way = hypot(b[0] - a[0], b[1] - a[1]) + self._reach * float(np.abs(b[2:] - a[2:]).sum())
        return touches(
            lambda share: self.clearance(a + share * (b - a), s + share * (t - s)),
            lambda p, q: (q - p) * way + self._rows_travel(s + p * (t - s), s + q * (t - s)),
            undecided=undecided,
        )

    def _pieces(self, a: Array, begin: float, b: Array, end: float) -> Iterator[tuple[Array, float, Array, float]]:
        """Cut a straight path where the motion starts over: places (2,) [m] and times of the rows [s] of both ends."""
        count, s = self.lap(begin)
        while (until := (count + 1) * self._length - self._offset) <= end:
            middle = a + (until - begin) / max(end - begin, 1e-300) * (b - a)
            yield a, s, middle, self._length

            a = middle
            begin = until
            count = count + 1
            s = 0.0
        yield a, s, b, s + end - begin


class MovingObstacles:
    """All moving obstacles around a robot."""

    def __init__(self, movers: Sequence[Mover], footprint: Footprint, shapes: Sequence[Collision] = ()) -> None:
        self.footprint = footprint
        self._reach = max((_reach(mover, footprint) for mover in movers), default=0.0)
        known = shapes or repeat(None, len(movers))
        self._bodies = [Body(mover, footprint, shape) for mover, shape in zip(movers, known, strict=True)]
        self._speeds = np.array([body.speed for body in self._bodies])
        self._fastest = float(self._speeds.max(initial=0.0))
        # Known of each: a free distance [m], at which pose and time, and from when to when that holds [s].
        self._each = np.tile([-inf, 0.0, 0.0, 0.0, 0.0, -inf, -inf], (len(self._bodies), 1))
        self._all = (inf if not self._bodies else -inf, 0.0, 0.0, 0.0, 0.0, -inf, inf)

    def with_motions(self, movers: Sequence[Mover]) -> "MovingObstacles":
        """Return these obstacles on other motions; FCL's solids are shared, and queried by one thread at a time."""
        return MovingObstacles(movers, self.footprint, [body.shape for body in self._bodies])

    def clearance(self, pose: Array, time: float) -> float:
        """Return the free distance to the nearest obstacle at a pose (2,) or (3,) and time [s]; 0 in contact."""
        lower, (x, y, heading) = self._lower(pose, time), _whole(pose)
        best, holds, ends = inf, -inf, inf
        for j in np.argsort(lower, kind="stable"):
            if lower[j] < best:
                body = self._bodies[j]
                count, row_time = body.lap(time)
                free = body.clearance(pose, row_time)
                since = time - row_time if count else -inf
                self._each[j] = free, x, y, heading, time, since, body.until(time)
                best = min(best, free)
        if len(lower):
            holds = float(self._each[:, 5].max())
            ends = float(self._each[:, 6].min())
        self._all = best, x, y, heading, time, holds, ends
        return best

    def travel(self, begin: float, end: float) -> float:
        """Bound how far any point of any obstacle goes between two times [s], jumps aside [m]."""
        return max((body.travel(begin, end) for body in self._bodies), default=0.0)

    def surely(self, pose: Array, time: float) -> float:
        """Return a lower bound of the free distance at a pose (2,) or (3,) and time [s], without a query [m]."""
        free, at_x, at_y, at_heading, when, holds, ends = self._all
        if not holds <= time < ends:
            return -inf
        x, y, heading = _whole(pose)
        away = hypot(x - at_x, y - at_y) + self._reach * abs(heading - at_heading)
        return free - away - self._fastest * abs(time - when)

    def meets(
        self, a: Array, begin: float, b: Array, end: float, which: BoolArray | None = None, undecided: bool = False
    ) -> bool:  # fmt: skip
        """Return whether any of `which` (J,) touches a robot that goes from pose a to b, `begin` to `end` [s].

        What passes within a twentieth of a millimetre is `undecided`.
        """
        if min(self.surely(a, begin), self.surely(b, end)) > 0.0:
            return False
        near = ~(np.minimum(self._lower(a, begin), self._lower(b, end)) > 0.0)
        near = near if which is None else near & which
        return any(self._bodies[j].meets(a, begin, b, end, undecided) for j in np.flatnonzero(near))

    def _lower(self, pose: Array, time: float) -> Array:
        """Return lower bounds of the free distances to all obstacles, (J,) [m]."""
        free, at_x, at_y, at_heading, when, holds, ends = self._each.copy().T  # as a whole, whoever asks meanwhile
        x, y, heading = _whole(pose)
        away = np.hypot(x - at_x, y - at_y) + self._reach * np.abs(heading - at_heading)
        return np.where((holds <= time) & (time < ends), free - away - self._speeds * np.abs(time - when), -inf)


def _reach(mover: Mover, footprint: Footprint) -> float:
    """Return how far the third number of a pose moves any point of the robot at most: a heading, or in space z."""
    return 1.0 if mover.motion.in_space else 0.0 if footprint.is_disc else footprint.reach


def _whole(pose: Array) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of a pose (2,) or (3,)."""
    x, y, *heading = pose.tolist()
    return x, y, heading[0] if heading else 0.0


def _seen(pose: Array, body: Sequence[float]) -> Array:
    """Return a pose (2,) or (3,) in the frame of a body, whose own is x, y [m] and a yaw [rad], or one in space."""
    if len(body) > 3:
        return np.asarray((pose - body[:3])[None] @ rotation_of(body))
    x, y, *heading = pose.tolist()
    body_x, body_y, yaw = body

    c = cos(yaw)
    s = sin(yaw)
    dx = x - body_x
    dy = y - body_y

    return np.array([[c * dx + s * dy, c * dy - s * dx, *(one - yaw for one in heading)]])


@lru_cache(maxsize=GEOMETRY.shapes)  # obstacles keep their solids when their motions are predicted again
def radius_of(solids: tuple[Obstacle, ...], d: int = 2) -> float:
    """Return how far an obstacle's solids extend from its origin at most, seen from above or in `d` = 3 axes [m]."""
    every = Solids.of(solids)
    far = np.maximum(np.abs(every.low[:, :d]), np.abs(every.high[:, :d]))
    return float(np.hypot.reduce(far, axis=1).max(initial=0.0))


def travels(motion: Motion, radius: float) -> Array:
    """Bound how far any point of an obstacle of a radius [m] goes between rows, (k - 1,) [m]."""
    if motion.in_space:
        way, turn = np.linalg.norm(motion.rates[:-1].reshape(-1, 2, 3), axis=2).T
        return np.asarray(np.diff(motion.rows[:, 0]) * (way + radius * turn))
    steps = motion.rows[1:] - motion.rows[:-1]
    return np.asarray(np.hypot(steps[:, 1], steps[:, 2]) + np.abs(steps[:, 3]) * radius)


def speed_bound(motion: Motion, radius: float) -> float:
    """Bound the speed of any point of an obstacle of a radius [m], jumps aside [m/s]."""
    times = motion.rows[:, 0]
    return float((travels(motion, radius) / (times[1:] - times[:-1])).max(initial=0.0))


def jumps(motion: Motion) -> bool:
    """Return whether a motion starts over elsewhere than it ends."""
    off = motion.rows[-1, 1:] - motion.rows[0, 1:]
    if motion.in_space:
        return motion.repeat and float(np.abs(off).max()) > SHORTEST
    x, y, yaw = off
    return motion.repeat and max(hypot(x, y), abs(remainder(yaw, tau))) > SHORTEST
