"""Symmetries of estimates, which problems are linearly solvable, traps of the paper, steps, and pairs."""

from dataclasses import replace

import numpy as np
import pytest
from batches import batch_of, led, still
from closed_forms import at_strip, in_strip

from pirrht import (
    NoSurvivingSample,
    OptionError,
    PathIntegral,
    Problem,
    Sampling,
    SingleIntegrator,
    path_integral,
)


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
def test_a_reference_may_be_split_into_two_of_half_the_samples(guide):
    integral = in_strip(dt=0.05, samples=600, guide=guide)
    whole = at_strip(integral, 0.2, (1, -1), 3, counts=[600, 600])
    split = at_strip(integral, 0.2, (1, 1, -1), 3, counts=[200, 400, 600])
    np.testing.assert_allclose(split.rollouts.log_weight, whole.rollouts.log_weight, atol=1e-9)
    np.testing.assert_allclose(split.control, whole.control, atol=1e-9)


def test_without_the_likelihood_ratio_only_what_controls_cost_is_left_out():
    """With passive samples "biased" is what "balance" says; with samples that are driven, v lacks half of its cost."""
    said = {}
    for weights in ("balance", "biased"):
        for sides in ((), (1,)):
            integral = in_strip(dt=0.05, samples=4000, guide="open-loop", weights=weights)
            said[weights, sides] = at_strip(integral, 0.2, sides, 3).value
    assert said["biased", ()] == said["balance", ()]
    assert said["biased", (1,)] < 0.9 * said["balance", (1,)]


def test_a_rate_given_as_a_function_needs_its_least_value(slit):
    with pytest.raises(OptionError, match="q_min"):
        Problem(dynamics=SingleIntegrator(), scene=slit.problem.scene, R=np.eye(2), q=lambda x, p: 1.0)


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_the_first_increment_has_the_variance_of_its_step(dt):
    """Trap 1: it is sqrt(dt) Z_0, so the control carried is b Z_0 / sqrt(dt); 20000 samples, errors of 0.5 %."""
    paths = at_strip(in_strip(dt=dt, samples=20000, guide="open-loop"), 0.0, (), 0).rollouts.paths
    inside = paths.span == dt  # samples that leave in this step carry no noise from there on
    assert np.mean(inside) > 0.9
    now = paths.now[inside] / dt
    np.testing.assert_allclose(now.std(axis=0), 0.5 / np.sqrt(dt), rtol=0.02)
    np.testing.assert_allclose(now.mean(axis=0), 0.0, atol=4.0 * 0.5 / np.sqrt(dt * 20000))


@pytest.mark.parametrize("exit_rule", ["bridge", "endpoint"])
def test_the_tape_is_the_weighted_mean_of_what_samples_carried_before_their_exit(exit_rule):
    """Trap 7. With exit at step ends a path is the sum of what it carried, so its states are the oracle."""
    integral = in_strip(dt=0.1, samples=200, exit=exit_rule)
    estimate = at_strip(integral, 0.2, (1,), 5)
    rollouts = estimate.rollouts
    tape = integral.replay.tape(estimate.parts)
    last = int(rollouts.paths.steps[estimate.weight > 1e-6].max())
    assert 1 < last < len(tape)
    assert np.all(tape[last:] == 0.0)
    assert np.all(tape[:last].any(axis=1))
    if exit_rule == "endpoint":
        states, steps = integral.replay.trace(rollouts, np.arange(rollouts.size))
        np.testing.assert_array_equal(steps, rollouts.paths.steps)
        under_way = np.arange(len(tape)) < steps[:, None]
        carried = under_way[..., None] * np.diff(states, axis=1) / 0.1
        np.testing.assert_allclose(tape, np.einsum("s,sti->ti", estimate.weight, carried), atol=1e-4)


@pytest.mark.parametrize(
    ("speed", "T", "collisions", "timeouts"), [(0.0, 3, 0, 100), (20.0, 30, 100, 0)], ids=["stands", "rams"]
)
def test_no_surviving_sample_counts_how_they_ended(slit, speed, T, collisions, timeouts):
    integral = of(slit, samples=100)
    batch = batch_of(integral, slit.start, np.arange(T + 1) * 0.1, np.tile([0.0, speed], (1, T, 1)))
    with pytest.raises(NoSurvivingSample, match=f"{collisions} collided") as caught:
        integral.estimate(integral.rollout(batch, 0))
    assert (caught.value.collisions, caught.value.timeouts) == (collisions, timeouts)


