"""Paths of a steering method that nobody has written a shortening for: taut by its own connections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from discs import scattered

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Scene
from pirrht.shortening.chain import cheapest_chain
from pirrht.steering.dubins import Dubins
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import StraightLine
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference


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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_curves_of_a_foreign_steering_are_pulled_taut_by_its_own_connections(seed: int):
    """Free, of the same class, never longer, and hardly longer than what is made for Dubins curves."""
    space = FreeSpace.of(scattered(seed))
    car = Dubins(rho=0.4)
    tree = grown(space, Foreign(car), 250)
    x = space.scene.start[:3]
    rough, fine = tree.references(x, polished=False), by_class(tree.references(x))
    special = grown(space, car, 250).references(x)
    assert len(rough) >= 2
    for before in rough:
        after = fine[before.winding]
        points = after.trajectory.points
        assert after.length <= before.length * (1 + 1e-9)
        assert space.collision.clearance(points).min() > -1e-3
        assert space.homology.winding(points) == before.winding
    lengths = {reference.winding: reference.length for reference in special}
    ratios = [fine[w].length / lengths[w] for w in fine.keys() & lengths.keys()]
    assert np.median(ratios) < 1.02
    assert max(ratios) < 1.1


@pytest.mark.slow
def test_a_chain_around_a_corner_is_hardly_longer_than_the_taut_line():
    space = FreeSpace.of(scattered(4))
    tree = grown(space, StraightLine(), 200)
    for rough in tree.references(space.scene.start[:2], polished=False):
        chained = cheapest_chain(rough.path, StraightLine(), space)
        taut = by_class(tree.references(space.scene.start[:2]))[rough.winding]
        assert float(chained.cost.sum()) <= float(rough.path.cost.sum())
        assert float(chained.cost.sum()) == pytest.approx(taut.cost, rel=0.012)
