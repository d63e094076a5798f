"""Steering in space and time: a point that may go at any speed up to a limit, and wait, among bodies that move.

Vertices are x, y [m] and t [s] on the tree's clock. What leads from one to another is the straight way between them at
a constant speed, forward in time, and costs q dt + (r/2) |dx|^2 / dt. Arrival is free: the root has no time, and where
nothing is in the way one goes there at the best speed, sqrt(2 q / r).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.geometry.traffic import traffic_clearance
from pirrht.problem import Problem
from pirrht.steering.along_legs import LEGS, LegRecord, Legs, TimedSurroundings
from pirrht.steering.steering import Compiled, Steering
from pirrht.steering.tracked import Tracked
from pirrht.steering.trajectory import Trajectory
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.topology.in_time import TimedHomology

FASTER = 3.0  # speeds up to so many times the best one, if the robot has no limit of its own
LATE = 1e-9  # share by which rounding may exceed the limit of speeds
WIDE = 0.2  # share of the draws that are uniform in space and time
SLOWER = 0.5  # excess of cost that half of the other draws stay below, as a share of the unhindered cost
BESIDE = 0.3  # share of the others that lie beside a body ...
NEAR = 4.0  # ... so many robot radii away from the disc around it at most
TRIES = 32  # to draw a state that may be of use
ACROSS = (0.0, -0.9, 0.9, -0.5, 0.5)  # where passages are driven through, as a share of the room to either side
ALONG = (0.0, 3.0, -3.0)  # and how far from their narrowest chord [robot radii]
SPEEDS = (2.2, 1.8, 1.5, 1.25, 1.0, 0.75, 0.5)  # how fast on the way there, as a share of the best speed
MOST = 2.5  # times the unhindered cost that such a way may cost at least
OFFERED = 256  # states in passages, the cheapest


@inlined
def _cost(ax, ay, s, bx, by, t, numbers):  # type: ignore[no-untyped-def]
    """Cost and duration of a way; the time of its end may be open."""
    q, r, speed, pace = numbers
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    dt = math.sqrt(square) / pace if math.isnan(t) else t - s
    if math.isnan(s) or not dt >= 0.0 or square > (speed * dt) ** 2 * (1.0 + LATE):
        return np.inf, 0.0
    if dt == 0.0:
        return (0.0 if math.isnan(t) else np.inf), 0.0
    return q * dt + 0.5 * r * square / dt, dt


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """One way each; the numbers are q, r, the limit of speeds and the best speed."""
    k = tails.shape[0]
    path, cost = np.empty((k, 6)), np.empty(k)
    for i in range(k):
        ax, ay, s, bx, by, t = tails[i, 0], tails[i, 1], tails[i, 2], heads[i, 0], heads[i, 1], heads[i, 2]
        cost[i], dt = _cost(ax, ay, s, bx, by, t, numbers)
        path[i, 0], path[i, 1], path[i, 2] = ax, ay, s
        path[i, 3], path[i, 4], path[i, 5] = bx, by, s + dt if math.isnan(t) else t
    return LegRecord(path, cost, heads)


@kernel
def _nearest(states, x, numbers, forward, chosen, least):  # type: ignore[no-untyped-def]
    """Fill `chosen` with the states of least cost, cheapest first; of equal ones the earlier comes first."""
    count, found = chosen.shape[0], 0
    for i in range(states.shape[0]):
        if forward:
            d, _ = _cost(x[0], x[1], x[2], states[i, 0], states[i, 1], states[i, 2], numbers)
        else:
            d, _ = _cost(states[i, 0], states[i, 1], states[i, 2], x[0], x[1], x[2], numbers)
        if found < count:
            found += 1
        elif d >= least[count - 1]:
            continue
        at = found - 1
        while at > 0 and least[at - 1] > d:
            least[at], chosen[at] = least[at - 1], chosen[at - 1]
            at -= 1
        least[at], chosen[at] = d, i


@dataclass(frozen=True, slots=True, kw_only=True)
class InTime(Steering):
    """Ways of a point in space and time, for a robot that is one or for guides of another that track them.

    Args:
        q: cost rate [cost/s].
        r: weight of the velocity in q + (r/2) |v|^2 [cost s/m^2].
        speed: limit of speeds [m/s]; 0 is three times the best one.
        m: controls of a system that only tracks these ways; 0 is the point's own velocity.
        slack: time that such a system may take to get under way [s].

    Raises:
        OptionError: q or r is not a positive number, or the limit is a negative one or slower than the best speed.
    """

    q: float = 1.0
    r: float = 2.0
    speed: float = 0.0
    m: int = 0
    slack: float = 0.0

    n = 3
    symmetric = False
    asked = 500  # in haste one goes farther than to the cheapest neighbours
    motion = LEGS

    def __post_init__(self) -> None:
        for name in ("q", "r"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise OptionError(f"{name} is {value:g}; it must be a positive number")
        if not (np.isfinite(self.speed) and self.speed >= 0):
            raise OptionError(f"the limit of speeds is {self.speed:g}; it must be a number [m/s], 0 for none")

    @classmethod
    def of(cls, problem: Problem, speed: float = 0.0) -> InTime:
        """Ways for any problem: those of a point that is one, and what another may track at most at a speed [m/s].

        Raises:
            OptionError: the cost of the problem tells no pace, or the limit is no speed.
        """
        d = problem.dynamics
        R = problem.control_cost(np.zeros(d.n))
        if isinstance(d, SingleIntegrator) and np.allclose(R, R[0, 0] * np.eye(len(R))):
            return cls(q=problem.least_rate, r=float(R[0, 0]), speed=speed)
        lines = Tracked.of(problem)
        q = 0.5 * lines.cost_per_meter * lines.pace
        return cls(q=q, r=2.0 * q / lines.pace**2, speed=speed, m=d.m, slack=lines.slack)

    @property
    def drives(self) -> bool:  # type: ignore[override]
        """Whether the ways are a point's own, with the velocities that drive it."""
        return self.m == 0

    @property
    def pace(self) -> float:
        """The best speed, or the limit if that is less [m/s]."""
        best = math.sqrt(2.0 * self.q / self.r)
        return min(best, self.speed) if self.speed else best

    @property
    def limit(self) -> float:
        """The limit of speeds [m/s]."""
        return self.speed or FASTER * self.pace

    @property
    def cost_per_meter(self) -> float:
        """Cost of a way without anything in it [cost/m]."""
        return self.q / self.pace + 0.5 * self.r * self.pace

    @property
    def compiled(self) -> Compiled:
        """Ways as kernels; their numbers are q, r, the limit of speeds and the best one."""
        return Compiled(_nearest, _connect, (self.q, self.r, self.limit, self.pace))

    def homology(self, space: FreeSpace) -> TimedHomology:
        """Classes among what stands and what moves; bases go at the best speed."""
        return TimedHomology(standing=space.homology, moving=replace(space.moving, speed=self.pace))

    def surroundings(self, space: FreeSpace) -> TimedSurroundings:
        """What kernels know of a scene."""
        return TimedSurroundings.of(space, self.homology(space))

    def vertex_of(self, x: Array) -> Array:
        """The place and the time, (..., 3) [m, m, s], of states that begin with them."""
        return np.ascontiguousarray(x[..., :3], dtype=float)

    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost of the ways from tails to heads, (..., 3) x 2 -> (...,) [cost]; infinite where there is none."""
        tails, heads = np.broadcast_arrays(tails, heads)
        cost: Array = _connect(_rows(tails), _rows(heads), self.compiled.numbers).cost.reshape(tails.shape[:-1])
        return cost

    def connect(self, tails: Array, heads: Array) -> Legs:
        """The ways from tails (k, 3) to heads (k, 3) [m, m, s]."""
        tails, heads = _rows(np.atleast_2d(tails)), _rows(np.atleast_2d(heads))
        found = _connect(tails, heads, self.compiled.numbers)
        return Legs(path=found.path, cost=found.cost, tails=tails, heads=heads)

    def roots(self, goal: Array) -> Array:
        """The goal point (2,) [m] at any time, (1, 3)."""
        return np.array([[*goal, np.nan]])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A place and a time (3,) [m, m, s], uniform in the workspace up to the last row and the time to go."""
        x, y = rng.uniform(scene.lower, scene.upper)
        return np.array([x, y, rng.random() * self.horizon(scene)])

    def draw(self, space: FreeSpace, rng: np.random.Generator) -> Array:
        """A place and a time (3,) [m, m, s] from 0 on that are of use to a robot that leaves the scene's start at 0.

        Most draws cost no more on the way than some multiple of what nothing in the way would cost; some of these lie
        beside a body that moves, where ways around it bend. The others are uniform.
        """
        scene, J = space.scene, space.traffic.J
        (left, low), (right, high) = scene.lower.tolist(), scene.upper.tolist()
        if rng.random() < WIDE:
            return self.sample(scene, rng)
        beside, chance = J > 0 and rng.random() < BESIDE, rng.random()
        useful = _Useful.of(self, scene, 1.0 + SLOWER * chance / max(1.0 - chance, 1e-3))
        for a, b, c in rng.random((TRIES, 3)).tolist():
            if beside:
                j, t = int(rng.integers(J)), c * useful.latest(0.0)
                x, y, _ = scene.movers[j].motion.pose(t)
                angle = 2.0 * math.pi * a
                away = space.traffic.radius[j] + b**2 * NEAR * scene.robot_radius
                x, y = x + away * math.cos(angle), y + away * math.sin(angle)
            else:
                x, y = left + (right - left) * a, low + (high - low) * b
                soonest = useful.away(x, y) / self.limit
                t = soonest + c * useful.latest(soonest)
            inside = left < x < right and low < y < high
            if inside and useful(x, y, t) and useful.ahead(x, y) > scene.goal.radius:
                return np.array([x, y, t])
        return self.sample(scene, rng)

    def horizon(self, scene: Scene) -> float:
        """Until when draws are made: the last row of any motion, or its first lap, and the time to go [s]."""
        motions = [mover.motion for mover in scene.movers]
        last = max((float(m.rows[-1, 0]) if m.repeat else m.last for m in motions), default=0.0)
        return max(last, 0.0) + float(np.hypot(*(scene.upper - scene.lower))) / self.pace

    def offers(self, passages: Passages, space: FreeSpace) -> Array:
        """Places across and along passages at many times (l, 3) [m, m, s], where nothing is then: the cheapest."""
        left, right = passages.chords()
        start, radius, useful = space.scene.start[:2], space.scene.robot_radius, _Useful.of(self, space.scene, MOST)
        half = 0.5 * (right - left) * (1.0 - 2.0 * radius / np.maximum(passages.width, 2.0 * radius))[:, None]
        ahead = np.column_stack([np.cos(passages.heading), np.sin(passages.heading)])
        ahead *= np.where(np.sum(ahead * (passages.place - start), axis=1) < 0.0, -1.0, 1.0)[:, None]
        found = []
        for across, along, speed in product(ACROSS, ALONG, SPEEDS):
            middle = passages.place + across * half
            places, late = middle + along * radius * ahead, along * radius / (speed * self.pace)
            for (x, y), away in zip(places.tolist(), np.hypot(*(middle - start).T).tolist(), strict=True):
                t = away / (speed * self.pace) + late
                if useful(x, y, t) and traffic_clearance(space.traffic, x, y, t) > 0.0:
                    found.append((useful.cost(x, y, t), x, y, t))
        found.sort()
        return np.array([row[1:] for row in found[:OFFERED]]).reshape(-1, 3)

    def trajectory(self, path: Legs) -> Trajectory:
        """Velocities along a path, or just when it is where for a system that tracks it."""
        found = self.motion.trajectory(self, path)
        if self.drives:
            return found
        return replace(found, controls=np.zeros((len(found.durations), self.m)), slack=self.slack)


