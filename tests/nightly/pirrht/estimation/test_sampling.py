"""Reported errors cover what repeats show, and how samples are shared out leaves the mean of psi where it is."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import at_strip, strip, strip_space

from pirrht.arrays import Array
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from sim.scenario import Scenario


def corridor() -> tuple[Problem, FreeSpace]:
    return strip(0.5, 0.5), strip_space(0.5)


def assert_cautious(estimates: list[Estimate]) -> None:
    """Errors of v and u count the largest term several times: no less than the spread, which 300 plans tell to 4 %."""
    found = np.array([[e.value, *e.control] for e in estimates])
    errors = np.array([[e.value_error, *e.control_error] for e in estimates])
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / found.std(axis=0, ddof=1)
    assert np.all(ratio > 0.88), ratio
    assert np.all(ratio < 1.9), ratio


@pytest.mark.parametrize("counts", [[400, 400], [400, 150]], ids=["equal counts", "unequal counts"])
@pytest.mark.parametrize("weights", ["balance", "average"])
def test_the_reported_error_covers_the_spread_of_300_repeats(weights, counts):
    integral = path_integral(
        strip(0.5, 0.5), strip_space(0.5), Sampling(dt=0.05, first=0.0125, guide="open-loop", weights=weights)
    )
    assert_cautious([at_strip(integral, 0.2, (1, -1), seed, counts=counts) for seed in range(300)])


def test_the_reported_error_covers_the_spread_of_300_plans_in_the_slit(slit: Scenario, slit_tree: HomologyTree):
    controller = slit.with_settings(noise=0.1, samples=200).controller(slit_tree)
    assert_cautious([controller.plan(slit.start).estimate for _ in range(300)])


@pytest.mark.parametrize("weights", ["balance", "average"])
def test_unequal_counts_leave_the_mean_of_psi_over_1000_repeats(weights):
    integral = path_integral(
        strip(0.5, 0.5), strip_space(0.5), Sampling(dt=0.1, guide="open-loop", weights=weights, threads=1)
    )

    def psi(counts: list[int]) -> Array:
        return np.exp([at_strip(integral, 0.2, (1, -1), seed, counts=counts).log_psi for seed in range(1000)])

    equal = psi([50, 50])
    for counts in ([85, 15], [15, 85]):
        other = psi(counts)
        error = np.sqrt((equal.var(ddof=1) + other.var(ddof=1)) / 1000)
        assert abs(other.mean() - equal.mean()) <= 3.0 * error, counts
