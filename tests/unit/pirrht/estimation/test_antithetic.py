"""Pairs of samples with opposite noise: the same law for each, less scatter together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from batches import batch_of

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from sim.scenario import Scenario

TIMES = np.arange(61) * 0.1


PLANS = 60


def of(slit: Scenario, **changes: object) -> PathIntegral:
    return path_integral(slit.problem, slit.space, replace(slit.sampling, **changes))


def test_a_pair_starts_with_opposite_steps_and_what_is_left_over_stands_alone(slit):
    source = of(slit, guide="open-loop")
    rollouts = source.rollout(batch_of(source, slit.start, TIMES, np.zeros((2, 60, 2)), counts=[3, 4]), 3)
    states, _ = source.replay.trace(rollouts, np.arange(7))
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
    tapes = np.zeros((1, len(times) - 1, 2))
    psi, control = {}, {}
    for draws in ("antithetic", "independent"):
        source = of(slit, draws=draws, samples=200)
        batch = batch_of(source, x, times, tapes, corners=corners)
        found = [source.estimate(source.rollout(batch, seed)) for seed in range(PLANS)]
        psi[draws] = np.array([e.log_psi for e in found])
        control[draws] = np.array([e.control for e in found])
    top = max(logs.max() for logs in psi.values())
    mean = {draws: np.exp(logs - top).mean() for draws, logs in psi.items()}
    error = np.sqrt(sum(np.exp(logs - top).var(ddof=1) / PLANS for logs in psi.values()))
    assert abs(mean["antithetic"] - mean["independent"]) < 3.0 * error
    assert control["antithetic"].std(axis=0).mean() < 0.5 * control["independent"].std(axis=0).mean()
