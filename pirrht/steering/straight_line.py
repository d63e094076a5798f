"""Connect points by straight lines: the optimum without inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.arcs import Curves
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import kernel
from pirrht.problem import Problem
from pirrht.steering.along_arcs import Arcs
from pirrht.steering.steering import Compiled, Steering


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
    return Arcs(start, curvature, length, cost, heads)


@kernel
def _nearest(states, x, numbers, forward, chosen, square):  # type: ignore[no-untyped-def]
    """Fill `chosen` with the nearest states, nearest first; of equally near ones the earlier comes first."""
    count = chosen.shape[0]
    found, limit = 0, np.inf
    for i in range(states.shape[0]):
        dx, dy = states[i, 0] - x[0], states[i, 1] - x[1]
        d = dx * dx + dy * dy
        if d >= limit:
            continue
        at = min(found, count - 1)
        found = min(found + 1, count)
        while at > 0 and square[at - 1] > d:
            square[at], chosen[at] = square[at - 1], chosen[at - 1]
            at -= 1
        square[at], chosen[at] = d, i
        if found == count:
            limit = square[count - 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class StraightLine(Steering):
    """The single integrator's optimum: a straight line at the speed that balances q against u'Ru/2."""

    pace: float = 1.0  # speed [m/s]
    cost_rate: float = 2.0  # q + u'Ru/2 at that speed [cost/s]

    n = 2
    symmetric = True

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
    def compiled(self) -> Compiled:
        """Straight lines as kernels; their number is the cost per meter [cost/m]."""
        return Compiled(_nearest, _connect, (self.cost_per_meter,))

    @property
    def cost_per_meter(self) -> float:
        """Cost rate over speed [cost/m]."""
        return self.cost_rate / self.pace

    @property
    def speed(self) -> float:
        """The constant pace [m/s]."""
        return self.pace

    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost rate times travel time from tails to heads, (..., 2) x 2 -> (...,) [cost]."""
        gap = heads - tails
        cost: Array = np.hypot(gap[..., 0], gap[..., 1]) * self.cost_per_meter
        return cost

    def connect(self, tails: Array, heads: Array) -> Curves:
        """One straight piece each from tails (k, 2) to heads (k, 2) [m], (k, 1) pieces."""
        tails, heads = (np.ascontiguousarray(np.atleast_2d(states), dtype=float) for states in (tails, heads))
        arcs = _connect(tails, heads, self.compiled.numbers)
        return Curves(**arcs._asdict(), tails=tails)

    def controls(self, heading: Array, curvature: Array) -> Array:
        """Velocity (l, 2) [m/s] along the heading (l,) [rad]; straight lines have no curvature."""
        return self.pace * np.column_stack([np.cos(heading), np.sin(heading)])

    def roots(self, goal: Array) -> Array:
        """The goal point (2,) [m] itself, (1, 2)."""
        return goal[None, :].astype(float)

    def states_along(self, way: Array, scene: Scene) -> Array:
        """The points (k, 2) [m] themselves."""
        return np.ascontiguousarray(way[:, :2])

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A point (2,) [m], uniform in the workspace."""
        return np.asarray(scene.lower + (scene.upper - scene.lower) * rng.random(2))
