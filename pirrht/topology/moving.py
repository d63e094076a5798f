"""Turn about moving obstacles: signatures and classes of paths in space and time.

H_i is the turn of x(t) - o_i(t), with a marker o_i in every topological obstacle of every moving body. Between two rows
of either motion that is a straight line, which turns by one angle of at most half a turn. Paths are closed by waiting
at the goal point until the later of two arrivals. The class of a path counts whole turns more than the base's: straight
to the goal point at the best speed, as if nothing was in the way, and then waiting.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.motion import SHAPES, Motion, Mover
from pirrht.geometry.obstacle import Obstacle
from pirrht.geometry.scene import Footprint, Workspace
from pirrht.topology.homology import integers
from pirrht.topology.obstacles import components
from pirrht.topology.tracks import MarkerTrajectories, add_turns

PLANE = 1e3  # half the side of the plane in which a body is looked at on its own [m]
ASIDE = np.array([1.7e-3, -2.9e-3])  # markers from the middle of what they mark [robot radii]
OFF = 0.25  # a marker's way may be replaced by its chord if that is off by so many robot radii


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovingHomology:
    """Turns of paths in space and time about J markers that move; paths are (k, 3) of x, y [m] and t [s]."""

    names: tuple[str, ...]  # (J,) of the bodies that the markers belong to
    tracks: MarkerTrajectories
    goal: Array  # (2,) goal representative point [m]
    speed: float  # of the base, sqrt(2 q / r) [m/s]

    @classmethod
    def of(cls, movers: Sequence[Mover], footprint: Footprint, goal: Array, speed: float) -> MovingHomology:
        """Mark bodies for a robot, a goal point (2,) [m] and the best unhindered speed [m/s]."""
        rows = [(m, point) for m in movers for point in markers_of(m, footprint)]
        ways = [_way(mover.motion, point, OFF * footprint.radius) for mover, point in rows]
        periods = [m.motion.rows[-1, 0] if m.motion.repeat else 0.0 for m, _ in rows]
        point = np.array(goal, dtype=float)
        return cls(
            names=tuple(m.name for m, _ in rows),
            tracks=MarkerTrajectories.of(ways, periods, point),
            goal=point,
            speed=speed,
        )

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
        """Time at which the base that leaves x (2,) [m] at t arrives [s]."""
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

    They lie a little off the middle: bodies often come to stand with that on the straight line to the goal.
    """
    return _inside(mover.solids, footprint) + ASIDE * footprint.radius


@lru_cache(maxsize=SHAPES)  # bodies keep their solids when what they do is foretold anew
def _inside(solids: tuple[Obstacle, ...], footprint: Footprint) -> Array:
    """A point inside each of the topological obstacles that solids make, (m, 2) [m]."""
    plane = np.full(2, PLANE)
    parts = components(Collision(Workspace(-plane, plane, solids), footprint))
    return np.array([part.marker for part in parts if part.marker is not None], dtype=float).reshape(-1, 2)


def _way(motion: Motion, point: Array, off: float) -> Array:
    """Times [s] and places [m] of a point (2,) [m] of a body, (k, 3); chords are off by at most `off` [m]."""
    arm = float(np.hypot(*point))
    most = 2.0 * math.acos(max(1.0 - off / arm, 0.0)) if arm > off else math.inf
    yaws = motion.rows[:, 3]
    turned = np.abs(yaws[1:] - yaws[:-1]).max(initial=0.0)
    if arm == 0.0 or turned <= most:
        return _seen(motion.rows[:, 0] - motion.lead, motion.rows[:, 1:].T, point)
    times = [motion.rows[:1, 0]]
    for a, b in zip(motion.rows[:-1], motion.rows[1:], strict=True):
        pieces = max(1, math.ceil(abs(b[3] - a[3]) / most))
        times.append(np.linspace(a[0], b[0], pieces + 1)[1:])
    t = np.concatenate(times)
    poses = np.array([np.interp(t, motion.rows[:, 0], motion.rows[:, k]) for k in (1, 2, 3)])
    return _seen(t - motion.lead, poses, point)


def _seen(times: Array, poses: Array, point: Array) -> Array:
    """Times (k,) [s] and places of a point (2,) [m] of a body at poses (3, k), (k, 3)."""
    x, y, yaw = poses
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([times, x + c * point[0] - s * point[1], y + s * point[0] + c * point[1]])
