"""What the mean of what paths apply tells of the control now: beside a flat wall, in closed form."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from discs import block, scene_of
from scipy.integrate import quad
from scipy.stats import norm

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal
from pirrht.proposals.wall_drift import FlatWalls, NearWalls, WallDrift, shortfall
from pirrht.systems.single_integrator import SingleIntegrator

B = 0.2
SPEEDS = [0.0, 1e-6, 0.05, 0.4, 1.0]


def mean_slope(c: float, s: float, t: float, away: float = 0.0) -> float:
    """E of (log h)'(Z_t) under the law of h = sinh(g z), by quadrature over passive paths that have not met z = 0.

    Seen from a wall that comes at `-away` [m/s], passive paths drift by `away`.
    """
    g, drift = s / B**2, away / B**2
    rate = 0.5 * B**2 * (g * g - drift * drift)  # at which h decays, in equilibrium: so exp(-drift z) sinh(g z) solves

    def h(z: float) -> float:
        return math.exp(-drift * z) * (math.sinh(g * z) if g > 0.0 else z)

    def slope(z: float) -> float:
        return math.exp(-drift * z) * (
            (g * math.cosh(g * z) if g > 0.0 else 1.0) - drift * (math.sinh(g * z) if g > 0.0 else z)
        )

    spread = B * math.sqrt(t)

    def density(z: float) -> float:
        straight = norm.pdf(z, c + away * t, spread)
        return straight - math.exp(-2.0 * c * drift) * norm.pdf(z, -c + away * t, spread)

    end = c + abs(away) * t + (s + abs(away)) * t + 12.0 * spread
    return quad(lambda z: slope(z) * density(z), 0.0, end, limit=400)[0] * math.exp(-rate * t) / h(c)


@pytest.mark.parametrize("s", SPEEDS)
@pytest.mark.parametrize("c", [0.01, 0.05, 0.2])
@pytest.mark.parametrize("away", [0.0, 0.3, -0.3])
def test_the_mean_of_the_slope_falls_short_by_what_paths_that_would_meet_the_wall_had(s, c, away):
    """At rest and at constant speed, along the wall and away from it, within 1e-5 of that along it."""
    span, g, drift = 0.04, s / B**2, away / B**2
    now = (g / math.tanh(g * c) if g > 0.0 else 1.0 / c) - drift
    moments, weights = np.polynomial.legendre.leggauss(8)
    mean = sum(0.5 * w * mean_slope(c, s, 0.5 * (m + 1.0) * span, away) for m, w in zip(moments, weights, strict=True))
    assert shortfall(c, s, B**2, span) == pytest.approx(now - mean, abs=1e-5 / c)


def next_to(*walls: tuple[float, tuple[float, float], float], push: tuple[float, float] = (0, 0)) -> NearWalls:
    def near(x: np.ndarray, s: float = 0.0) -> tuple[float, ...]:
        known = [(c + receding * s, *away) for c, away, receding in walls]
        return tuple(itertools.chain(*[*known, (np.inf, 0.0, 0.0), (np.inf, 0.0, 0.0)][:2]))

    d = SimpleNamespace(G_c=lambda x: np.eye(2), B_c=lambda x: B * np.eye(2))
    drift = SimpleNamespace(walls=near, gain=lambda x: B**2 * np.eye(2), problem=SimpleNamespace(dynamics=d))
    flat = FlatWalls(drift=cast(WallDrift, drift), x=np.zeros(2), span=0.02)
    return NearWalls(push=np.array(push), clipped=np.zeros(2), flat=flat)


def test_controls_are_told_without_the_push_and_add_what_is_missing_along_each_wall():
    mean, led = np.array([0.3, -0.2]), np.zeros(2)  # no faster than along the wall
    free, unsure = next_to((0.02, (0.0, 1.0), 0.0), push=(0.1, 0.4)).corrected_control(mean, led)
    missing = B**2 * shortfall(0.02, 0.0, B**2, 0.02)
    assert free + np.array([0.1, 0.4]) == pytest.approx(mean + np.array([0.0, missing]))
    assert unsure == pytest.approx([0.0, 0.3 * missing])
    both, _ = next_to((0.02, (0.0, 1.0), 0.0), (0.02, (0.0, -1.0), 0.2)).corrected_control(np.zeros(2), led)
    assert both[1] == pytest.approx(0.0)  # slower than along either, as if along both
    nothing, sure = next_to().corrected_control(mean, led)
    assert np.array_equal(nothing, mean)
    assert np.array_equal(sure, np.zeros(2))


def test_a_wall_that_pushes_no_harder_leaves_in_the_error_what_the_grid_has():
    """3 mm beside a flat wall, where psi vanishes like the distance: the control is off by what is told."""
    obstacle = block("wall", 2.5, 0.4, (2.0, 0.3))
    scene = scene_of([obstacle], start=(0.6, 1.5), goal=(4.3, 1.6, 0.3), side=(5.0, 3.0), radius=0.2)
    problem = Problem(dynamics=SingleIntegrator(b=0.2), scene=scene, R=2.0 * np.eye(2))
    space, x = FreeSpace.of(scene), np.array([2.5, 0.903])
    integral = path_integral(problem, space, Sampling(threads=1, first=0.01))
    leading = integral.proposals
    climb = leading.climbing(x, np.array([[4.3, 1.6]]))
    times = integral.steps(6.0)
    batch = Batch(state=x, times=times, proposals=(Proposal(lead=climb, count=4000),))
    found = integral.estimate(integral.rollout(batch, 1))
    assert found.walls.clipped[1] == pytest.approx(0.04 * (1.0 / 0.003 - 1.0 / 0.004), rel=0.05)
    off = Desirability.of(problem, space).control(x) - found.control
    assert 1.0 < off[1] < 1.2 * found.control_error[1]
