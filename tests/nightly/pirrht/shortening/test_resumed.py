"""Paths that go on from earlier ones: of arcs, and lines that guides track."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scattered

from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.shortening.shorten import REACH, resumed_along_arcs
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.rover import RoverSteering
from pirrht.steering.steering import Steering
from pirrht.steering.tracked import Tracked
from pirrht.systems.rover import Rover
from pirrht.systems.second_order_car import SecondOrderCar


def rover(seed: int) -> HomologyTree:
    problem = Problem(dynamics=Rover(), scene=scattered(seed), R=np.diag([2.0, 0.5]))
    return grown(problem, RoverSteering.of(problem), seed)


def grown(problem: Problem, steering: Steering, seed: int) -> HomologyTree:
    space = FreeSpace.of(problem.scene)
    tree = HomologyTree(space, steering, limit=0.9, rng=np.random.default_rng(seed))
    tree.grow(300)
    return tree


def lines(seed: int) -> HomologyTree:
    problem = Problem(dynamics=SecondOrderCar(), scene=scattered(seed), R=np.diag([2.0, 2.0]))
    return grown(problem, Tracked.of(problem, pace=1.0), seed)


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("made", [rover, lines])
def test_paths_go_on_from_earlier_ones_in_their_class_and_hardly_dearer(made, seed):
    """20 small moves of seed 1: against paths that are shortened anew at most 5 % dearer, and free as FCL sees it."""
    tree, rng, compared = made(seed), np.random.default_rng(1), 0
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


def test_a_path_that_is_out_of_reach_or_all_but_over_is_not_resumed():
    tree = rover(0)
    start = np.array(tree.space.scene.start, dtype=float)
    path, checker = tree.references(start)[0].path, EdgeChecker.of(tree.space, tree.steering)
    assert isinstance(tree.steering, RoverSteering)
    assert resumed_along_arcs(start, path, tree.steering, checker) is not None
    beside = np.array([*tree.space.scene.obstacles[0].position[:2], 0.0])
    assert resumed_along_arcs(beside, path, tree.steering, checker) is None
    x, y = tree.space.scene.goal.center
    near = tree.references(np.array([x - tree.space.world.radius - 0.3, y, 0.0]))
    short = [found.path for found in near if found.path.length.sum() < REACH]
    assert short
    assert all(resumed_along_arcs(start, path, tree.steering, checker) is None for path in short)
