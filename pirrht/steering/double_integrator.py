"""A mass that is pushed: the exact optimum between two states with free duration (Webb and van den Berg 2013).

Among motions from (p0, v0) to (p1, v1) that take T seconds the one of least integral of q + (r/2) |a|^2 has an
acceleration linear in time. With D = p1 - p0 its cost is J(T) = q T + A / T^3 + B / T^2 + C / T, where

    fixed v1  A = 6 r |D|^2      B = -6 r D.(v0 + v1)   C = 2 r (|v0|^2 + v0.v1 + |v1|^2)
    free v1   A = (3/2) r |D|^2  B = -3 r D.v0          C = (3/2) r |v0|^2

A minimum is where q T^4 - C T^2 - 2 B T - 3 A goes from negative to positive. Of two minima either may be the better
one, and the wrong one can cost many times the optimum. A free v1 is written as not a number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.problem import Problem
from pirrht.steering.cubics import CUBICS, Cubics
from pirrht.steering.steering import CompiledSteering
from pirrht.steering.tuning import TUNING
from pirrht.systems.double_integrator import DoubleIntegrator, best_duration
from pirrht.systems.dynamics import check_positive


@kernel
def optimum(tail, head, q, r):  # type: ignore[no-untyped-def]
    """Duration [s] and cost of the optimum between states (4,), as tuples; infinite from a free velocity."""
    if math.isnan(tail[2]):
        return np.inf, np.inf
    dx, dy, ux, uy = head[0] - tail[0], head[1] - tail[1], tail[2], tail[3]
    square, before = dx * dx + dy * dy, ux * ux + uy * uy
    if math.isnan(head[2]):
        if square == 0.0:
            return 0.0, 0.0
        return best_duration(q, 1.5 * r * square, -3.0 * r * (dx * ux + dy * uy), 1.5 * r * before)
    wx, wy = head[2], head[3]
    if square == 0.0 and ux == wx and uy == wy:
        return 0.0, 0.0
    along = dx * (ux + wx) + dy * (uy + wy)
    return best_duration(
        q, 6.0 * r * square, -6.0 * r * along, 2.0 * r * (before + ux * wx + uy * wy + wx * wx + wy * wy)
    )


@kernel
def accelerations(tail, head, T):  # type: ignore[no-untyped-def]
    """(c0x, c0y, c1x, c1y) of the optimal acceleration c0 + c1 s between states (4,) that takes T [s]."""
    dx, dy, ux, uy = head[0] - tail[0], head[1] - tail[1], tail[2], tail[3]
    if T <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    if math.isnan(head[2]):
        x, y = 3.0 * (dx - ux * T) / (T * T), 3.0 * (dy - uy * T) / (T * T)
        return x, y, -x / T, -y / T
    wx, wy = head[2], head[3]
    return (
        6.0 * dx / (T * T) - (4.0 * ux + 2.0 * wx) / T,
        6.0 * dy / (T * T) - (4.0 * uy + 2.0 * wy) / T,
        -12.0 * dx / (T * T * T) + 6.0 * (ux + wx) / (T * T),
        -12.0 * dy / (T * T * T) + 6.0 * (uy + wy) / (T * T),
    )


@inlined
def _cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    """Cost of the optimum; a change of velocity alone costs sqrt(2 q r) |dv| at least."""
    q, r = numbers
    dv = math.hypot(head[2] - tail[2], head[3] - tail[3])
    return np.inf if math.sqrt(2.0 * q * r) * dv > limit else optimum(tail, head, q, r)[1]


@kernel
def _connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one motion; the numbers are q and r."""
    k, (q, r) = tails.shape[0], numbers
    path, duration, cost, rates = np.empty((k, 8)), np.empty(k), np.empty(k), np.empty((k, 2))
    for i in range(k):
        tail, head = as_tuple(tails[i], 4), as_tuple(heads[i], 4)
        duration[i], cost[i] = optimum(tail, head, q, r)
        c = accelerations(tail, head, duration[i])
        for d in range(4):
            path[i, d], path[i, 4 + d] = tail[d], c[d]
        rates[i, 0], rates[i, 1] = q, r
    return Cubics(path, duration, cost, tails, heads, rates)


@dataclass(frozen=True, slots=True, kw_only=True)
class MassSteering(CompiledSteering):
    """The double integrator's optimum for the integral of q + (r/2) |a|^2 (Webb and van den Berg 2013).

    The root is the goal point with a free velocity, which is written as not a number.

    Args:
        q: cost rate [cost/s].
        r: weight of the acceleration [cost s^3/m^2].
        top: speeds up to this are drawn [m/s].

    Raises:
        OptionError: one of them is not a positive number.
    """

    q: float = 1.0
    r: float = 2.0
    top: float = 2.0

    n = 4
    motion = CUBICS
    cost = _cost
    optimum = _connect

    def __post_init__(self) -> None:
        check_positive(self, "q", "r", "top")

    @classmethod
    def of(cls, problem: Problem) -> MassSteering:
        """Take the optimum of a problem of a `DoubleIntegrator` with q constant and R a multiple of the identity.

        Speeds are drawn up to that at which the best motion from rest across the workspace arrives. OptionError for
        others.
        """
        d = problem.dynamics
        if not isinstance(d, DoubleIntegrator):
            raise OptionError(f"cubic motions steer a DoubleIntegrator, not {type(d).__name__}; bring a Steering")
        R = problem.control_cost(np.zeros(4))
        if not np.allclose(R, R[0, 0] * np.eye(2)):
            raise OptionError("cubic motions are optimal only for R a multiple of the identity; bring a Steering")
        q, r = problem.least_rate, float(R[0, 0])
        across = float(np.hypot(*(problem.scene.upper - problem.scene.lower)))
        return cls(q=q, r=r, top=1.5 * across / (4.5 * r * across**2 / q) ** 0.25)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return q [cost/s] and r [cost s^3/m^2]."""
        return self.q, self.r

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A state (4,): uniform in the workspace, in direction and in speed up to `top`."""
        x, y = rng.uniform(scene.lower, scene.upper)
        angle, speed = rng.uniform(-np.pi, np.pi), self.top * rng.random()
        return np.array([x, y, speed * np.cos(angle), speed * np.sin(angle)])

    def at_rest(self, x: Array) -> Array:
        """Return that place (4,) with no velocity."""
        return np.array([x[0], x[1], 0.0, 0.0])

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Every point (k, 3) driven through both ways, slower and faster, (4 k, 4)."""
        turned = np.column_stack([np.cos(path[:, 2]), np.sin(path[:, 2])])
        states = [
            np.hstack([path[:, :2], sign * share * self.top * turned])
            for share in TUNING.passage_speeds
            for sign in (1.0, -1.0)
        ]
        return np.stack(states, axis=1).reshape(-1, 4)

    def roots(self, goal: Array) -> Array:
        """The goal point (2,) [m] at any velocity, (1, 4)."""
        return np.array([[*goal, np.nan, np.nan]])
