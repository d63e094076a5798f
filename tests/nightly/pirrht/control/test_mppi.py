"""The long tests of unit/pirrht/control/test_mppi.py."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import SEEDS, annulus, disc_entry, wave_number, within
from scipy.special import k0
from unit.pirrht.control.test_mppi import RADIUS, B

from pirrht.control.baselines import Mppi
from pirrht.estimation.sampling import Sampling
from sim.scenario import Scenario


def exact_beyond(states):
    """The value of entering the disc of `annulus`, as the cost behind the horizon."""
    problem, _ = annulus(B, RADIUS)
    k = wave_number(problem, B)
    r = np.maximum(np.hypot(*states[:, :2].T), RADIUS)
    return -problem.temperature * np.log(k0(k * r) / k0(k * RADIUS))


@pytest.mark.parametrize("horizon", [0.4])
def test_with_the_exact_cost_to_go_value_and_control_are_exact_at_any_horizon(horizon: float):
    problem, space = annulus(B, RADIUS)
    x = np.array([1.0, 0.0])
    values, controls, warm, sizes = [], [], [], []
    for seed in range(SEEDS):
        sampling = Sampling(dt=0.02, samples=1500, guide="open-loop", draws="independent")
        mppi = Mppi(
            problem, space, sampling, horizon=horizon, terminal_cost=exact_beyond, rng=np.random.default_rng(seed)
        )
        first, second = mppi.plan(x), mppi.plan(x)  # the second around the tape that the first found
        assert first.estimate is not None
        assert second.estimate is not None
        values.append(np.exp(first.estimate.log_psi))
        warm.append(np.exp(second.estimate.log_psi))
        controls.append(second.control)
        sizes.append((first.estimate.ess, second.estimate.ess))
    value, speed = disc_entry(problem, B, RADIUS, 1.0)
    psi = np.exp(-value / problem.temperature)
    assert within(values, psi)
    assert within(warm, psi)
    cold, after = np.median(sizes, axis=0)
    assert after > 4.0 * cold  # a warm start is the better proposal
    assert within(controls, [-speed, 0.0])


@pytest.mark.thorough
def test_the_slit_is_no_straw_man(slit: Scenario):
    """Where the straight way is the right one MPPI takes it, as it did in 12 of 12 drives."""
    outcomes = []
    for seed in range(4):
        scenario = slit.with_settings(method="mppi", seed=seed)
        *_, last = scenario.drive(scenario.plant(), scenario.controller(None))
        outcomes.append(last.outcome.name)
    assert outcomes.count("GOAL") >= 3