def test_sampling_refuses_by_name():
    for wrong in (
        {"dt": 0.0}, {"dt": np.nan}, {"first": -1.0}, {"samples": 0}, {"exit": "no"}, {"weights": "no"},
        {"guide": "no"}, {"allocation": "no"}, {"target": 0.0}, {"budget": 100},
    ):  # fmt: skip
        with pytest.raises(OptionError, match=next(iter(wrong))):
            Sampling(**wrong)


def of(slit, **changes: object) -> PathIntegral:
    return path_integral(slit.problem, slit.space, replace(slit.sampling, **changes))


@pytest.mark.parametrize("steps", ["fitted", "uniform"])
def test_the_first_step_is_cut_finer_only_where_exits_are_judged_along_steps(slit, steps):
    cut = {"dt": 0.1, "first": 0.01, "steps": steps}
    np.testing.assert_allclose(of(slit, **cut).steps(0.5), [*(0.01 * np.arange(10)), 0.1, 0.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(of(slit, **cut, exit="endpoint").steps(0.5), 0.1 * np.arange(6))


@pytest.mark.parametrize(("exit_rule", "alike"), [("endpoint", True), ("bridge", False)])
def test_with_exit_at_step_ends_fitted_steps_are_uniform_ones_and_along_steps_they_are_not(slit, exit_rule, alike):
    """Passive samples beside a wall, on the grids that a sampler makes itself."""
    noisy, outcomes = slit.with_settings(noise=0.3), []
    for steps in ("fitted", "uniform"):
        integral = of(noisy, guide="open-loop", steps=steps, exit=exit_rule)
        x, times = np.array([2.3, 2.63]), integral.steps(1.0)
        rollouts = led(integral, x, times, still(times), count=integral.sampling.samples, seed=3)
        outcomes.append(rollouts.paths.outcome)
    assert np.array_equal(*outcomes) == alike


PLANS = 60


def test_a_pair_starts_with_opposite_steps_and_what_is_left_over_stands_alone(slit):
    source = of(slit, guide="open-loop")
    batch = batch_of(source, slit.start, np.arange(61) * 0.1, np.zeros((2, 60, 2)), counts=[3, 4])
    states, _ = source.replay.trace(source.rollout(batch, 3), np.arange(7))
    steps = states[:, 1] - slit.start
    for a, b in ((0, 1), (3, 4), (5, 6)):  # the third sample has no partner
        np.testing.assert_allclose(steps[a], -steps[b], atol=1e-15)
    assert not np.allclose(np.abs(steps[2]), np.abs(steps[0]))


def test_pairs_leave_the_mean_of_psi_where_it_is_and_scatter_the_control_less(slit, slit_tree):
    """One meter before the goal; means over 60 plans, the difference of psi within 3 standard errors.

    The ratio of two scatters, 0.17, has a relative standard error of 9 % (two components each).
    """
    x, corners = slit.space.scene.goal.center - np.array([1.0, 0.0]), [slit.space.scene.goal.center[None, :]]
    times = of(slit).grid(1.0)
    psi, control = [], []
    for draws in ("antithetic", "independent"):
        source = of(slit, draws=draws, samples=200)
        batch = batch_of(source, x, times, np.zeros((1, len(times) - 1, 2)), corners=corners)
        found = [source.estimate(source.rollout(batch, seed)) for seed in range(PLANS)]
        psi.append([e.log_psi for e in found])
        control.append([e.control for e in found])
    pairs, alone = np.exp(np.array(psi) - np.max(psi))
    assert abs(pairs.mean() - alone.mean()) < 3.0 * np.sqrt((pairs.var(ddof=1) + alone.var(ddof=1)) / PLANS)
    paired, independent = np.std(control, axis=1).mean(axis=-1)
    assert paired < 0.5 * independent
