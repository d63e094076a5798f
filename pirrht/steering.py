"""Obstacle-blind optimal connections between two states (the paper's TPBVP) and the paths made of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.curves import Curves
from pirrht.errors import OptionError
from pirrht.jit import kernel
from pirrht.problem import Problem
from pirrht.scene import Array, Scene

SPACING = 0.05  # distance of points on drawn arcs [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A deterministic path with the controls that drive it, piecewise constant in time."""

    controls: Array  # (l, m) control of each piece
    durations: Array  # (l,) [s]
    path: Curves  # rows are consecutive curves
    cost: float  # steering cost
    length: float  # [m]

    @cached_property
    def points(self) -> Array:
        """The path as a polyline (k, 2), for pictures [m]; points on arcs are SPACING apart."""
        lines = self.path.points(SPACING)
        return np.vstack([lines[0], *(line[1:] for line in lines[1:])])

    def tape(self, times: Array) -> Array:
        """Mean control of each step of a grid (T+1,) [s], (T, m); zero after the end (the paper's footnote)."""
        out = np.zeros((len(times) - 1, self.controls.shape[1]))
        _resample(self.controls, self.durations, times, out)
        return out


class Compiled(NamedTuple):
    """A steering method as kernels, for growth that need not come back to Python."""

    nearest: Callable[..., None]  # (states, x, radius, forward, chosen, work): what `Steering.nearest` does
    connect: Callable[..., None]  # (tails, heads, radius, start, curvature, length): pieces of the optimal curves
    pieces: int  # P


class Steering(ABC):
    """Optimal curves of the deterministic system without obstacles, and what they cost."""

    n: int  # states of a vertex
    symmetric: bool = False  # whether every curve may be driven the other way round at the same cost

    @abstractmethod
    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost of the obstacle-blind optimum from tails to heads, (..., n) x 2 -> (...,). Need not be symmetric."""

    @abstractmethod
    def connect(self, tails: Array, heads: Array) -> Curves:
        """The optimal curves from tails (k, n) to heads (k, n)."""

    @abstractmethod
    def controls(self, heading: Array, curvature: Array) -> Array:
        """Controls (l, m) that drive pieces starting at headings (l,) [rad] with curvatures (l,) [1/m]."""

    @abstractmethod
    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A random state of the workspace, (n,)."""

    @abstractmethod
    def roots(self, goal: Array) -> Array:
        """States (k, n) at the goal point (2,) that the tree starts from."""

    def nearest(self, states: Array, x: Array, count: int, *, forward: bool) -> NDArray[np.int64]:
        """Indices of the `count` states that cost least to reach from x (forward) or to come from."""
        cost = self.distance(x, states) if forward else self.distance(states, x)
        if count >= len(states):
            return np.argsort(cost, kind="stable")
        chosen = np.argpartition(cost, count)[:count]
        return np.asarray(chosen[np.argsort(cost[chosen], kind="stable")])

    @property
    def compiled(self) -> Compiled | None:
        """The same methods for kernels, with which a tree grows faster; None if there are none."""
        return None

    @property
    def radius(self) -> float:
        """That of the tightest turn [m]; 0 where there is none."""
        return 0.0

    @property
    @abstractmethod
    def cost_per_meter(self) -> float:
        """Steering cost of one meter of curve."""

    @property
    @abstractmethod
    def speed(self) -> float:
        """Speed along the curves [m/s]."""

    def trajectory(self, path: Curves) -> Trajectory:
        """The controls along a path whose rows are consecutive curves."""
        pieces = path.curvature.shape[1]
        heading = path.start[:, 2:] + np.cumsum(path.curvature * path.length, axis=1) - path.curvature * path.length
        length, keep = path.length.ravel(), path.length.ravel() > 0
        total = float(length.sum())
        return Trajectory(
            controls=self.controls(heading.reshape(-1, pieces).ravel()[keep], path.curvature.ravel()[keep]),
            durations=length[keep] / self.speed,
            path=path,
            cost=total * self.cost_per_meter,
            length=total,
        )


