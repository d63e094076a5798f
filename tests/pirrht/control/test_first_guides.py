"""First guides of a drive: whoever may reverse as cheaply as drive ahead is worth as much facing the other way."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pirrht.control.controller import Controller
from pirrht.guidance.any_guides import AnyGuidance
from pirrht.guidance.tracking import FEW
from sim.scenario import prepare

STATES = {"rover": (4.6, 4.0, 1.4), "car": (4.9, 3.4, 0.4, 0.0)}  # the goal is at (5.5, 2.5)
AWAY = {"rover": (4.4, 2.6, 3.0), "car": (4.5, 2.5, -2.8, 0.0)}


@cache
def planner(robot: str, scene: str = "slit", **given) -> Controller:
    """A controller in `slit`, two threads, seed 0."""
    scenario = prepare(scene, robot=robot, given={"vertices": 500, "samples": 400, "threads": 2, **given})
    controller = scenario.controller(scenario.grown_tree())
    assert isinstance(controller, Controller)
    return controller


def told(robot: str, x) -> tuple[float, float]:
    """v and its standard error at a state, by a first plan."""
    controller = planner(robot)
    controller.begin(np.array(x))
    estimate = controller.plan(np.array(x)).estimate
    assert estimate is not None
    assert estimate.ess > 20.0
    return estimate.value, estimate.value_error


def turned(x) -> np.ndarray:
    return np.array([*x[:2], x[2] + np.pi, *(-v for v in x[3:])])


@pytest.mark.parametrize("robot", ["rover", "car"])
@pytest.mark.parametrize("at", [STATES, AWAY], ids=["aside", "away"])
def test_v_is_the_same_facing_the_other_way(robot, at):
    """R, q and noise know no sign of the speed; within 3.5 standard errors and 0.2 % of two plans of 400 samples."""
    (one, first), (other, second) = (told(robot, x) for x in (at[robot], turned(at[robot])))
    assert abs(one - other) < 3.5 * np.hypot(first, second) + 0.002 * one


@pytest.mark.parametrize("robot", ["rover", "car"])
def test_a_goal_close_behind_is_worth_no_more_than_reversing_straight_there(robot):
    """At twice the time that the way of 0.8 m takes at 1 m/s, and what setting off costs a car at rest."""
    x = np.array([4.4, 2.5, np.pi, 0.0][: len(STATES[robot])])
    value, _ = told(robot, x)
    assert value < 2.0 * 0.8 + (1.2 if robot == "car" else 0.1)


@pytest.mark.parametrize("robot", ["rover", "car"])
def test_a_first_guide_is_never_dearer_than_the_one_that_follows_the_reference(robot):
    controller = planner(robot)
    guidance = controller.path_integral.guidance
    assert isinstance(guidance, AnyGuidance)
    cheaper = 0
    for x in (STATES[robot], AWAY[robot], turned(STATES[robot]), turned(AWAY[robot])):
        state = np.array(x)
        controller.begin(state)
        reference = controller._references(state)[0]
        times = controller.path_integral.grid(controller._least_cost(state, [reference.trajectory]))
        key = controller.homology.key(reference.winding)
        usual = guidance.improve(state, times, key, reference.trajectory)
        first = guidance.first(state, times, key, reference.trajectory)
        assert first is not None
        assert first.valid
        if usual is not None and usual.valid:
            assert first.priced <= usual.priced
            cheaper += first.priced < 0.95 * usual.priced
    assert cheaper > 0 or robot == "car"  # whose homing, which reverses, sees to these


def test_samples_of_a_rover_go_where_earlier_ones_weighed():
    """Ten plans at one state of `slit`, b = 0.1: as many in all, most of them for the class that has the weight."""
    controller = planner("rover")
    x, N = np.array([1.0, 2.5, 0.0]), controller.path_integral.sampling.samples
    controller.begin(x)
    equal = controller.batch(x, controller._references(x))
    worth = [one.count for one in equal.proposals if one.count > FEW]
    assert len(worth) > 1
    assert worth == [N] * len(worth)
    controller.begin(x)
    for _ in range(10):
        plan = controller.plan(x)
    shared = controller.batch(x, controller._references(x))
    counts = {one.name: one.count for one in shared.proposals}
    assert sum(count for count in counts.values() if count > FEW) == N * sum(count > FEW for count in counts.values())
    assert max(counts, key=counts.__getitem__) == plan.favourite
    assert counts[plan.favourite] > 1.5 * N


def test_equal_samples_stay_equal():
    controller = planner("rover", allocation="equal")
    x = np.array([1.0, 2.5, 0.0])
    controller.begin(x)
    for _ in range(3):
        counts = controller.plan(x).estimate.rollouts.leads.first
    assert set(np.diff(counts)) <= {FEW, controller.path_integral.sampling.samples}
