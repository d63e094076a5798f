"""The controller names classes by the whole drive, and goes on when nothing new is known."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.control.plan import Plan
from pirrht.errors import NoReference
from pirrht.planner.tree import HomologyTree
from pirrht.steering.motion import running_cost
from pirrht.steering.straight_line import StraightLine
from sim.scenario import Scenario

HIDDEN = np.array([1.0, 3.4])  # from here the goal point is behind the upper wall


@pytest.fixture
def controller(slit: Scenario, slit_tree: HomologyTree) -> Controller:
    return slit.with_settings(samples=50).controller(slit_tree)


@pytest.fixture
def short_sighted(slit: Scenario) -> Controller:
    """Its tree is the goal alone, so that it has a reference only where the goal is in sight."""
    tree = HomologyTree(slit.space, StraightLine(), limit=0.6, rng=np.random.default_rng(0))
    return slit.with_settings(samples=50).controller(tree)


def along(points: Array, spacing: float) -> Array:
    """Points at equal distances on a polyline (k, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, lengths[-1], spacing)
    return np.column_stack([np.interp(at, lengths, points[:, k]) for k in (0, 1)])


# -- names -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["0,0", "-1,0", "0,1"])
def test_a_class_keeps_its_name_all_the_way(controller: Controller, slit: Scenario, name: str):
    first = controller.plan(slit.start)
    reference = first.references[first.ids.index(name)]
    controller.begin(slit.start)
    assert controller.driven_class() == (0, 0)
    states = along(reference.trajectory.points, 0.02)[1:]
    relative = set()
    for part in np.array_split(states, 12):
        controller.observe(part, 0.3)
        plan = controller.plan(part[-1])
        assert name in plan.ids
        assert len(set(plan.ids)) == len(plan.ids)
        relative.add(plan.references[plan.ids.index(name)].id)
        assert plan.estimate is not None
        assert plan.estimate.class_weights.keys() == {*plan.ids, "other"}
    assert ",".join(str(k) for k in controller.driven_class()) == name
    if name != "0,0":
        assert relative != {name}  # seen from where the robot is, the class has another name


def test_how_often_states_are_observed_does_not_matter(controller: Controller, slit: Scenario):
    path = along(np.array([[1.0, 2.5], [4.5, 2.5], [4.5, 3.5], [2.0, 3.5], [1.5, 2.6]]), 0.01)
    found = []
    for parts in (1, 7, 100):
        controller.begin(slit.start)
        for part in np.array_split(path, parts):
            controller.observe(part, 0.1)
        found.append(controller.driven_class())
    assert found[0] == found[1] == found[2] == (1, 0)


# -- plans -------------------------------------------------------------------------------------------------------


def test_equal_seeds_plan_alike(slit: Scenario, slit_tree: HomologyTree):
    one, other = (slit.with_settings(samples=50).controller(slit_tree) for _ in range(2))
    for _ in range(2):
        first, second = one.plan(slit.start), other.plan(slit.start)
        np.testing.assert_array_equal(first.control, second.control)
        np.testing.assert_array_equal(first.tape, second.tape)
    assert not np.array_equal(one.plan(slit.start).control, first.control)  # every plan draws anew


def test_methods_differ_in_the_references_they_sample_around(slit: Scenario, slit_tree: HomologyTree):
    plans = {
        method: slit.with_settings(method=method, samples=50).controller(slit_tree).plan(slit.start)
        for method in ("pi-rrht", "single")
    }
    assert plans["pi-rrht"].ids[0] == "0,0"
    assert set(plans["pi-rrht"].ids) == {"0,0", "-1,0", "0,1"}
    assert plans["single"].ids == ("0,0",)
    nobody = slit.with_settings(method="passive", samples=50).controller(None).plan(slit.start)
    assert nobody.references == ()
    assert nobody.fallback == "no survivor"  # noise alone does not find the goal
    assert np.all(nobody.control == 0.0)


def test_the_running_cost_of_a_straight_reference_is_twice_its_length(slit: Scenario, slit_tree: HomologyTree):
    for reference in slit_tree.references(slit.start):
        assert running_cost(slit.problem, slit.start, reference.trajectory) == pytest.approx(reference.cost)


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
def test_a_plan_is_its_control_now_and_its_tape_later(slit: Scenario, slit_tree: HomologyTree, guide: str):
    held = slit.with_settings(samples=200, guide=guide, between="hold")
    plan = held.controller(slit_tree).plan(slit.start)
    assert plan.times[0] == 0.0
    assert len(plan.times) == len(plan.tape) + 1
    np.testing.assert_array_equal(plan.at(plan.state, 0.0), plan.control)
    for i in (1, 5, 20, len(plan.tape) - 1):
        middle = 0.5 * (plan.times[i] + plan.times[i + 1])
        np.testing.assert_array_equal(plan.at(plan.state, middle), plan.tape[i])
        np.testing.assert_array_equal(plan.at(plan.state, plan.times[i]), plan.tape[i])
    assert np.all(plan.at(plan.state, plan.times[-1] + 1.0) == 0.0)
    assert plan.estimate is not None
    weights = plan.estimate.class_weights
    assert plan.favourite == max(weights, key=lambda name: weights[name]) == "0,0"


def test_a_held_open_loop_control_does_not_depend_on_the_state(slit: Scenario, slit_tree: HomologyTree):
    plan = slit.with_settings(samples=100, guide="open-loop", between="hold").controller(slit_tree).plan(slit.start)
    for x in ([1.0, 2.5], [3.4, 2.55], [0.1, 0.1]):
        np.testing.assert_array_equal(plan.at(np.array(x), 0.0), plan.control)


# -- fallbacks ---------------------------------------------------------------------------------------------------


def test_without_a_reference_at_the_start_there_is_no_plan(short_sighted: Controller):
    with pytest.raises(NoReference, match=r"from \(1, 3.4\)"):
        short_sighted.plan(HIDDEN)


def test_without_a_reference_the_robot_brakes_and_holds_its_position(short_sighted: Controller, slit: Scenario):
    assert short_sighted.plan(slit.start).fallback is None
    short_sighted.observe(HIDDEN[None], 0.25)
    plan = short_sighted.plan(HIDDEN)
    assert (plan.fallback, plan.stops, plan.estimate, plan.references, plan.favourite) == (
        "no reference", True, None, (), None,
    )  # fmt: skip
    np.testing.assert_array_equal(plan.at(HIDDEN, 0.3), np.zeros(2))
    off = np.array([0.02, -0.01])
    assert np.all(plan.at(HIDDEN + off, 0.3) * off < 0.0)  # back to where it was
    np.testing.assert_array_equal(plan.control, plan.at(HIDDEN, 0.0))


def hopeless(slit: Scenario, tree: HomologyTree) -> tuple[Controller, Plan]:
    """In the middle of the slit under much noise none of a few samples survives that holds its tape."""
    controller = slit.with_settings(samples=2, noise=6.0, guide="open-loop").controller(tree)
    x = np.array([3.4, 2.5])
    controller.begin(x)
    return controller, controller.plan(x)


def test_without_a_survivor_the_robot_brakes_and_goes_on_when_one_survives(slit: Scenario, slit_tree: HomologyTree):
    controller, plan = hopeless(slit, slit_tree)
    assert plan.fallback == "no survivor"
    assert plan.favourite == plan.ids[0] == "0,0"
    np.testing.assert_allclose(plan.control, [0.0, 0.0], atol=1e-9)
    controller.observe(np.array([[5.0, 2.5]]), 0.1)
    assert controller.plan(np.array([5.0, 2.5])).fallback is None  # close to the goal
