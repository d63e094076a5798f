"""What samples add to the control of the guide that they follow: used as far as it is known, and bought if too few."""

from functools import cache

import numpy as np
import pytest

from pirrht import Controller, PathIntegral
from pirrht.estimation.sampling import TUNING
from pirrht.estimation.weights import shrinkage
from pirrht.proposals.proposal import Batch
from sim.scenario import Scenario, prepare


@cache
def rover(samples: int) -> Scenario:
    """A rover on its way past the slit's wall."""
    return prepare("slit", robot="rover", noise=0.2, vertices=200, samples=samples, seed=1)


@cache
def batch() -> tuple[Controller, Batch]:
    """What a plan at the start samples."""
    controller = rover(200).controller(rover(200).grown_tree())
    return controller, controller.batch(rover(200).start, controller.tree.references(rover(200).start))


def test_a_correction_counts_fully_as_its_error_vanishes_and_not_at_all_within_it():
    np.testing.assert_array_equal(shrinkage(np.array([0.3, -0.5, 0.0]), np.full(3, 0.5)), 0.0)
    np.testing.assert_array_equal(shrinkage(np.array([-2.0, 1e-9]), np.zeros(2)), 1.0)
    errors = np.geomspace(1e-6, 0.9, 50)
    np.testing.assert_allclose(1.0 - shrinkage(np.full(50, -1.0), errors), errors**2, atol=1e-12)


def test_bias_and_error_of_a_shrunk_gaussian_mean_are_those_that_are_stated():
    z, truths = np.linspace(-9.0, 9.0, 4001), np.arange(0.0, 8.0, 0.1)
    density = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    means = truths[:, None] + z
    off = shrinkage(means, np.ones_like(means)) * means - truths[:, None]
    bias, square = off @ density, off**2 @ density
    assert square[0] == pytest.approx(1.0 / 3.0, abs=0.01)
    assert 1.4 < square.max() <= 1.5
    assert truths[square.argmax()] == pytest.approx(2.4, abs=0.15)
    assert np.all(bias <= 1e-9)  # towards zero
    assert bias.min() == pytest.approx(-0.5, abs=0.01)
    np.testing.assert_allclose(bias[60:], -1.0 / truths[60:], rtol=0.05)


@pytest.mark.parametrize("samples", [6, 60])
def test_controls_spread_by_no_more_than_their_laws_and_the_error_that_they_state(samples):
    controller, drawn = batch()
    drawn = drawn.counting([samples] * len(drawn.proposals))
    found = [controller.path_integral.sample(drawn, seed) for seed in range(60)]
    laws = [np.array(e.proposal_weights) @ e.rollouts.laws for e in found]
    controls, errors = np.array([e.control for e in found]), np.array([e.control_error for e in found])
    assert np.all(controls.std(axis=0) <= np.std(laws, axis=0) + np.sqrt(np.mean(errors**2, axis=0)))
    assert np.all(errors > 0.0)


def test_the_control_is_the_mean_of_samples_within_an_error_that_falls():
    controller, drawn = batch()
    errors = []
    for samples in (40, 4_000):
        e = controller.path_integral.sample(drawn.counting([samples] * len(drawn.proposals)), 5)
        mean = e.weight @ e.rollouts.paths.now / (e.weight @ e.rollouts.paths.span)
        off = np.abs(e.control - e.push - np.array(e.proposal_weights) @ e.rollouts.rise - mean)
        assert np.all(off <= e.control_error)
        errors.append(e.control_error)
    assert np.all(errors[1] < 0.6 * errors[0])


def test_weak_plans_draw_what_earlier_ones_have_saved_and_are_weighed_by_their_last_round(monkeypatch):
    """With four samples around each reference every plan is weak."""
    rounds, weighed, rollout = [[]], [], PathIntegral.rollout

    def counted(self, batch, seed):
        rounds[-1].append(sum(batch.counts))
        return rollout(self, batch, seed)

    weak = rover(4).with_settings(max_time=1.5)
    driver, plant = weak.driver(weak.grown_tree()), weak.plant()
    monkeypatch.setattr(PathIntegral, "rollout", counted)
    for frame in weak.drive(plant, driver):
        if frame.plan.estimate is not None:
            weighed.append((rounds[-1][-1], sum(part.size for part in frame.plan.estimate.parts)))
        rounds.append([])
    multiples = np.array([sum(some) / some[0] for some in rounds[1:-1]])
    assert multiples.max() > 1.0
    assert multiples.max() <= TUNING.later_plan
    assert multiples.mean() <= 1.0 + TUNING.saved
    assert all(last == size for last, size in weighed)


def test_the_last_step_before_the_goal_drives_into_it():
    """A rover whose reference is shorter than a step would otherwise halt on the rim until noise takes it in."""
    known = rover(200)
    goal = known.problem.scene.goal
    controller = known.controller(known.grown_tree())
    for away in (0.01, 0.04):
        x = np.array([goal.center[0] - goal.radius - away, goal.center[1], 0.1])
        controller.begin(x)
        plan = controller.plan(x)
        assert plan.control[0] > 0.5
        assert plan.estimate.ess > 20.0
