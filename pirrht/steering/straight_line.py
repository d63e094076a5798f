"""Connect points by straight lines: the optimum without inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.arcs import Curves
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined, kernel
from pirrht.problem import Problem
from pirrht.steering.steering import CompiledSteering


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    dx, dy = head[0] - tail[0], head[1] - tail[1]
    return math.sqrt(dx * dx + dy * dy) * numbers[0]


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one straight piece; the number is the cost per meter."""
    k = tails.shape[0]
    start, curvature, length, cost = np.empty((k, 3)), np.zeros((k, 1)), np.empty((k, 1)), np.empty(k)
    for i in range(k):
        dx, dy = heads[i, 0] - tails[i, 0], heads[i, 1] - tails[i, 1]
        start[i, 0], start[i, 1], start[i, 2] = tails[i, 0], tails[i, 1], math.atan2(dy, dx)
        length[i, 0] = math.hypot(dx, dy)
        cost[i] = length[i, 0] * numbers[0]
    return Curves(start, curvature, length, cost, tails, heads)


class Lines(CompiledSteering):
    """A steering method whose vertices are positions (2,) [m], joined by straight lines at one speed.

    It has `pace`, the speed [m/s], and `cost_per_meter` [cost/m].
    """

    n = 2
    symmetric = True
    cost = _cost
    optimum = _connect
    pace: float
    cost_per_meter: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the cost per meter [cost/m]."""
        return (self.cost_per_meter,)

    @property
    def speed(self) -> float:
        """The constant pace [m/s]."""
        return self.pace

    def controls(self, heading: Array, curvature: Array) -> Array:
        """Velocity (l, 2) [m/s] along the heading (l,) [rad]; straight lines have no curvature."""
        return self.pace * np.column_stack([np.cos(heading), np.sin(heading)])

    def roots(self, goal: Array) -> Array:
        """Return the goal point (2,) [m] itself, (1, 2)."""
        return goal[None, :].astype(float)

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Return the points (k, 2) [m] of a path (k, 3)."""
        return np.ascontiguousarray(path[:, :2])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Draw a point (2,) [m], uniform in the workspace."""
        return np.asarray(scene.lower + (scene.upper - scene.lower) * rng.random(2))


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightLine(Lines):
    """The single integrator's optimum: a straight line at the speed that balances q against u'Ru/2."""

    pace: float = 1.0  # speed [m/s]
    cost_rate: float = 2.0  # q + u'Ru/2 at that speed [cost/s]

    @classmethod
    def of(cls, problem: Problem) -> StraightLine:
        """Take the optimal line of a problem with q constant and R a multiple of the identity (q = 1, R = 2I: speed 1).

        Raises:
            OptionError: the dynamics is no point in the plane that is pushed around, or R is another.
        """
        d = problem.dynamics
        if not d.n == d.m == 2:
            raise OptionError(
                f"straight lines steer a point whose 2 states are both actuated, not {type(d).__name__} with n = {d.n} "
                f"and m = {d.m}; bring a Steering"
            )
        R = problem.control_cost(np.zeros(problem.dynamics.n))
        if not np.allclose(R, R[0, 0] * np.eye(len(R))):
            raise OptionError("straight lines are optimal only for R a multiple of the identity; bring a Steering")
        speed = float(np.sqrt(2.0 * problem.least_rate / R[0, 0]))
        return cls(pace=speed, cost_rate=2.0 * problem.least_rate)

    @property
    def cost_per_meter(self) -> float:  # type: ignore[override]
        """Cost rate over speed [cost/m]."""
        return self.cost_rate / self.pace
