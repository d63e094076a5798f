"""What lies around a state as a tree sees it: the vertices near it, and the edges between them that are free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.jit.threads import mapped
from pirrht.planner.extend import Vertices, near_count
from pirrht.steering.edges import EdgeChecker, Edges, joined
from pirrht.steering.steering import Steering

SHARED = 200  # edges that are worth more than one thread


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Neighbourhood:
    """Near states and edges by one steering in one scene; vertices (V, n) are those that count."""

    space: FreeSpace
    steering: Steering
    checker: EdgeChecker
    homology: Any  # `Homology`, or what a steering has in its place

    @classmethod
    def of(cls, space: FreeSpace, steering: Steering) -> Neighbourhood:
        """Edges of a steering among what stands and moves in a space."""
        checker, homology = EdgeChecker.of(space, steering), steering.homology(space)
        return cls(space=space, steering=steering, checker=checker, homology=homology)

    def straight(self, x: Array) -> Array:
        """H of the straight line from x (n,) to the goal point, (M,)."""
        straight: Array = self.homology.base(x)
        return straight

    def edges_from(self, x: Array, vertices: Vertices, least: int = 0, threads: int = 1) -> Edges:
        """Edges from x (n,) to the vertices near it, at least so many."""
        near = self._near(x, vertices.states, forward=True, least=least)

        def edges(near: NDArray[np.int64]) -> Edges:
            motions = self.steering.connect(_repeated(x, len(near)), vertices.states[near])
            return self.checker.inspect(motions, vertices.in_goal[near], near)

        if threads == 1 or len(near) < SHARED:
            return edges(near)
        return joined(mapped(edges, np.array_split(near, 2 * threads), threads))

    def edges_to(self, vertices: Vertices) -> Edges:
        """Rewire, lines 1-7: edges from the vertices near the last of them, itself included, to it."""
        v = len(vertices.states) - 1
        x, in_goal = vertices.states[v], vertices.in_goal
        near = self._near(x, vertices.states, forward=False)
        near = near[(near != v) & ~in_goal[near]]
        motions = self.steering.connect(vertices.states[near], _repeated(x, len(near)))
        return self.checker.inspect(motions, np.full(len(near), in_goal[v]), near)

    def _near(self, x: Array, states: Array, *, forward: bool, least: int = 0) -> NDArray[np.int64]:
        """NearForward and NearBackward among the states, at least so many."""
        count = max(near_count(len(states), self.steering.n), least)
        return self.steering.nearest(states, x, count, forward=forward)


def _repeated(x: Array, count: int) -> Array:
    here = np.empty((count, len(x)))
    here[:] = x
    return here
