"""psi of a point against the grid: with any guide, with split steps, with walls that end paths or weigh them.

Where psi is said to be that of the grid, its mean over independent seeds (0, 1, ...) lies within three standard errors
and 1 %: the clearance field never tells too much clearance, so obstacles are a little wider than they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from solved import Solved, around_corner, around_post, in_channel

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.outcome import Outcome
from pirrht.proposals.proposal import Batch, Proposal, Tape

WIDER = 0.01  # of psi that obstacles may take too much


FINE = {"steps": "uniform", "dt": 0.1 / 64}


def shares(known: Solved, found: list[Estimate]) -> Array:
    """psi by the grid's."""
    return np.exp([e.log_psi - known.truth.log_psi(known.x) for e in found])


def error_of(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def is_the_grids(values: Array) -> bool:
    return bool(abs(values.mean() - 1.0) < 3.0 * error_of(values) + WIDER)


def passive(integral: PathIntegral, x: Array, count: int) -> Batch:
    """Samples of no guide for eight seconds."""
    times = integral.steps(8.0)
    still = Proposal(lead=Tape(times, np.zeros((len(times) - 1, 2))), count=count)
    return Batch(state=x, times=times, proposals=(still,))


# -- split steps -------------------------------------------------------------------------------------------------


def near_goal(b: float) -> Solved:
    """A tenth of a meter from the rim, in a channel as wide as the goal."""
    return in_channel(b, 0.3, length=1.2, ahead=0.2)


def test_split_steps_leave_when_and_where_passive_paths_end_as_it_is():
    """Shares of walls and goal, and the times until then (Kolmogorov-Smirnov): 20 000 paths each, near both."""
    known = near_goal(0.5)
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
