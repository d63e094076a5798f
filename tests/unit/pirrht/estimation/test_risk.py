"""The predicted probability of a collision against closed forms, the exact law and the envelope theorem."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pirrht.control.controller import Controller
from pirrht.estimation.risk import collision_probability, offset
from pirrht.jit.streams import exposure
from sim.scenario import prepare
from sim.scenario.risk import predicted

STEP = 0.002  # of the physics [s]


def chance_of_a_held_chain(margin: float, far: float = 20.0, points: int = 1500) -> float:
    """x P(x' = x + 1/x + N(0, 1) ever ends below -margin | x) for large x, by its linear equation."""
    x = -margin + (np.arange(points) + 0.5) * (far + margin) / points
    ahead, width = x + 1.0 / np.maximum(x, 0.45), x[1] - x[0]
    moves, ends = norm.pdf(x - ahead[:, None]) * width, norm.cdf(-margin - ahead)
    beyond = far + (np.arange(400) + 0.5) * width  # there it falls like 1/x
    moves[:, -1] += np.sum(norm.pdf(beyond - ahead[:, None]) * width * far / beyond, axis=1)
    return float(np.linalg.solve(np.eye(points) - moves, ends)[-1] * x[-1])


@pytest.mark.parametrize("margin", [0.0, 0.5, 1.0])
def test_the_offset_is_the_chance_that_a_held_chain_beside_a_wall_collides_to_a_tenth(margin):
    assert offset(1.0, margin) == pytest.approx(chance_of_a_held_chain(margin), rel=0.1)


def test_exposure_is_the_chance_of_a_bridge_to_come_near_a_wall_that_it_misses():
    c, d, b, span, near = 0.02, 0.03, 0.2, 0.01, 1e-5

    def missed(shift: float) -> float:
        return 1.0 - math.exp(-2.0 * (c - shift) * (d - shift) / (b * b * span))

    assert exposure(*(np.float32(v) for v in (c, d, b, span))) * near / b == pytest.approx(
        1.0 - missed(near) / missed(0.0), rel=2e-3
    )


@pytest.mark.parametrize(
    ("noise", "margin"), [(0.2, 0.004), *(pytest.param(b, 0.0, marks=pytest.mark.slow) for b in (0.1, 0.2))]
)
def test_the_predicted_probability_is_that_of_the_exact_law_held_for_a_physics_step(noise, margin):
    scenario = prepare("slit", margin=margin, noise=noise, samples=500)
    found = predicted(scenario)
    exact, error = scenario.truth().collision_probability(scenario.start, 3000, step=STEP, margin=margin)
    assert found.probability == pytest.approx(exact, rel=0.15, abs=3.0 * math.hypot(error, found.error))
    assert found.accepted == found.accepted_most == 0.0


@pytest.mark.parametrize("lambdas", [0.0, 2.0])
def test_a_finite_final_cost_accepts_no_more_than_its_bound(lambdas):
    free = prepare("slit", noise=0.5, margin=0.0)
    value = free.truth().value(free.start)
    scenario = free.with_settings(phi=value + lambdas * free.problem.temperature)
    accepted = 1.0 - math.exp((scenario.truth().value(scenario.start) - value) / free.problem.temperature)
    found = predicted(scenario)
    assert 0.0 < accepted <= found.accepted_most
    assert found.accepted_most == pytest.approx(math.exp(-lambdas), rel=0.1)


def test_a_risk_raises_a_final_cost_below_the_cost_to_go():
    assert predicted(prepare("slit", phi=5.0)).probability > 0.99
    scenario = prepare("slit", phi=5.0, risk=0.01)
    assert 8.4 < scenario.problem.phi < 9.0
    assert predicted(scenario).most <= 0.005


@pytest.mark.parametrize("robot", ["unicycle", pytest.param("hover", marks=pytest.mark.slow)])
def test_a_held_control_adds_nothing_where_noise_acts_on_derivatives_of_the_position(robot):
    assert predicted(prepare("slit", robot=robot)).most < 1e-6


def test_a_finite_final_cost_accepts_the_weight_of_the_samples_that_end_in_a_wall(slit, slit_tree):
    problem = replace(slit.problem, phi=7.0)
    settings = replace(slit.sampling, samples=2000, guide="open-loop")
    plan = Controller(problem, slit.space, slit_tree, settings, rng=np.random.default_rng(2)).plan(slit.start)
    found = collision_probability(problem, plan.estimate, step=STEP, classes=plan.classes)
    (part,) = plan.estimate.parts
    weight = np.exp(part.log_weight - part.log_weight.max())
    assert 0.0 < found.accepted == pytest.approx(weight[part.paths.outcome == 2].sum() / weight.sum())
    assert found.accepted < found.probability <= found.most
    assert set(found.classes) == set(plan.classes.values())
    certain = collision_probability(problem, plan.estimate, step=1e9)
    assert certain.probability == 1.0
    assert np.isfinite(certain.error)


def test_a_control_that_is_held_for_a_period_collides_more_often_than_one_held_for_a_physics_step():
    often, seldom = (predicted(prepare("slit", margin=0.0, between=rule)) for rule in ("hold", "classes"))
    assert often.probability > 1.5 * seldom.probability > 0.0
