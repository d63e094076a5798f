"""The long tests of unit/pirrht/estimation/test_sampling.py."""

from __future__ import annotations

import numpy as np
import pytest
from unit.pirrht.estimation.test_sampling import (
    strip,  # noqa: F401
    to_both_sides,
)

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.planner.tree import HomologyTree
from sim.scenario import Scenario


def spread_and_error(estimates: list[Estimate]) -> tuple[Array, Array]:
    """Standard deviation over estimates of v, u_1, u_2, and the root mean square of what they report, (3,)."""
    found = np.array([[e.value, *e.control] for e in estimates])
    errors = np.array([[e.value_error, *e.control_error] for e in estimates])
    return found.std(axis=0, ddof=1), np.sqrt(np.mean(errors**2, axis=0))


def assert_cautious(error: Array, spread: Array) -> None:
    """Errors count the largest term several times: they are no less than the spread, which 300 plans tell to 4 %."""
    ratio = error / spread
    assert np.all(ratio > 0.88), ratio
    assert np.all(ratio < 1.9), ratio


# -- standard errors ---------------------------------------------------------------------------------------------


COUNTS = pytest.mark.parametrize("counts", [[400, 400], [400, 150]], ids=["equal counts", "unequal counts"])


@COUNTS
@pytest.mark.parametrize("weights", ["balance", "average"])
def test_the_reported_error_covers_the_spread_of_300_repeats(strip, weights, counts):
    sampling = Sampling(dt=0.05, first=0.0125, guide="open-loop", weights=weights)
    integral = path_integral(*strip, sampling)
    spread, error = spread_and_error([to_both_sides(integral, seed, counts=counts) for seed in range(300)])
    assert_cautious(error, spread)


def test_the_reported_error_covers_the_spread_of_300_plans_in_the_slit(slit: Scenario, slit_tree: HomologyTree):
    controller = slit.with_settings(noise=0.1, samples=200).controller(slit_tree)
    estimates = [controller.plan(slit.start).estimate for _ in range(300)]
    spread, error = spread_and_error([e for e in estimates if e is not None])
    assert_cautious(error, spread)


# -- allocation --------------------------------------------------------------------------------------------------


def desirability(integral: PathIntegral, repeats: int, **options) -> Array:
    """psi of independent repeats."""
    return np.exp([to_both_sides(integral, seed, **options).log_psi for seed in range(repeats)])


def agree(one: Array, other: Array, *, errors: float = 3.0) -> bool:
    """Whether the means of two independent sets are equal up to so many standard errors of their difference."""
    error = np.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    return bool(abs(one.mean() - other.mean()) <= errors * error)


@pytest.mark.parametrize("weights", ["balance", "average"])
def test_unequal_counts_leave_the_mean_of_psi_over_1000_repeats(strip, weights):
    integral = path_integral(*strip, Sampling(dt=0.1, guide="open-loop", weights=weights, threads=1))
    equal = desirability(integral, 1000, counts=[50, 50])
    for counts in ([85, 15], [15, 85]):
        assert agree(desirability(integral, 1000, counts=counts), equal), counts