@kernel
def _connect(tails, heads, radius, start, curvature, length):  # type: ignore[no-untyped-def]
    """Write one straight piece each."""
    for i in range(tails.shape[0]):
        dx, dy = heads[i, 0] - tails[i, 0], heads[i, 1] - tails[i, 1]
        start[i, 0], start[i, 1], start[i, 2] = tails[i, 0], tails[i, 1], math.atan2(dy, dx)
        curvature[i, 0], length[i, 0] = 0.0, math.hypot(dx, dy)


@kernel
def _nearest(states, x, radius, forward, chosen, square):  # type: ignore[no-untyped-def]
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
        """The optimal line of a problem with q constant and R a multiple of the identity (q = 1, R = 2I: speed 1)."""
        R = problem.control_cost(np.zeros(problem.dynamics.n))
        if not np.allclose(R, R[0, 0] * np.eye(len(R))):
            raise OptionError("straight lines are optimal only for R a multiple of the identity; bring a Steering")
        speed = float(np.sqrt(2.0 * problem.least_rate / R[0, 0]))
        return cls(pace=speed, cost_rate=2.0 * problem.least_rate)

    @property
    def compiled(self) -> Compiled:
        """Straight lines as kernels."""
        return Compiled(_nearest, _connect, 1)

    @property
    def cost_per_meter(self) -> float:
        """Cost rate over speed."""
        return self.cost_rate / self.pace

    @property
    def speed(self) -> float:
        """The constant pace."""
        return self.pace

    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost rate times travel time, (...,)."""
        gap = heads - tails
        cost: Array = np.hypot(gap[..., 0], gap[..., 1]) * self.cost_per_meter
        return cost

    def connect(self, tails: Array, heads: Array) -> Curves:
        """One straight piece each."""
        tails, heads = (np.ascontiguousarray(np.atleast_2d(states), dtype=float) for states in (tails, heads))
        start, curvature, length = np.empty((len(tails), 3)), np.empty((len(tails), 1)), np.empty((len(tails), 1))
        _connect(tails, heads, self.radius, start, curvature, length)
        cost = length[:, 0] * self.cost_per_meter
        return Curves(start=start, curvature=curvature, length=length, cost=cost, tails=tails, heads=heads)

    def nearest(self, states: Array, x: Array, count: int, *, forward: bool) -> NDArray[np.int64]:
        """Indices of the `count` nearest states; both directions cost the same."""
        chosen = np.empty(min(count, len(states)), dtype=np.int64)
        _nearest(states, x, self.radius, forward, chosen, np.empty(len(chosen)))
        return chosen

    def controls(self, heading: Array, curvature: Array) -> Array:
        """Velocity along the heading; straight lines have no curvature."""
        return self.pace * np.column_stack([np.cos(heading), np.sin(heading)])

    def roots(self, goal: Array) -> Array:
        """The goal point itself."""
        return goal[None, :].astype(float)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Uniform in the workspace."""
        return np.asarray(scene.lower + (scene.upper - scene.lower) * rng.random(2))


def running_cost(problem: Problem, x: Array, trajectory: Trajectory) -> float:
    """Integral of q + u'Ru/2 along a trajectory from x (n,)."""
    R = problem.control_cost(x)
    effort = 0.5 * np.einsum("lm,mk,lk->l", trajectory.controls, R, trajectory.controls)
    rate = problem.rate(x)
    if callable(problem.q):
        tail = x[2:]
        rate = float(np.mean([problem.rate(np.concatenate([p, tail])) for p in trajectory.points]))
    return float(np.sum((rate + effort) * trajectory.durations))


@kernel
def _resample(controls, durations, times, out):  # type: ignore[no-untyped-def]
    steps, m = out.shape
    now, i = 0.0, 0
    for p in range(durations.shape[0]):
        end = now + durations[p]
        while i < steps:
            overlap = min(end, times[i + 1]) - max(now, times[i])
            if overlap > 0.0:
                for j in range(m):
                    out[i, j] += controls[p, j] * overlap / (times[i + 1] - times[i])
            if times[i + 1] > end:
                break
            i += 1
        now = end
