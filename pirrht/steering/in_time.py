"""Steer in space and time: a point that may go at any speed up to a limit, and wait, among moving obstacles.

Vertices are x, y [m] and t [s] on the tree's clock, joined by straight lines at a constant speed, forward in time, that
cost q dt + (r/2) |dx|^2 / dt. Arrival is free: the root has no time, and where nothing is in the way the point goes
there at the best speed, sqrt(2 q / r).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.problem import Problem
from pirrht.steering.legs import Legs, legs_among
from pirrht.steering.motion import Motion, Trajectory
from pirrht.steering.steering import CompiledSteering
from pirrht.steering.tracked import Tracked
from pirrht.steering.tuning import TUNING
from pirrht.steering.useful import drawn, offered
from pirrht.systems.dynamics import check_positive
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.topology.homology import Homology

LATE = 1e-9  # share by which rounding may exceed the limit of speeds


@inlined
def _cost_and_duration(tail, head, numbers):  # type: ignore[no-untyped-def]
    """Cost and duration of a leg; the time of its end may be open."""
    q, r, speed, pace = numbers
    dx, dy = head[0] - tail[0], head[1] - tail[1]
    square = dx * dx + dy * dy
    dt = math.sqrt(square) / pace if math.isnan(head[2]) else head[2] - tail[2]
    if math.isnan(tail[2]) or not dt >= 0.0 or square > (speed * dt) ** 2 * (1.0 + LATE):
        return np.inf, 0.0
    if dt == 0.0:
        return (0.0 if math.isnan(head[2]) else np.inf), 0.0
    return q * dt + 0.5 * r * square / dt, dt


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    return _cost_and_duration(tail, head, numbers)[0]


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one leg; the numbers are q, r, the limit of speeds and the best speed."""
    k = tails.shape[0]
    path, cost = np.empty((k, 6)), np.empty(k)
    for i in range(k):
        cost[i], dt = _cost_and_duration(as_tuple(tails[i], 3), as_tuple(heads[i], 3), numbers)
        for c in range(3):
            path[i, c], path[i, 3 + c] = tails[i, c], heads[i, c]
        if math.isnan(heads[i, 2]):
            path[i, 5] = tails[i, 2] + dt
    return Legs(path, cost, tails, heads)


