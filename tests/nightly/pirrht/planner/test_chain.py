"""Any system's paths: taut by a foreign steering's own connections, and going on from earlier ones."""

from __future__ import annotations

import numpy as np
import pytest
from discs import scattered
from trees import grown
from unit.pirrht.planner.test_taut import Foreign, by_class

from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.dubins import Dubins
from pirrht.steering.straight_line import Tracked
from pirrht.systems.second_order_car import SecondOrderCar


@pytest.mark.parametrize("seed", range(3))
def test_curves_of_a_foreign_steering_are_pulled_taut_by_its_own_connections(seed: int):
    """Free, of the same class, never longer, and hardly longer than what is made for Dubins curves."""
    space = FreeSpace.of(scattered(seed))
    car = Dubins(rho=0.4)
    tree = grown(space, Foreign(car), 250)
    x = space.scene.start[:3]
    rough, fine = tree.references(x, shortened=False), by_class(tree.references(x))
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
    assert max(ratios) < 1.15


# -- going on ------------------------------------------------------------------------------------------------------


def lines(seed: int) -> HomologyTree:
    problem = Problem(dynamics=SecondOrderCar(), scene=scattered(seed), R=np.diag([2.0, 2.0]))
    return grown(FreeSpace.of(problem.scene), Tracked.of(problem, pace=1.0), 300, seed=seed, limit=0.9)


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