class _Useful(NamedTuple):
    """Which places at which times cost a robot no more than so much, by what is between start and goal at least."""

    start: tuple[float, float]  # [m]
    goal: tuple[float, float]  # [m]
    q: float  # [cost/s]
    r: float  # [cost s/m^2]
    meter: float  # [cost/m] of a way that nothing hinders
    most: float  # [cost]

    @classmethod
    def of(cls, steering: InTime, scene: Scene, multiple: float) -> _Useful:
        """Up to a multiple of the cost between a scene's start and its goal without anything in the way."""
        (sx, sy), (gx, gy) = scene.start[:2].tolist(), scene.goal.center.tolist()
        least = steering.cost_per_meter * math.hypot(gx - sx, gy - sy)
        return cls((sx, sy), (gx, gy), steering.q, steering.r, steering.cost_per_meter, multiple * least)

    def away(self, x: float, y: float) -> float:
        """How far a place is from the start [m]."""
        return math.hypot(x - self.start[0], y - self.start[1])

    def ahead(self, x: float, y: float) -> float:
        """How far it is from the goal point [m]."""
        return math.hypot(self.goal[0] - x, self.goal[1] - y)

    def latest(self, soonest: float) -> float:
        """How much later than a time [s] anything can be of use [s]."""
        return max(self.most / self.q - soonest, 0.0)

    def cost(self, x: float, y: float, t: float) -> float:
        """Of a way over a place at a time, at least [cost]."""
        return self.q * t + 0.5 * self.r * self.away(x, y) ** 2 / max(t, 1e-9) + self.meter * self.ahead(x, y)

    def __call__(self, x: float, y: float, t: float) -> bool:
        """Whether it is little enough."""
        return t > 0.0 and self.cost(x, y, t) <= self.most


def _rows(states: Array) -> Array:
    return np.ascontiguousarray(states, dtype=float).reshape(-1, 3)