@dataclass(frozen=True, slots=True, kw_only=True)
class InTime(CompiledSteering):
    """Legs of a point in space and time, for a robot that is one or for proposals of another that track them.

    Args:
        q: cost rate [cost/s].
        r: weight of the velocity in q + (r/2) |v|^2 [cost s/m^2].
        speed: limit of speeds [m/s]; 0 is five times the best one.
        m: controls of a system that only tracks these legs; 0 is the point's own velocity.
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
    min_neighbours = 500  # in haste one goes farther than to the cheapest neighbours
    timed = True
    motion = legs_among(None)
    cost = _cost
    optimum = _connect

    def __post_init__(self) -> None:
        check_positive(self, "q", "r")
        if not (np.isfinite(self.speed) and self.speed >= 0):
            raise OptionError(f"the limit of speeds is {self.speed:g}; it must be a number [m/s], 0 for none")

    @classmethod
    def of(cls, problem: Problem, speed: float = 0.0, pace: float | None = None) -> InTime:
        """Take legs for any problem, of a point or for another system to track, at most at a speed [m/s].

        Args:
            pace: the best speed of another [m/s]; None: that at which its cost per meter is least.

        Raises:
            OptionError: the cost of the problem tells no pace, or the limit is no speed.
        """
        d = problem.dynamics
        R = problem.control_cost(np.zeros(d.n))
        if isinstance(d, SingleIntegrator) and np.allclose(R, R[0, 0] * np.eye(len(R))):
            return cls(q=problem.least_rate, r=float(R[0, 0]), speed=speed)
        lines = Tracked.of(problem, pace)
        q = 0.5 * lines.cost_per_meter * lines.pace
        return cls(q=q, r=2.0 * q / lines.pace**2, speed=speed, m=d.m, slack=lines.slack)

    @property
    def drives(self) -> bool:  # type: ignore[override]
        """Tell whether the legs are a point's own, with the velocities that drive it."""
        return self.m == 0

    @property
    def pace(self) -> float:
        """The best speed, or the limit if that is less [m/s]."""
        best = math.sqrt(2.0 * self.q / self.r)
        return min(best, self.speed) if self.speed else best

    @property
    def limit(self) -> float:
        """The limit of speeds [m/s]."""
        return self.speed or TUNING.fastest * self.pace

    @property
    def cost_per_meter(self) -> float:
        """Cost of an unhindered leg [cost/m]."""
        return self.q / self.pace + 0.5 * self.r * self.pace

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return q, r, the limit of speeds and the best speed."""
        return self.q, self.r, self.limit, self.pace

    def motion_in(self, space: FreeSpace) -> Motion:
        """Return its legs among the moving obstacles of a space."""
        return legs_among(space.moving.kernels)

    def homology(self, space: FreeSpace) -> Homology:
        """Classes among static and moving obstacles; bases go at the best speed."""
        return replace(space.homology, speed=self.pace)

    def at(self, x: Array, time: float) -> Array:
        """Place and time (3,) [m, m, s] of a system's state x (n,) at a time [s]."""
        return np.array([x[0], x[1], time])

    def vertex_of(self, x: Array) -> Array:
        """Place and time, (..., 3) [m, m, s], of states that begin with them; OptionError if a state has no time."""
        if np.shape(x)[-1] < self.n:
            raise OptionError(f"a state among moving obstacles is x, y and t; this one has {np.shape(x)[-1]} numbers")
        return np.ascontiguousarray(x[..., :3], dtype=float)

    def roots(self, goal: Array) -> Array:
        """The goal point (2,) [m] at any time, (1, 3)."""
        return np.array([[*goal, np.nan]])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A place and a time (3,) [m, m, s], uniform in the workspace up to the last row and the time to go."""
        x, y = rng.uniform(scene.lower, scene.upper)
        return np.array([x, y, rng.random() * self.horizon(scene)])

    def draws(
        self,
        space: FreeSpace,
        rng: np.random.Generator,
        count: int,
        origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:
        """Draw places and times (count, 3) [m, m, s], mostly of use to a robot at an origin (3,); None: start, at 0.

        A `goal_share` of them is moved into the goal's disc.
        """
        begun = self.origin(space.scene) if origin is None else origin
        return drawn(self.numbers, space, begun, self.horizon(space.scene), rng, count, goal_share)

    def origin(self, scene: Scene) -> Array:
        """The start of a scene at 0, (3,) [m, m, s]."""
        return np.array([scene.start[0], scene.start[1], 0.0])

    def horizon(self, scene: Scene) -> float:
        """Time for which draws are made: the last row of any motion, or its first lap, and the time to go [s]."""
        return _last(scene.movers) + float(np.hypot(*(scene.upper - scene.lower))) / self.pace

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Places across and along passages at many times (l, 3) [m, m, s], free then."""
        begun = self.origin(space.scene) if origin is None else origin
        return offered(self.numbers, passages, space, begun)

    def trajectory(self, path: Legs) -> Trajectory:
        """Velocities along a path, or only its times for a system that tracks it."""
        found = self.motion.trajectory(self, path)
        if self.drives:
            return found
        return replace(found, controls=np.zeros((len(found.durations), self.m)), slack=self.slack)


@lru_cache(maxsize=4)  # asked for by every draw
def _last(movers: tuple[Mover, ...]) -> float:
    """Time at which the last of motions ends, or their first lap [s]."""
    motions = [mover.motion for mover in movers]
    return max(0.0, *(float(m.rows[-1, 0]) if m.repeat else m.last for m in motions), 0.0)


def homology_of(problem: Problem, space: FreeSpace) -> Homology:
    """Choose the classes of a problem's paths: those in space and time among moving obstacles.

    Bases go at the best speed; if the cost tells none, controls are taken for velocities.
    """
    if not problem.scene.movers:
        return space.homology
    try:
        return InTime.of(problem).homology(space)
    except OptionError:
        r = float(problem.control_cost(problem.dynamics.state_of(problem.scene.start))[0, 0])
        return InTime(q=problem.least_rate, r=r).homology(space)
