"""Estimates of a point against grid solutions, at the start of `slit` and elsewhere, and what they do not depend on."""

from dataclasses import replace

import numpy as np
import pytest
from batches import led, still
from scipy.stats import kstest
from solved import around_corner, around_post, error_of, in_channel, is_the_grids, shares

from pirrht import Estimate, Outcome, PathIntegral, Plan, Sampling, path_integral
from pirrht.topology.signature import class_id


def plan_at_start(scenario, tree, b: float, samples: int, **settings) -> Plan:
    changed = scenario.with_settings(noise=b, samples=samples, **settings)
    return changed.controller(tree).plan(changed.start)


def at_start(scenario, tree, b: float, samples: int, **settings) -> Estimate:
    return plan_at_start(scenario, tree, b, samples, **settings).estimate


@pytest.mark.parametrize(("b", "value", "share"), [(0.1, 8.443, 1.0), (0.2, 8.825, 0.98), (0.3, 9.535, 0.05)])
def test_value_and_share_of_the_slit_are_those_of_continuous_time(slit, slit_tree, b, value, share):
    estimate = at_start(slit, slit_tree, b, 40000)
    assert estimate.value == pytest.approx(value, rel=0.01)
    assert estimate.class_weights["0,0"] == pytest.approx(share, abs=0.05)
    assert sum(estimate.class_weights.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("b", "value", "share"), [(0.1, 8.484, 1.0), (0.2, 8.803, 0.986), (0.3, 9.452, 0.46)])
def test_exit_at_step_ends_takes_the_slit_too_often(slit, slit_tree, b, value, share):
    samples = 150000 if b == 0.3 else 30000  # standard error of the share at b = 0.3: 0.015
    estimate = at_start(slit, slit_tree, b, samples, dt=0.1, period=0.1, exit="endpoint", guide="open-loop")
    assert estimate.value == pytest.approx(value, rel=0.01)
    assert estimate.class_weights["0,0"] == pytest.approx(share, abs=0.06)


def test_the_plain_average_is_too_high_by_a_share_of_lambda_ln_3(slit, slit_tree):
    """Samples around one way hardly visit the other two (trap 4): at b = 0.1 all of lambda ln 3 shows."""
    balance = at_start(slit, slit_tree, 0.1, 20000).value
    average = at_start(slit, slit_tree, 0.1, 20000, weights="average").value
    assert average - balance == pytest.approx(slit.problem.temperature * np.log(3.0), rel=0.05)


def test_a_sample_belongs_to_the_class_of_its_own_path(slit, slit_tree):
    plan = plan_at_start(slit, slit_tree, 0.3, 400)
    rollouts = plan.estimate.rollouts
    chosen = np.arange(rollouts.size)
    arrived = rollouts.paths.outcome == Outcome.GOAL
    states, steps = plan.replay.trace(rollouts, chosen)
    windings = [slit.space.homology.winding(states[s, : steps[s] + 1]) for s in chosen]
    keys = np.array([slit.space.homology.key(winding) for winding in windings])
    np.testing.assert_array_equal(keys[arrived], rollouts.paths.key[arrived])
    own = np.array([class_id(winding) for winding in windings])
    for name, weight in plan.estimate.class_weights.items():
        if name != "other":
            assert plan.estimate.weight[arrived & (own == name)].sum() == pytest.approx(weight, abs=1e-12)
    drawn = np.repeat(["0,0", "-1,0", "0,1"], 400)
    assert np.any(own[arrived] != drawn[arrived])  # noise takes some to another class than their reference's


@pytest.mark.parametrize("exit_rule", ["bridge", "endpoint"])
def test_the_number_of_threads_does_not_change_a_bit(slit, slit_tree, exit_rule):
    plans = [plan_at_start(slit, slit_tree, 0.2, 500, threads=threads, exit=exit_rule) for threads in (1, 2, 3)]
    found = [plan.estimate for plan in plans]
    for plan, other in zip(plans[1:], found[1:], strict=True):
        np.testing.assert_array_equal(other.weight, found[0].weight)
        np.testing.assert_array_equal(other.control, found[0].control)
        np.testing.assert_array_equal(plan.tape, plans[0].tape)
        assert other.value == found[0].value


FINE = {"steps": "uniform", "dt": 0.1 / 64}


def passive(integral: PathIntegral, x: np.ndarray, count: int, seed: int):
    """Samples of no guide for eight seconds."""
    times = integral.steps(8.0)
    return led(integral, x, times, still(times), count=count, seed=seed)


def test_split_steps_leave_when_and_where_passive_paths_end_as_it_is():
    """Shares of walls and goal, and the times until then (Kolmogorov-Smirnov): 20 000 paths each, near both."""
    known = in_channel(0.5, 0.3, length=1.2, ahead=0.2)  # a tenth of a meter from the rim, as wide as the goal
    times, outcomes = [], []
    for settings in ({}, FINE):
        integral = path_integral(replace(known.problem, phi=0.0), known.space, Sampling(guide="open-loop", **settings))
        paths = passive(integral, known.x, 20_000, 7).paths
        times.append(paths.work)
        outcomes.append(paths.outcome)
    reached = [np.mean(outcome == Outcome.GOAL) for outcome in outcomes]
    assert 0.05 < reached[0] < 0.95
    assert abs(reached[0] - reached[1]) < 4.0 * np.sqrt(2.0 * reached[0] * (1.0 - reached[0]) / 20_000)
    assert kstest(*times).pvalue > 1e-3


@pytest.mark.parametrize("phi", [0.5, 2.0])
@pytest.mark.parametrize("make", [around_corner, around_post])
def test_with_a_small_final_cost_psi_is_that_of_the_grid_with_that_cost(make, phi):
    """Walls are worth exp(-1) or exp(-4), so most of psi comes from them; passive paths, 8 seeds."""
    known = make(0.5, phi)
    integral = path_integral(known.problem, known.space, Sampling(guide="open-loop"))
    rollouts = [passive(integral, known.x, 8000, seed) for seed in range(8)]
    assert not rollouts[0].tables.weighed
    values = shares(known, [integral.estimate(one) for one in rollouts])
    assert error_of(values) < 0.006
    assert is_the_grids(values)
