"""psi of a point against the grid: with split steps, with walls that cost little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from solved import Solved, around_corner, around_post, error_of, in_channel, is_the_grids, shares

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.outcome import Outcome
from pirrht.proposals.proposal import Batch, Proposal, Tape

FINE = {"steps": "uniform", "dt": 0.1 / 64}


def passive(integral: PathIntegral, x: Array, count: int) -> Batch:
    """Samples of no guide for eight seconds."""
    times = integral.steps(8.0)
    still = Proposal(lead=Tape(times, np.zeros((len(times) - 1, 2))), count=count)
    return Batch(state=x, times=times, proposals=(still,))


def test_split_steps_leave_when_and_where_passive_paths_end_as_it_is():
    """Shares of walls and goal, and the times until then (Kolmogorov-Smirnov): 20 000 paths each, near both."""
    known = in_channel(0.5, 0.3, length=1.2, ahead=0.2)  # a tenth of a meter from the rim, as wide as the goal
    times, outcomes = [], []
    for settings in ({}, FINE):
        integral = path_integral(replace(known.problem, phi=0.0), known.space, Sampling(guide="open-loop", **settings))
        paths = integral.rollout(passive(integral, known.x, 20_000), 7).paths
        times.append(paths.work)
        outcomes.append(paths.outcome)
    reached = [np.mean(outcome == Outcome.GOAL) for outcome in outcomes]
    assert 0.05 < reached[0] < 0.95
    assert abs(reached[0] - reached[1]) < 4.0 * np.sqrt(2.0 * reached[0] * (1.0 - reached[0]) / 20_000)
    assert kstest(*times).pvalue > 1e-3


@pytest.mark.parametrize("phi", [0.5, 2.0])
@pytest.mark.parametrize("make", [around_corner, around_post])
def test_with_a_small_final_cost_psi_is_that_of_the_grid_with_that_cost(make: Callable[..., Solved], phi):
    """Walls are worth exp(-1) or exp(-4), so most of psi comes from them; passive paths, 8 seeds."""
    known = make(0.5, phi)
    integral = path_integral(known.problem, known.space, Sampling(guide="open-loop"))
    rollouts = [integral.rollout(passive(integral, known.x, 8000), seed) for seed in range(8)]
    assert not rollouts[0].tables.weighed
    values = shares(known, [integral.estimate(one) for one in rollouts])
    assert error_of(values) < 0.006
    assert is_the_grids(values)
