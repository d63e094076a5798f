"""Proposals of a point: psi of a path's class against closed forms and grids, and the control next to flat walls."""

import itertools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from batches import led
from discs import block, scene_of
from scipy.integrate import quad
from scipy.stats import norm
from solved import Solved, around_corner, around_post, in_channel, problem_in, slope

from pirrht import Desirability, FreeSpace, PathIntegral, Sampling, path_integral
from pirrht.proposals.desirability_tube import DesirabilityAscent
from pirrht.proposals.wall_drift import FlatWalls, NearWalls, WallDrift, shortfall

Made = Callable[..., Solved]


def way(known: Solved) -> tuple[PathIntegral, DesirabilityAscent]:
    """The way of the first reference from the start."""
    integral = path_integral(known.problem, known.space, Sampling())
    return integral, integral.proposals.climbing(known.x, known.lines[0])


def beside(known: Solved, seed: int, count: int = 300) -> np.ndarray:
    """States within about 5 cm of the first reference, 3 cm from walls and 20 cm from the goal at least, (., 2) [m]."""
    rng = np.random.default_rng(seed)
    whole = np.vstack([known.x, known.lines[0]])
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(whole, axis=0).T))])
    at = ends[-1] * rng.uniform(0.02, 0.9, count)
    states = np.stack([np.interp(at, ends, whole[:, i]) for i in range(2)], axis=1)
    states += 0.05 * rng.standard_normal((count, 2))
    far = np.hypot(*(states - known.space.scene.goal.center).T) > 0.2
    return states[far & (known.space.collision.clearance(states) > 0.03)]


@pytest.mark.parametrize(
    ("b", "width", "off"),
    [(0.3, 0.3, 0.02), (0.3, 0.5, 0.02), (0.3, 1.0, 0.02), (0.5, 0.5, 0.02), (0.5, 1.0, 0.02), (0.7, 0.5, 0.04)],
    ids=["kw 3.3", "kw 5.6", "kw 11", "kw 2", "kw 4", "kw 1"],
)
def test_in_a_straight_channel_transfers_settle_to_its_slowest_mode(b, width, off):
    """sin(pi y / w) exp(-sqrt(k^2 + (pi / w)^2) x), from a few widths before the goal on: at 200 places of seed 0.

    Median errors, and nine of ten: the normals of the clearance field are tilted here and there, by up to 10 degrees.
    """
    integral, lead = way(in_channel(b, width))
    rate, mode = np.hypot(1.0 / b**2, np.pi / width), np.pi / width
    x, share = np.random.default_rng(0).uniform([1.0, 0.15], [3.0, 0.85], (200, 2)).T
    found = np.array([slope(integral, lead, place) for place in np.column_stack((x, 1.0 + width * (share - 0.5)))])
    along, across = np.abs(found - np.column_stack((np.full(200, rate), mode / np.tan(np.pi * share)))).T
    assert np.median(along) < off * rate
    assert np.quantile(along, 0.9) < 4.0 * off * rate
    assert np.median(across) < 0.02 * mode
    assert np.quantile(across, 0.9) < 0.1 * mode


@pytest.mark.parametrize("make", [around_corner, around_post])
@pytest.mark.parametrize(("b", "middling", "most"), [(0.15, 0.01, 0.04), (0.2, 0.02, 0.07), (0.3, 0.05, 0.15)])
def test_beside_a_reference_the_control_of_a_way_is_that_of_the_grid(make: Made, b, middling, most):
    """Relative error at random states (seed 0): its median, and what nine of ten stay below."""
    known = make(b)
    integral, lead = way(known)
    states = beside(known, 0)
    exact = known.truth.control(states) / b**2
    error = np.hypot(*(np.array([slope(integral, lead, x) for x in states]) - exact).T) / np.hypot(*exact.T)
    assert np.median(error) < middling
    assert np.quantile(error, 0.9) < most


@pytest.mark.parametrize("make", [around_corner, around_post])
@pytest.mark.parametrize("b", [0.15, 0.2, 0.3, 0.5])
def test_what_a_way_promises_is_log_psi_of_the_grid(make: Made, b):
    """Within 0.45 nats, of 10 to 90; less where psi falls faster than rooms are wide."""
    known = make(b)
    assert way(known)[1].promise == pytest.approx(known.truth.log_psi(known.x), abs=0.45 if b > 0.3 else 0.2)


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
        return math.exp(-drift * z) * (g * math.cosh(g * z) if g > 0.0 else 1.0) - drift * h(z)

    spread = B * math.sqrt(t)

    def density(z: float) -> float:
        return norm.pdf(z, c + away * t, spread) - math.exp(-2.0 * c * drift) * norm.pdf(z, -c + away * t, spread)

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
    def near(x: np.ndarray, s: float = 0.0) -> tuple[Any, ...]:
        known = [(c + receding * s, away) for c, away, receding in walls]
        return tuple(itertools.chain(*[*known, (np.inf, (0.0, 0.0)), (np.inf, (0.0, 0.0))][:2]))

    d = SimpleNamespace(B_c=lambda x: B * np.eye(2))
    gains = {"gain": lambda x: B**2 * np.eye(2), "gains": lambda x: np.eye(2)}
    drift = SimpleNamespace(walls=near, problem=SimpleNamespace(dynamics=d), **gains)
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
    scene = scene_of(
        [block("wall", 2.5, 0.4, (2.0, 0.3))], start=(0.6, 1.5), goal=(4.3, 1.6, 0.3), side=(5.0, 3.0), radius=0.2
    )
    problem, space, x = problem_in(scene, 0.2), FreeSpace.of(scene), np.array([2.5, 0.903])
    integral = path_integral(problem, space, Sampling(threads=1, first=0.01))
    climb = integral.proposals.climbing(x, np.array([[4.3, 1.6]]))
    found = integral.estimate(led(integral, x, integral.steps(6.0), climb, count=4000, seed=1))
    assert found.walls.clipped[1] == pytest.approx(0.04 * (1.0 / 0.003 - 1.0 / 0.004), rel=0.05)
    assert 1.0 < (Desirability.of(problem, space).control(x) - found.control)[1] < 1.2 * found.control_error[1]
