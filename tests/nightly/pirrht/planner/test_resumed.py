"""Paths that go on from earlier ones: lines that proposals track."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scattered

from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.steering import Steering
from pirrht.steering.straight_line import Tracked
from pirrht.systems.second_order_car import SecondOrderCar


def grown(problem: Problem, steering: Steering, seed: int) -> HomologyTree:
    space = FreeSpace.of(problem.scene)
    tree = HomologyTree(space, steering, limit=0.9, rng=np.random.default_rng(seed))
    tree.grow(300)
    return tree


def lines(seed: int) -> HomologyTree:
    problem = Problem(dynamics=SecondOrderCar(), scene=scattered(seed), R=np.diag([2.0, 2.0]))
    return grown(problem, Tracked.of(problem, pace=1.0), seed)


@pytest.mark.parametrize("seed", [0, 3])
def test_paths_go_on_from_earlier_ones_in_their_class_and_hardly_dearer(seed):
    """20 small moves of seed 1: against paths that are shortened anew at most 5 % dearer, and free as FCL sees it."""
    tree, rng, compared = lines(seed), np.random.default_rng(1), 0
    start = np.array(tree.space.scene.start, dtype=float)[: tree.steering.n]
    known = {found.winding: found for found in tree.references(start)}
    paths = {winding: found.path for winding, found in known.items()}
    for _ in range(20):
        moved = start + rng.normal(scale=[0.03, 0.03, 0.05][: len(start)])
        anew = {found.winding: found.cost for found in tree.references(moved)}
        again = {found.winding: found for found in tree.references(moved, before=paths)}
        assert set(again) == set(anew)
        for winding, found in again.items():
            points = found.trajectory.points
            assert found.cost <= 1.05 * anew[winding]
            assert tree.space.collision.clearance(points).min() > -1e-3
            assert tree.homology.winding(points) == winding
            np.testing.assert_array_equal(found.path.tails[0], moved)
            np.testing.assert_allclose(found.path.tails[1:], found.path.heads[:-1], atol=1e-9)
            compared += winding in paths and found.cost != anew[winding]
    assert compared >= 10
