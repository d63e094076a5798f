"""What steering methods of poses share: how vertices (x, y, heading) are drawn, offered and rooted."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import TWO_PI
from pirrht.geometry.scene import Scene
from pirrht.steering.steering import Steering

ROOTS = 16  # headings at the goal point


class PoseSteering(Steering):
    """A steering method whose vertices are poses x, y [m] and heading [rad], (3,)."""

    n = 3
    symmetric = False

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A state (3,), uniform in the workspace [m] and in heading [rad]."""
        return np.append(rng.uniform(scene.lower, scene.upper), rng.uniform(-np.pi, np.pi))

    def states_along(self, way: Array, scene: Scene) -> Array:
        """Every pose (k, 3) and its reverse, (2 k, 3), headings in [-pi, pi)."""
        states = np.repeat(way, 2, axis=0)
        states[1::2, 2] += np.pi
        states[:, 2] -= TWO_PI * np.floor((states[:, 2] + np.pi) / TWO_PI)
        return states

    def roots(self, goal: Array) -> Array:
        """Evenly spread headings at the goal point (2,) [m]: states (16, 3)."""
        headings = np.arange(ROOTS) * (TWO_PI / ROOTS) - np.pi
        return np.column_stack([np.broadcast_to(goal, (ROOTS, 2)), headings])


def rows(states: Array) -> Array:
    """Poses as contiguous rows (k, 3), as kernels read them."""
    return np.ascontiguousarray(states, dtype=float).reshape(-1, 3)
