"""Obstacle-blind optimal connections between two states (the paper's TPBVP) and the paths made of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.arcs import Curves
from pirrht.geometry.scene import Scene
from pirrht.steering.trajectory import Trajectory


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
