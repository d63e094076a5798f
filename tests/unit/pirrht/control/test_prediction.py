"""Drives among bodies that move: what is known or foretold of them, and that classes keep their names."""

import numpy as np
import pytest
from discs import disc
from moving import SCENES, hall, moved
from trees import point

from pirrht import FreeSpace, HomologyTree, Scene
from pirrht.control.prediction import ConstantVelocity, straight_on
from pirrht.steering.in_time import InTime

START = np.array([1.0, 2.5])


TURNING = [(0.0, 3.2, 0.6, 0.0), (1.0, 3.2, 1.4, 0.0), (2.0, 4.4, 1.4, 0.0), (3.0, 4.4, 1.4, 0.0)]


def walk() -> Scene:
    return hall("turning", [moved("walker", TURNING, disc("disc", 0.0, 0.0, 0.3))])


def by_velocity(space: FreeSpace) -> ConstantVelocity:
    def rooted(space: FreeSpace) -> HomologyTree:
        return HomologyTree(space, InTime(), limit=0.8, rng=np.random.default_rng(0))

    return ConstantVelocity(space, InTime(), rooted, vertices=200)


def test_a_body_that_is_foretold_goes_straight_on_from_where_it_is():
    (mover,) = walk().movers
    on = straight_on(mover, 0.5, 10.0)
    for t in (0.0, 0.4, 3.0):
        assert on.motion.pose(t) == pytest.approx(mover.motion.pose(0.5) + t * np.array([0.0, 0.8, 0.0]))


def test_nothing_is_foretold_anew_before_a_body_moves_otherwise():
    prediction = by_velocity(FreeSpace.of(walk()))
    first = prediction.at(START, 0.0)
    assert prediction.at(START, 0.9) is first
    second = prediction.at(START, 1.1)
    assert second is not first
    assert second.since == 1.1
    assert second.tree is not None
    assert second.tree.size == 200
    assert second.tree.passages is first.tree.passages  # of static obstacles
    assert prediction.at(START, 1.9) is second
    prediction.begin()
    assert prediction.at(START, 0.0) is not second


def test_a_walker_that_goes_straight_on_is_foretold_exactly():
    """Before its rows end, knowing and seeing are the same; the values of plans from the same place agree."""
    scene, plans = SCENES["crossing"](), []
    for options in ({}, {"predict": by_velocity(FreeSpace.of(scene))}):
        one = point(scene, 0.2, 400, options=options, samples=400, threads=1)
        plans.append([one.plan(START) for _ in range(2)][1])
    assert plans[0].ids[:2] == plans[1].ids[:2]
    values = [plan.estimate.value for plan in plans if plan.estimate is not None]
    assert values[0] == pytest.approx(values[1], abs=0.05)


def test_a_class_keeps_its_name_when_something_else_is_foretold():
    """The walker turns at 1 s; what the robot follows is called as before, and the drive goes on in that class."""
    options = {"predict": by_velocity(FreeSpace.of(walk()))}
    one, x, favourites = point(walk(), 0.1, 300, rng=3, options=options, samples=200, threads=1), START.copy(), []
    one.begin(x)
    for _ in range(14):
        plan = one.plan(x)
        favourites.append(plan.favourite)
        x = x + 0.1 * plan.control
        one.observe(x[None], 0.1)
    assert one.run.route.since > 1.0
    assert favourites[9] in plan.ids
    assert len(set(favourites[8:])) == 1
