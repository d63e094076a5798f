"""Paths of a steering method that nobody has written a shortening for: taut by its own connections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from discs import scattered

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import StraightLine


class Foreign(Steering):
    """What a user writes: the methods that must be there, in NumPy, and none that are compiled."""

    def __init__(self, own: Any) -> None:
        self.own, self.n, self.speed, self.cost_per_meter = own, own.n, own.speed, own.cost_per_meter

    def distance(self, tails: Array, heads: Array) -> Array:
        return self.own.distance(tails, heads)

    def connect(self, tails: Array, heads: Array) -> Any:
        return self.own.connect(tails, heads)

    def controls(self, heading: Array, curvature: Array) -> Array:
        return self.own.controls(heading, curvature)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        return self.own.sample(scene, rng)

    def roots(self, goal: Array) -> Array:
        return self.own.roots(goal)


def grown(space: FreeSpace, steering: Steering, vertices: int) -> HomologyTree:
    tree = HomologyTree(space, steering, limit=0.8, rng=np.random.default_rng(0))
    tree.grow(vertices)
    return tree


def by_class(references: list[Reference]) -> dict[tuple[int, ...], Reference]:
    return {reference.winding: reference for reference in references}


@pytest.mark.parametrize("seed", range(3))
def test_straight_lines_of_a_foreign_steering_are_as_taut_as_our_own(seed: int):
    space = FreeSpace.of(scattered(seed))
    x = space.scene.start[:2]
    foreign, own = (grown(space, s, 150).references(x) for s in (Foreign(StraightLine()), StraightLine()))
    shared = by_class(foreign).keys() & by_class(own).keys()
    assert len(shared) >= 2
    for winding in shared:
        assert by_class(foreign)[winding].length == pytest.approx(by_class(own)[winding].length, rel=1e-3)
