"""Rollout steps: fitted to the place or all of one length, and whole ones where exits are judged at their ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.estimate import Rollouts
from pirrht.estimation.sampler import PathIntegral
from pirrht.proposals.proposal import Batch, Proposal, Tape
from sim.scenario import Scenario

BESIDE_THE_WALL = np.array([2.3, 2.63])


def around_nothing(slit: Scenario, x: np.ndarray, **changes: object) -> tuple[PathIntegral, Rollouts]:
    """Passive samples on the grid that a sampler makes itself."""
    integral = path_integral(slit.problem, slit.space, replace(slit.sampling, guide="open-loop", **changes))
    times = integral.steps(1.0)
    lead = Tape(times, np.zeros((len(times) - 1, 2)))
    batch = Batch(state=x, times=times, proposals=(Proposal(lead=lead, count=integral.sampling.samples),))
    return integral, integral.rollout(batch, 3)


@pytest.mark.parametrize("steps", ["fitted", "uniform"])
def test_the_first_step_is_cut_finer_only_where_exits_are_judged_along_steps(slit, steps):
    cut = replace(slit.sampling, dt=0.1, first=0.01, steps=steps)
    grid = path_integral(slit.problem, slit.space, cut).steps(0.5)
    np.testing.assert_allclose(grid, [*(0.01 * np.arange(10)), 0.1, 0.2, 0.3, 0.4, 0.5])
    grid = path_integral(slit.problem, slit.space, replace(cut, exit="endpoint")).steps(0.5)
    np.testing.assert_allclose(grid, 0.1 * np.arange(6))


def test_with_exit_at_step_ends_fitted_steps_are_uniform_ones_and_along_steps_they_are_not(slit):
    noisy = slit.with_settings(noise=0.3)
    for exit_rule, alike in (("endpoint", True), ("bridge", False)):
        fitted, uniform = (
            around_nothing(noisy, BESIDE_THE_WALL, steps=steps, exit=exit_rule)[1].paths.outcome
            for steps in ("fitted", "uniform")
        )
        assert np.array_equal(fitted, uniform) == alike
