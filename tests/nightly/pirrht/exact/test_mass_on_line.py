"""The grid of a mass on a line against plain Monte Carlo, against what it tends to without noise, and against ours."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from benchmarks import mass_line
from benchmarks.mass_on_line import MassOnLine, mass_on_line
from thoroughly import first, thorough

Q, R = 1.0, 2.0


@cache
def solved(b: float, spacing: float = 0.01, fastest: float = 3.0, phi: float = np.inf) -> MassOnLine:
    return mass_on_line(b=b, q=Q, r=R, phi=phi, spacing=spacing, fastest=fastest)


def simulated(p: float, v: float, b: float, phi: float, paths: int, step: float, seed: int) -> tuple[float, float]:
    """Mean of exp(-(q t + phi at the wall) / lambda) over passive paths, and its error; position is v's exact integral.

    Within a step a path is a parabola: it is in the wall if that is, and in the goal where the chord crosses p = 1.
    """
    rng, lam = np.random.default_rng(seed), R * b * b
    x, y, found, t = np.full(paths, p), np.full(paths, v), np.zeros(0), 0.0
    while len(x) and t < 40.0 * lam / Q:
        one, other = rng.standard_normal((2, len(x)))
        faster = y + b * np.sqrt(step) * one
        moved = x + 0.5 * step * (y + faster) + b * np.sqrt(step**3 / 12.0) * other
        turned = (y < 0.0) & (faster > 0.0)
        lowest = np.where(turned, x - 0.5 * step * y**2 / np.where(turned, faster - y, 1.0), moved)
        crashed = np.minimum(lowest, moved) <= 0.0
        arrived = ~crashed & (moved >= 1.0)
        share = (1.0 - x[arrived]) / (moved - x)[arrived]
        found = np.concatenate([
            found,
            np.exp(-(Q * (t + step) + phi) / lam) * np.ones(crashed.sum()),
            np.exp(-Q * (t + step * share) / lam),
        ])  # fmt: skip
        inside = ~(crashed | arrived)
        x, y, t = moved[inside], faster[inside], t + step
    found = np.concatenate([found, np.zeros(len(x))])
    return float(found.mean()), float(found.std() / np.sqrt(paths))


@pytest.mark.parametrize("phi", [np.inf, 1.0])
@pytest.mark.parametrize("x", [(0.5, 0.0), *(thorough(x) for x in ((0.2, 0.3), (0.4, -0.6), (0.8, 0.5)))])
def test_psi_is_that_of_plain_monte_carlo(x, phi):
    """b = 0.7, 20 000 paths of steps of 0.002 s, seed 1; within 3 standard errors and the grid's own error."""
    truth = solved(0.7, fastest=6.0, phi=phi)
    psi, error = simulated(*x, 0.7, phi, 20_000, 0.002, 1)
    assert error < 0.03 * psi
    assert np.exp(truth.log_psi(*x)) == pytest.approx(psi, abs=3.0 * error + psi * truth.error(*x) / truth.temperature)


@pytest.mark.parametrize("b", first(mass_line.NOISES))
def test_the_value_that_samples_give_a_mass_is_the_grids(b):
    """At 20 random states within 1 %, 2000 samples each, seed 0."""
    truth, integral = solved(b, spacing=0.005), mass_line.sampler(b, threads=1)
    for p, v in mass_line.random_line_states(20, 0):
        assert mass_line.sampled(integral, p, v, 2000, 0).value == pytest.approx(truth.value(p, v), rel=0.01)
