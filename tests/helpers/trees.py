"""Trees that tests ask, grown to a number of vertices, and controllers of a point with one."""

from typing import Any

import numpy as np

from pirrht import (
    Controller,
    FreeSpace,
    HomologyTree,
    Problem,
    Sampling,
    Scene,
    SingleIntegrator,
    Steering,
    StraightLine,
)
from pirrht.steering.in_time import InTime


def grown(
    space: FreeSpace, steering: Steering, vertices: int, *, seed: int = 0, limit: float = 0.8, **options: Any
) -> HomologyTree:
    """A tree of a seed."""
    tree = HomologyTree(space, steering, limit=limit, rng=np.random.default_rng(seed), **options)
    tree.grow(vertices)
    return tree


def point(
    scene: Scene, b: float, vertices: int, *, seed: int = 0, limit: float = 0.8, rng: int = 1,
    options: dict[str, Any] | None = None, **sampling: Any,
) -> Controller:  # fmt: skip
    """The controller of a point, R = 2, in space and time if obstacles move; seeds of its tree and of its samples."""
    problem, space = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2)), FreeSpace.of(scene)
    tree = grown(space, InTime() if scene.movers else StraightLine.of(problem), vertices, seed=seed, limit=limit)
    return Controller(problem, space, tree, Sampling(**sampling), rng=np.random.default_rng(rng), **options or {})
