"""The long tests of unit/pirrht/estimation/test_path_integral.py."""

from __future__ import annotations

import numpy as np
import pytest
from batches import batch_of
from closed_forms import (
    LEFT,
    RIGHT,
    SEEDS,
    annulus,
    at_strip,
    disc_entry,
    interval_exit,
    straight,
    strip,
    strip_space,
    within,
)

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling

REFERENCES = [(), RIGHT, LEFT, (1, -1)]


@pytest.mark.parametrize(
    ("sides", "weights"),
    [*((sides, "balance") for sides in REFERENCES), ((1, -1), "average")],
    ids=["none", "near side", "far side", "both", "both, averaged"],
)
def test_desirability_matches_cosh_for_interval_exit_whatever_the_tapes(sides, weights):
    b, L, x = 0.5, 0.5, 0.2
    problem = strip(b, L)
    value, control = interval_exit(problem, b, L, x)
    sampling = Sampling(dt=0.05, first=0.0125, samples=20000 // max(1, len(sides)), guide="open-loop", weights=weights)
    integral = path_integral(problem, strip_space(L), sampling)
    found = [at_strip(integral, x, sides, seed) for seed in range(SEEDS)]
    values = np.array([e.value for e in found])
    assert within(values, value)
    assert values.mean() == pytest.approx(value, rel=0.01)
    assert within([e.control for e in found], [control, 0.0])


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
@pytest.mark.parametrize("b", [0.2, 0.3, 0.5])
def test_desirability_around_a_disc_is_a_ratio_of_bessel_functions(b, guide):
    radius, r = 0.3, 1.2
    problem, space = annulus(b, radius)
    value, speed = disc_entry(problem, b, radius, r)
    x = r * np.array([np.cos(0.5), np.sin(0.5)])
    integral = path_integral(problem, space, Sampling(dt=0.05, first=0.025, samples=1000, guide=guide, window=0.05))
    times = integral.grid(2.0 * (r - radius))
    tapes, _ = straight(x, [x * (radius / r)], times)
    batch = batch_of(integral, x, times, tapes, corners=[np.zeros((1, 2))])
    found = [integral.estimate(integral.rollout(batch, seed)) for seed in range(SEEDS)]
    values = np.array([e.value for e in found])
    assert values.mean() == pytest.approx(value, rel=0.01)
    assert within([e.control for e in found], -speed * x / r)
    if guide == "open-loop":
        assert within(values, value)


@pytest.mark.parametrize("b", [0.3, 0.5])
@pytest.mark.parametrize("radius", [0.1, 0.3])
def test_at_the_default_step_the_rim_of_a_disc_costs_nothing(radius, b):
    """psi over 24 seeds within 3 standard errors of 0.2 % or less, and within 0.5 %, of the Bessel functions."""
    r = 1.2
    problem, space = annulus(b, radius)
    value, _ = disc_entry(problem, b, radius, r)
    x = r * np.array([np.cos(0.5), np.sin(0.5)])
    integral = path_integral(problem, space, Sampling(samples=4000))
    times = integral.grid(2.0 * r)
    batch = batch_of(integral, x, times, np.zeros((1, len(times) - 1, 2)), corners=[np.zeros((1, 2))])
    found = [integral.estimate(integral.rollout(batch, seed)).log_psi for seed in range(SEEDS)]
    share = np.exp(np.array(found) + value / problem.temperature)
    assert share.std(ddof=1) / np.sqrt(SEEDS) < 0.002
    assert share.mean() == pytest.approx(1.0, abs=0.005)
    assert within(share, 1.0)
