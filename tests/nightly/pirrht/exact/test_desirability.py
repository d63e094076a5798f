"""The long tests of unit/pirrht/exact/test_desirability.py."""

from __future__ import annotations

import math

import numpy as np
import pytest
from batches import batch_of
from unit.pirrht.exact.test_desirability import (
    START,
    post,
    scene,
    solved,
    through_slit,  # noqa: F401
)

from pirrht import FreeSpace, Problem, Sampling, Unicycle, path_integral
from pirrht.exact.desirability import Desirability


@pytest.mark.thorough
def test_judged_at_the_ends_of_steps_the_slit_looks_safer(slit, through_slit):
    """Independent: 9.452 and a share of 0.46 through the slit, against 9.535 and 0.05 in continuous time."""
    grid = Desirability.of(slit.with_settings(noise=0.3).problem, slit.space, dt=0.1)
    assert grid.value(START) == pytest.approx(9.452, abs=0.003)
    assert grid.shares(START, 2000)["0,0"] == pytest.approx(0.46, abs=4 * 0.011)
    assert through_slit[0.3].shares(START, 2000)["0,0"] == pytest.approx(0.048, abs=4 * 0.005)


def test_the_discrete_solution_solves_its_own_equation():
    """psi(x) = exp(-q dt/lambda) E[psi(x + b dw)] by 200 000 draws, seed 0; four standard errors."""
    b, dt = 0.3, 0.1
    room = scene(post(2.0, 2.2, 0.3))
    grid = solved(room, b, dt=dt)
    draws = np.random.default_rng(0).standard_normal((20_000, 2))
    for x in ([0.5, 2.0], [1.45, 2.1], [3.0, 2.4]):
        after = np.exp(grid.log_psi(np.array(x) + b * math.sqrt(dt) * draws) - grid.log_psi(np.array(x)) - dt / 0.18)
        assert after.mean() == pytest.approx(1.0, abs=4.0 * after.std() / math.sqrt(len(draws)))


@pytest.mark.thorough
def test_the_value_of_a_car_agrees_with_samples():
    """10^5 passive paths each, seed 0: standard errors of 0.2 %; the grid has 1 % of its own."""
    room = scene(post(1.8, 2.2, 0.3), post(2.6, 1.2, 0.25))
    problem = Problem(dynamics=Unicycle(b=0.3), scene=room, R=np.eye(1))
    space = FreeSpace.of(room)
    grid = Desirability.of(problem, space, spacing=0.04)
    sampler = path_integral(problem, space, Sampling(dt=0.05, guide="open-loop", samples=100_000))
    for x in ([0.5, 0.5, 0.8], [2.2, 1.7, 0.0], [2.5, 3.2, -2.0]):
        times = sampler.grid(4.0)
        estimate = sampler.estimate(
            sampler.rollout(batch_of(sampler, np.array(x), times, np.zeros((1, len(times) - 1, 1))), 0)
        )
        error = problem.temperature / math.sqrt(estimate.ess)
        assert grid.value(np.array(x)) == pytest.approx(estimate.value, abs=0.01 * estimate.value + 4.0 * error)
