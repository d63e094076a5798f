"""Linear feedback between plans: its gain is the slope of the exact law."""

from __future__ import annotations

import json

import numpy as np
import pytest
from closed_forms import annulus, disc_entry, straight, within

from pirrht.control.gain import LinearLaw, bounded, curvature
from pirrht.estimation.sampler import PathIntegral, Sampling
from pirrht.exact.desirability import Desirability
from sim.cli import main
from sim.scenarios import Scenario, prepare

STEP = 0.01  # of differences of the exact law [m]


def gains(scenario: Scenario, tree, x, plans: int) -> list:
    """K of independent plans at one state."""
    controller = scenario.with_settings(between="gain").controller(tree)
    found = []
    for _ in range(plans):
        controller.begin(x)
        law = controller.plan(x).law
        assert isinstance(law, LinearLaw)
        found.append(law.gain)
    return found


def exact(scenario: Scenario, x):
    """Slope of the grid's control."""
    truth = Desirability.of(scenario.problem, scenario.space)
    steps = STEP * np.eye(2)
    return np.column_stack([(truth.control(x + h) - truth.control(x - h)) / (2.0 * STEP) for h in steps])


def test_around_a_disc_the_slope_is_that_of_the_bessel_functions():
    """24 estimates of 20000 samples each; standard error of their mean about 0.03 / s."""
    b, radius, r = 0.5, 0.3, 1.2
    problem, space = annulus(b, radius)
    x = np.array([r, 0.0])
    integral = PathIntegral(problem, space, Sampling(dt=0.1, samples=20000, guide="open-loop"))
    times = integral.grid(2.0 * (r - radius))
    tapes, _ = straight(x, [x * (radius / r)], times)
    found = [curvature(problem, [integral.rollout(x, times, tapes, seed)])[0] for seed in range(24)]
    speed = [disc_entry(problem, b, radius, at)[1] for at in (r - STEP, r, r + STEP)]
    radial, across = (speed[0] - speed[2]) / (2.0 * STEP), -speed[1] / r
    assert within([k[0, 0] for k in found], radial)
    assert within([k[1, 1] for k in found], across)
    assert within([k[0, 1] for k in found], 0.0)


def test_standard_errors_are_those_of_independent_estimates():
    problem, space = annulus(0.5)
    x = np.array([1.2, 0.0])
    integral = PathIntegral(problem, space, Sampling(dt=0.1, samples=1000))
    times = integral.grid(1.8)
    tapes, corners = straight(x, [np.zeros(2)], times)
    found = [curvature(problem, [integral.rollout(x, times, tapes, seed, corners=corners)]) for seed in range(100)]
    spread = np.std([slope for slope, _ in found], axis=0)
    np.testing.assert_allclose(np.mean([error for _, error in found], axis=0), spread, rtol=0.25)


@pytest.mark.parametrize("period", [0.01, 0.1])
def test_on_the_ridge_between_two_ways_the_control_turns_as_the_exact_one_does(slit, slit_tree, period):
    """Eight plans of 12000 samples; standard errors of one about 0.3 / s, of the mean 0.12, and 0.1 is shrunk away."""
    scenario, x = slit.with_settings(noise=0.3, samples=4000, period=period), np.array([1.0, 2.5])
    truth = exact(scenario, x)
    assert truth[1, 1] > 1.5  # it runs away from the ridge
    np.testing.assert_allclose(np.mean(gains(scenario, slit_tree, x, 8), axis=0), truth, atol=0.45)


def test_near_the_goal_it_is_that_of_a_point_attractor(slit, slit_tree):
    """One class, four plans; the law is averaged over 0.4 s on the way there, in which its slope grows by a tenth."""
    scenario, x = slit.with_settings(noise=0.2, samples=2000), np.array([5.0, 2.8])
    np.testing.assert_allclose(np.mean(gains(scenario, slit_tree, x, 4), axis=0), exact(scenario, x), atol=0.15)


def test_few_samples_leave_the_slope_of_the_guides(slit, slit_tree):
    """At b = 0.2 nine effective samples know it to 1 / s; what is used errs by less."""
    scenario, x = slit.with_settings(noise=0.2, samples=200), np.array([1.0, 2.5])
    off = np.array(gains(scenario, slit_tree, x, 24)) - exact(scenario, x)
    assert np.sqrt(np.mean(off**2)) < 0.5


def test_at_its_state_the_law_is_the_estimate_and_beside_it_linear(slit, slit_tree):
    plan = slit.with_settings(noise=0.2, between="gain").controller(slit_tree).plan(slit.start)
    assert plan.estimate is not None
    np.testing.assert_allclose(plan.at(slit.start, 0.0), plan.estimate.control, atol=1e-12)
    off = np.array([0.01, -0.02])  # no wall is near
    np.testing.assert_allclose(
        plan.at(slit.start + off, 0.005), plan.estimate.control + plan.law.gain @ off, atol=1e-12
    )
    assert plan.favourite == "0,0"


def test_no_gain_overshoots_within_a_step():
    rng = np.random.default_rng(0)
    for _ in range(50):
        G, gain = rng.normal(size=(2, 2)), 300.0 * rng.normal(size=(2, 2))
        held = bounded(gain, G, 100.0)
        assert np.abs(np.linalg.eigvals(G @ held)).max() <= 100.0 + 1e-9
        np.testing.assert_allclose(held / np.linalg.norm(held), gain / np.linalg.norm(gain))
    small = np.array([[-1.0, 0.2], [0.2, -3.0]])
    np.testing.assert_array_equal(bounded(small, np.eye(2), 100.0), small)


def test_a_car_has_the_slope_of_its_guides_in_position_and_of_its_samples_in_heading():
    scenario = prepare("clutter", given={"vertices": 300, "plan_seed": 0, "between": "gain"})
    controller = scenario.controller(scenario.grown_tree())
    plan = controller.plan(scenario.start)
    assert plan.estimate is not None
    assert plan.law.gain.shape == (1, 3)
    assert plan.law.gain[0, 2] < 0.0
    np.testing.assert_allclose(plan.at(scenario.start, 0.0), plan.estimate.control, atol=1e-12)
    ahead = scenario.start + 0.02 * scenario.problem.dynamics.f(scenario.start)
    np.testing.assert_allclose(plan.at(ahead, 0.02), plan.estimate.control, atol=1e-9)  # that is where it should be


@pytest.mark.parametrize("method", ["pi-rrht", "single"])
def test_a_drive_with_linear_feedback(tmp_path, capsys, method):
    out = tmp_path / "run.json"
    arguments = ["run", "slit", "--between", "gain", "--period", "0.1", "--vertices", "300", "--method", method]
    assert main([*arguments, "--json", str(out)]) == 0
    assert json.loads(out.read_text())["outcome"] == "goal"
    assert capsys.readouterr().out
