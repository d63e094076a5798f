"""Controls near walls, held for a step."""

import numpy as np
import pytest

from pirrht.control.held import THROW
from pirrht.control.plan import Plan
from sim.scenario import prepare

STEP, NOISE = 0.002, 0.1


@pytest.fixture(scope="module")
def planned():
    scenario = prepare("slit", margin=0.01, given={"noise": NOISE})
    controller = scenario.controller(scenario.grown_tree())
    controller.begin(x := np.array([2.0, 2.5]))
    return scenario, controller, x


def wall_below(scenario, x: float) -> float:
    """The least y at which plans may be, under the slit's upper lip [m]."""
    low, high = 2.5, 2.8
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if scenario.space.world.clearance((x, middle)) > 0.0 else (low, middle)
    return low


def test_a_held_control_throws_no_farther_off_a_wall_than_some_deviations(planned):
    scenario, controller, _ = planned
    top = wall_below(scenario, 3.0)
    for off in (1e-3, 3e-4, 1e-5):
        controller.begin(x := np.array([3.0, top - off]))
        plan: Plan = controller.plan(x)
        assert plan.fallback is None
        assert -STEP * plan.at(x, 0.0)[1] <= THROW * NOISE * np.sqrt(STEP) + 1e-9


@pytest.mark.slow
def test_the_exact_law_throws_no_farther_off_a_wall_either_and_turns_back_within_the_margin(planned):
    scenario, top = planned[0], wall_below(planned[0], 3.0)
    optimal = scenario.optimal()
    for off in (1e-4, -0.004):
        optimal.begin(x := np.array([3.0, top - off]))
        assert 1.5 < (-STEP * optimal.plan(x).at(x, 0.0)[1]) / (NOISE * np.sqrt(STEP)) <= THROW + 1e-9


def test_a_plan_that_noise_has_carried_into_the_margin_begins_where_that_ends(planned):
    scenario, controller, _ = planned
    controller.begin(x := np.array([3.0, wall_below(scenario, 3.0) + 0.005]))
    plan = controller.plan(x)
    assert plan.fallback is None
    assert 0.005 <= np.hypot(*(plan.state - x)) < 0.015
    assert scenario.space.world.clearance(tuple(plan.state)) > 0.0
    assert plan.at(x, 0.0)[1] < 0.0


def test_among_moving_obstacles_a_held_control_is_that_of_the_walls_where_its_step_ends():
    scenario = prepare("closing_door", given={"noise": NOISE})
    controller = scenario.controller(scenario.grown_tree())
    controller.begin(x := np.array([3.1, 2.6]), 0.9)
    plan = controller.plan(x)
    below = [scenario.space.world.clearance(tuple(x), 0.9 + s) for s in (0.0, STEP)]
    assert below[1] < below[0] - 5e-4  # the door comes nearer
    np.testing.assert_allclose(plan.at(x, 0.0), plan.law.law(x, STEP), atol=0.02)
    assert plan.at(x, 0.0)[1] > plan.law.law(x, 0.0)[1] + 0.01


def test_off_an_obstacle_that_recedes_a_held_control_turns_as_off_one_that_stands():
    scenario, t, x = prepare("crossing", noise=NOISE, margin=0.0), 1.0, np.array([3.052, 1.304])
    controller = scenario.controller(scenario.grown_tree())
    (c, *away, _, vx, vy), *_ = scenario.space.world.moving.walls(tuple(x), t, 0.05)
    receding = -np.dot(away, (vx, vy))
    assert receding > 0.4
    controller.begin(x, t)
    plan = controller.plan(x)
    nearer = x - 0.8 * c * np.array(away)
    held, carried = (away @ u + receding for u in (plan.at(nearer, 0.0), plan.law.law(nearer, STEP)))
    turning = NOISE**2 / (0.2 * c + receding * STEP)  # the exact control does so to a tenth
    assert carried < 0.87 * turning  # what is optimal farther off points at the obstacle
    assert held == pytest.approx(turning, rel=0.1)
