"""Pure pursuit steers along circles to a point of the path ahead; without samples, and within what is free."""

import numpy as np
import pytest
from thoroughly import first

from pirrht import DoubleIntegrator, OptionError, Problem, Rover, SingleIntegrator, Unicycle
from pirrht.control.pursuit import PursuitLaw
from sim.scenario import Scenario

LINE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])


def law_of(slit: Scenario, dynamics, R, distance: float = 0.5) -> PursuitLaw:
    return PursuitLaw.of(Problem(dynamics=dynamics, scene=slit.problem.scene, R=R), LINE, distance)


@pytest.mark.parametrize(
    ("place", "aim"),
    [((0.0, 0.0), (0.5, 0.0)), ((1.0, 0.3), (1.4, 0.0)), ((1.8, 0.0), (2.0, 0.46)), ((2.0, 1.8), (2.0, 2.0)),
     ((1.0, 3.0), (2.0, 2.0))],
)  # fmt: skip
def test_it_aims_at_the_first_point_far_enough_behind_the_nearest_or_at_the_end(slit, place, aim):
    law = law_of(slit, SingleIntegrator(b=0.1), 2.0 * np.eye(2))
    np.testing.assert_allclose(law.aim(np.array(place)), aim, atol=0.051)


def test_controls_are_those_of_the_circle_at_the_best_speed(slit):
    rover = law_of(slit, Rover(b=0.1), np.diag([2.0, 0.5]))
    assert rover.speed == pytest.approx(1.0)
    aim = rover.aim(np.array([0.0, 0.1]))
    alpha = np.arctan2(aim[1] - 0.1, aim[0]) - 0.3
    curvature = 2.0 * np.sin(alpha) / np.hypot(aim[0], aim[1] - 0.1)
    np.testing.assert_allclose(rover(np.array([0.0, 0.1, 0.3]), 0.0), [1.0, curvature])
    car = law_of(slit, Unicycle(V=2.0, rho=0.5, b=0.1), np.eye(1))
    np.testing.assert_allclose(car(np.array([0.0, 0.1, 0.3]), 0.0), [2.0 * curvature * 0.5])  # turns at u / rho
    puck = law_of(slit, SingleIntegrator(b=0.1), 2.0 * np.eye(2))
    np.testing.assert_allclose(puck(np.array([0.0, 0.1]), 0.0), (aim - [0.0, 0.1]) / np.hypot(aim[0], aim[1] - 0.1))


@pytest.mark.parametrize(("heading", "sign"), [(3.0, -1.0), (-3.0, 1.0)])
def test_a_robot_turns_on_the_spot_to_what_lies_behind(slit, heading, sign):
    u = law_of(slit, Rover(b=0.1), np.diag([2.0, 0.5]))(np.array([0.0, 0.0, heading]), 0.0)
    assert u[0] == pytest.approx(0.0)
    assert sign * u[1] == pytest.approx(2.0 / 0.5, rel=0.05)


def test_what_has_more_than_a_pose_is_refused(slit):
    with pytest.raises(OptionError, match=r"whose state is a pose, and DoubleIntegrator has .*vx"):
        law_of(slit, DoubleIntegrator(b=0.1), 2.0 * np.eye(2))


@pytest.mark.parametrize("seed", first(range(3)))
def test_it_follows_the_cheapest_reference_to_the_goal_without_samples(slit, slit_tree, seed: int):
    scenario = slit.with_settings(method="pursuit", noise=0.05, seed=seed)
    frames = list(scenario.drive(scenario.plant(), scenario.driver(slit_tree)))
    assert frames[-1].metrics.outcome == "goal"
    plan = frames[0].plan
    assert (plan.estimate, plan.fallback, plan.favourite) == (None, None, plan.ids[0])
    assert plan.references[0].cost == min(one.cost for one in scenario.references(slit_tree))
