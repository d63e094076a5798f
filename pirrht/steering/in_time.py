"""Steer in space and time: a point that may go at any speed up to a limit, and wait, among moving obstacles.

Vertices are x, y [m] and t [s] on a tree's clock, joined by legs: straight lines at a constant speed, forward in time,
that cost q dt + (r/2) |dx|^2 / dt. Arrival is free: the root has no time, and the best speed there is sqrt(2 q / r).
A robot that is no disc has vertices with a heading, too; one in space x, y, z and t.
"""

import math
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined
from pirrht.problem import Problem
from pirrht.steering import relaxation
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.legs import (
    LEGS,
    LEGS_IN_SPACE,
    connect,
    connect_in_space,
    connect_turning,
    cost_and_duration,
    cost_in_space,
    turned_legs,
    turning_cost,
)  # fmt: skip
from pirrht.steering.motion import Legs
from pirrht.steering.pieces import InSpace, TrackedInSpace, in_ball
from pirrht.steering.steering import CompiledSteering
from pirrht.steering.straight_line import Tracked, velocity_at
from pirrht.steering.tuning import TUNING
from pirrht.steering.turn_and_go import alignment, arrivals
from pirrht.systems.dynamics import check_positive
from pirrht.topology.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class InTime(CompiledSteering):
    """Legs of a point in space and time, for a robot that is one or for proposals of another that track them.

    OptionError: q or r is not a positive number, or the limit is a negative one or slower than the best speed.
    """

    q: float = 1.0  # cost rate [cost/s]
    r: float = 2.0  # weight of the velocity in q + (r/2) |v|^2 [cost s/m^2]
    speed: float = 0.0  # limit of speeds [m/s]; 0: five times the best one
    m: int = 0  # controls of a system that only tracks these legs; 0: the point's own velocity
    slack: float = 0.0  # time that such a system may take to get under way [s]
    read: tuple[int, ...] = ()  # index of the state of such a system that is its heading, where that counts

    n = 3
    d = 2  # numbers of a place
    min_neighbours = 500  # in haste one goes farther than to the cheapest neighbours
    timed = True
    several = True
    motion = LEGS
    cost = inlined(lambda tail, head, numbers, limit: cost_and_duration(tail, head, numbers)[0])
    optimum = connect

    def __post_init__(self) -> None:
        check_positive(self, "q", "r")
        if not (np.isfinite(self.speed) and self.speed >= 0):
            raise OptionError(f"the limit of speeds is {self.speed:g}; it must be a number [m/s], 0 for none")

    @classmethod
    def of(cls, problem: Problem, speed: float = 0.0, pace: float | None = None) -> "InTime":
        """Take legs of a point, or for another system to track at its best speed `pace`, at most at a speed [m/s].

        None for a pace: that of least cost per meter. OptionError: the cost tells no pace, or the limit is no speed.
        """
        d = problem.dynamics
        R = problem.control_cost(np.zeros(d.n))
        in_space = problem.scene.dimension == 3
        cls = FlyInTime if in_space else cls
        if d.control_kind == "velocity" and np.allclose(R, R[0, 0] * np.eye(len(R))):
            return cls(q=problem.least_rate, r=float(R[0, 0]), speed=speed)
        lines = (TrackedInSpace if in_space else Tracked).of(problem, pace)
        q = 0.5 * lines.cost_per_meter * lines.pace
        known: dict[str, Any] = {"q": q, "r": 2.0 * q / lines.pace**2, "speed": speed, "m": d.m, "slack": lines.slack}
        if problem.scene.footprint.is_disc:
            return cls(**known)
        return TurnInTime(
            **known, cost_per_radian=lines.cost_per_meter * problem.scene.footprint.reach,
            reverses=velocity_at(problem, -1.0) < 0.0, read=d.angles[:1],
        )  # fmt: skip

    drives = property(
        lambda self: self.m == 0, doc="Whether the legs are a point's own, with velocities that drive it."
    )
    limit = property(lambda self: self.speed or TUNING.fastest * self.pace, doc="The limit of speeds [m/s].")

    @property
    def pace(self) -> float:
        """The best speed, or the limit if that is less [m/s]."""
        best = math.sqrt(2.0 * self.q / self.r)
        return min(best, self.speed) if self.speed else best

    @property
    def cost_per_meter(self) -> float:
        """Cost of an unhindered leg [cost/m]."""
        return self.q / self.pace + 0.5 * self.r * self.pace

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return q, r, the limit of speeds and the best speed."""
        return self.q, self.r, self.limit, self.pace

    def shorten(self, path: Legs, checker: EdgeChecker) -> Legs:
        """Shorten a path into the goal's disc inside its class, at no more cost, by relaxation of its knots."""
        return relaxation.taut_in_time(path, self.connect, self.numbers, checker)

    def resume(self, x: Array, path: Legs, checker: EdgeChecker) -> Legs | None:
        """Shorten the rest of a path from x (3,) [m, m, s] near it, in any class; None if none is left or free."""
        return relaxation.resumed(x, path, self.connect, self.numbers, checker)

    def homology(self, space: FreeSpace) -> Signature:
        """Classes among static and moving obstacles; bases go at the best speed."""
        return space.homology.with_speed(self.pace)

    def at(self, x: Array, time: float) -> Array:
        """Place and time [m, m, s], and heading [rad] where that counts, of a system's state x (n,) at a time [s]."""
        return np.array([*x[: self.d], time, *x[list(self.read)]])

    def vertex_of(self, x: Array) -> Array:
        """Place, time [m, m, s] and any heading [rad] of states that begin with them; OptionError if there are none."""
        if np.shape(x)[-1] < self.n:
            what = "x, y, z and t" if self.d == 3 else "x, y and t" if self.n == 3 else "x, y, t and a heading"
            raise OptionError(f"a state among moving obstacles is {what}; this one has {np.shape(x)[-1]} numbers")
        return np.ascontiguousarray(x[..., : self.n], dtype=float)

    def roots(self, goal: Array) -> Array:
        """The goal point (d,) [m] at any time, (1, d + 1)."""
        return np.array([[*goal, np.nan]])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A place and a time (d + 1,) [m, s], uniform in the workspace and the horizon."""
        return np.array([*rng.uniform(scene.lower, scene.upper), rng.random() * self.horizon(scene)])

    def draws(
        self, space: FreeSpace, rng: np.random.Generator, count: int, origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:  # fmt: skip
        """Draw places and times (count, d + 1) [m, s] of use to a robot at an origin (d + 1,); None: the start, at 0.

        A path over most of them costs at most a random multiple of the unhindered path (an informed set); the others
        are uniform in the workspace and the horizon. A `goal_share` of all is moved into the goal's disc.
        """
        scene = space.scene
        horizon = self.horizon(space.scene)
        begun, d = _origin(space.scene, origin), self.d

        chances = rng.random((count, 5 + 2 * d + (d + 1) * TUNING.tries))  # a row for each: equal in parts and at once
        tried = chances[:, 5 + 2 * d :].reshape(count, TUNING.tries, d + 1)
        span = scene.upper - scene.lower

        tried[..., :d] = scene.lower + span * tried[..., :d]
        excess = TUNING.excess * chances[:, 2] / np.maximum(1.0 - chances[:, 2], 1e-3)
        most = ((1.0 + excess) * self.cost_per_meter * math.dist(scene.goal.center, begun[:d]))[:, None]
        soonest = _length(tried[..., :d] - begun[:d]) / self.limit
        tried[..., d] *= np.maximum(np.minimum(most / self.q, horizon) - soonest, 0.0)
        tried[..., d] += begun[d] + soonest
        serves = (self._through(tried, begun, scene) <= most) & ~scene.goal.contains(tried[..., :d])
        out = np.column_stack([scene.lower + span * chances[:, 3 : 3 + d], begun[d] + horizon * chances[:, 3 + d]])
        informed = (chances[:, 0] >= TUNING.uniform_share) & serves.any(axis=1)
        out[informed] = tried[informed, serves[informed].argmax(axis=1)]

        inside = chances[:, 4 + d] < goal_share
        offset = self._in_goal(scene.goal.radius, chances[:, 5 + d : 5 + 2 * d])
        out[inside, :d] = scene.goal.center + offset[inside]
        return self.headed(out, space, rng)

    def _in_goal(self, radius: float, chances: Array) -> Array:
        """Places (k, d) in a disc or ball of a radius [m] around 0, uniform as chances (k, d) are."""
        angle = 2.0 * np.pi * chances[:, :1]
        return np.asarray(radius * np.sqrt(chances[:, 1:2]) * np.hstack([np.cos(angle), np.sin(angle)]))

    def headed(self, states: Array, space: FreeSpace, rng: np.random.Generator) -> Array:
        """Complete states (k, 3) [m, m, s] by what else a vertex has; here nothing."""
        return states

    def _through(self, places: Array, begun: Array, scene: Scene) -> Array:
        """Cost at least of a path from (d + 1,) through places and times (..., d + 1) [m, s] to the goal, (...,)."""
        d = self.d
        since = np.maximum(places[..., d] - begun[d], 1e-9)
        away, ahead = (_length(places[..., :d] - end) for end in (begun[:d], scene.goal.center))
        return np.asarray(self.q * since + 0.5 * self.r * away**2 / since + self.cost_per_meter * ahead)

    def horizon(self, scene: Scene) -> float:
        """Time for which draws are made: the last row of any motion, or its first lap, and the time to go [s]."""
        motions = [mover.motion for mover in scene.movers]
        last = max((float(m.rows[-1, 0]) if m.repeat else m.last for m in motions), default=0.0)
        return max(last, 0.0) + float(np.hypot.reduce(scene.upper - scene.lower)) / self.pace

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Places across and along passages at many times (l, 3) [m, m, s], free then: the cheapest."""
        begun, radius = _origin(space.scene, origin), space.scene.robot_radius
        left, right = passages.chords()
        half = 0.5 * (right - left) * (1.0 - 2.0 * radius / np.maximum(passages.width, 2.0 * radius))[:, None]
        ahead = np.column_stack([np.cos(passages.heading), np.sin(passages.heading)])
        ahead *= np.where(np.sum(ahead * (passages.place - begun[:2]), axis=1) < 0.0, -1.0, 1.0)[:, None]
        across, along, paces = map(np.array, (TUNING.passage_offsets, TUNING.passage_places, TUNING.passage_paces))
        middles = passages.place + np.multiply.outer(across, half)[:, None]
        places = middles + radius * np.multiply.outer(along, ahead)  # (across, along, P, 2)
        times = begun[2] + np.divide.outer(
            np.linalg.norm(middles - begun[:2], axis=-1) + radius * along[:, None], self.pace * paces
        )
        states = np.concatenate([np.repeat(places[..., None, :], len(paces), axis=-2), times[..., None]], axis=-1)
        states = self.headed(states.reshape(-1, 3), space, np.random.default_rng(0))
        return self._cheapest(states, begun, space)

    def _cheapest(self, states: Array, begun: Array, space: FreeSpace) -> Array:
        """Those of states (k, n), free then, by which a path from `begun` costs least (l, n)."""
        cost, d = self._through(states, begun, space.scene), self.d
        most = TUNING.passage_cost * self.cost_per_meter * math.dist(space.scene.goal.center, begun[:d])
        free = [
            cost[i] <= most and space.moving.clearance((*state[:d], *state[d + 1 :]), state[d]) > 0.0
            for i, state in enumerate(states.tolist())
        ]
        return states[np.flatnonzero(free)[np.argsort(cost[free], kind="stable")][: TUNING.passage_states]]


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnInTime(InTime):
    """Legs in space and time with turns on the spot at their ends, for a robot that is no disc: x, y, t, heading."""

    cost_per_radian: float  # [cost/rad]
    reverses: bool  # whether the system can drive backwards

    n = 4
    heading = 3
    cost = turning_cost
    optimum = connect_turning
    shorten = CompiledSteering.shorten
    resume = CompiledSteering.resume
    motion = property(lambda self: turned_legs(self.reverses), doc="Kind of its motions.")

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return those of legs, the cost per radian, and 1 if it reverses."""
        return *super(TurnInTime, self).numbers, self.cost_per_radian, float(self.reverses)

    def roots(self, goal: Array) -> Array:
        """Spread headings at the goal point (2,) [m] at any time, (k, 4)."""
        headings = arrivals(self.reverses)
        return np.column_stack([np.tile([*goal, np.nan], (len(headings), 1)), headings])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A place, a time and a heading (4,) [m, m, s, rad], uniform in the workspace and the horizon."""
        return np.append(super(TurnInTime, self).sample(scene, rng), rng.uniform(-np.pi, np.pi))

    def headed(self, states: Array, space: FreeSpace, rng: np.random.Generator) -> Array:
        """Head states (k, 3) [m, m, s] anywhere or to the goal, (k, 4), where not all is free as most is: half each."""
        to_goal = (space.scene.goal.center - states[:, :2]).T
        goes, aligned = rng.random((2, len(states))) < TUNING.aligned_share
        headings = np.where(goes, np.arctan2(to_goal[1], to_goal[0]), rng.uniform(-np.pi, np.pi, len(states)))
        poses = np.column_stack([states[:, :2], headings])
        align = alignment(space.static.kernels.clearance, space.static.kernels.place)
        align(space.static, turned := poses[aligned], TUNING.aligned_headings)
        poses[aligned] = turned
        return np.column_stack([states, poses[:, 2]])


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyInTime(InTime):
    """Legs in space and time for a robot in space: x, y, z and t. Paths are shortened as chains of legs."""

    n = 4
    d = 3
    cost = cost_in_space
    optimum = connect_in_space
    motion = LEGS_IN_SPACE
    shorten = CompiledSteering.shorten
    resume = CompiledSteering.resume

    def _in_goal(self, radius: float, chances: Array) -> Array:
        return in_ball(radius, chances)

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Places in loops of obstacles (`InSpace.offers`) at many times (l, 4) [m, s], free then: the cheapest."""
        begun = _origin(space.scene, origin)
        places = InSpace().offers(passages, space)
        after = np.divide.outer(np.linalg.norm(places - begun[:3], axis=1), self.pace * np.array(TUNING.passage_paces))
        times = begun[3] + after.reshape(-1, 1)
        return self._cheapest(np.hstack([np.repeat(places, after.shape[1], axis=0), times]), begun, space)


def _length(ways: Array) -> Array:
    """Lengths (...,) of ways (..., d), quickly for many [m]."""
    return np.asarray(reduce(np.hypot, ways.T).T)


def _origin(scene: Scene, origin: Array | None) -> Array:
    """Return the robot's place and time, (d + 1,) [m, s]; without one the start of a scene at 0."""
    return np.array([*scene.place, 0.0]) if origin is None else origin


def homology_of(problem: Problem, space: FreeSpace) -> Signature:
    """Choose the classes of a problem's paths: in space and time, with bases at the best speed, if obstacles move."""
    if not problem.scene.movers:
        return space.homology
    try:
        return InTime.of(problem).homology(space)
    except OptionError:
        return InTime(
            q=problem.least_rate, r=float(problem.control_cost(problem.dynamics.state_of(problem.scene.start))[0, 0])
        ).homology(space)
