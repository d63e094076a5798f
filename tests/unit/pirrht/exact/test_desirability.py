"""The grid against closed forms, against samples and against itself."""

import math
from functools import cache

import numpy as np
import pytest
from batches import led, still
from benchmarks import mass_line
from benchmarks.annulus import convergence
from benchmarks.mass_on_line import MassOnLine, mass_on_line
from discs import disc, scene_of
from thoroughly import first

from pirrht import (
    Desirability,
    FreeSpace,
    Obstacle,
    PirrhtError,
    Problem,
    Sampling,
    Scene,
    SingleIntegrator,
    Unicycle,
    path_integral,
)

START = np.array([1.0, 2.5])


def scene(*obstacles: Obstacle) -> Scene:
    return scene_of(obstacles, start=(0.5, 2.0), goal=(3.3, 2.0, 0.3), side=4.0, radius=0.15)


def post(x: float, y: float, radius: float) -> Obstacle:
    return disc(f"post {x:g}", x, y, radius)


def solved(scene: Scene, b: float, phi: float = np.inf, **options) -> Desirability:
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2), phi=phi)
    return Desirability.of(problem, FreeSpace.of(scene), **options)


@pytest.fixture(scope="module")
def through_slit(slit) -> dict[float, Desirability]:
    return {b: Desirability.of(slit.with_settings(noise=b).problem, slit.space) for b in (0.2, 0.3)}


@pytest.mark.parametrize(("noise", "spacing"), [(0.1, 0.01), (0.2, 0.02), (0.3, 0.02)])
def test_at_the_default_spacing_value_and_control_match_the_bessel_functions_of_an_annulus(noise, spacing):
    (row,) = convergence(noise, [spacing])
    assert row["value_error"] < 0.005
    assert row["control_error"] < 0.02


def test_the_error_of_the_control_falls_faster_than_the_spacing():
    assert all(row["order"] > 1.0 for row in convergence(0.15, [0.04, 0.028, 0.02])[1:])


def test_rounds_report_how_far_they_have_settled():
    shares: list[float] = []
    solved(scene(), 0.4, dt=0.2, spacing=0.1, progress=shares.append)
    assert len(shares) > 4
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < 0.2
    assert 0.8 < shares[-1] <= 1.0


def test_between_free_walls_psi_is_the_hyperbolic_cosine_of_an_interval():
    """phi = 0 at the border: far from goal and ends a strip is an interval, u* = (lambda/R) k tanh(k x)."""
    room = scene_of(start=(0.0, 3.5), goal=(0.0, 0.4), lower=(-0.5, 0.0), side=(0.5, 6.0))
    b, k = 0.4, 1.0 / 0.4**2
    grid = solved(room, b, phi=0.0)
    for x in (0.0, 0.2, -0.37, 0.49):
        exact = -2.0 * b**2 * math.log(math.cosh(k * x) / math.cosh(0.5 * k))
        assert grid.value(np.array([x, 3.5])) == pytest.approx(exact, rel=5e-3)
        assert grid.control(np.array([x, 3.5])) == pytest.approx([b**2 * k * math.tanh(k * x), 0.0], abs=2e-3)


def test_values_on_the_slit_are_those_of_an_independent_solution(through_slit):
    assert through_slit[0.2].value(START) == pytest.approx(8.825, abs=0.002)
    assert through_slit[0.3].value(START) == pytest.approx(9.535, abs=0.002)


def test_value_is_zero_in_the_goal_and_phi_in_a_wall(through_slit):
    grid = through_slit[0.3]
    assert (grid.value(np.array([5.5, 2.5])), grid.value(np.array([3.4, 2.8]))) == (0.0, math.inf)
    assert np.all(grid.control(np.array([5.5, 2.5])) == 0.0)
    finite = solved(scene(post(2.0, 2.0, 0.3)), 0.3, phi=5.0)
    assert finite.value(np.array([2.0, 2.0])) == pytest.approx(5.0)
    assert finite.value(np.array([0.001, 0.3])) == pytest.approx(5.0, abs=0.01)


def test_the_control_is_the_gradient_of_the_value(through_slit):
    """u = -R^-1 grad v with R = 2 I, by central differences."""
    grid, step = through_slit[0.3], 1e-4
    for x in np.random.default_rng(3).uniform([0.5, 0.5], [2.2, 4.5], (20, 2)):
        slope = [grid.value(x + step * e) - grid.value(x - step * e) for e in np.eye(2)]
        assert grid.control(x) == pytest.approx(-np.array(slope) / (4.0 * step), abs=0.02)


@pytest.mark.parametrize(
    ("dynamics", "rate", "options", "words"),
    [
        (Unicycle(b=0.03), {}, {}, "points 0.0087 m apart"),
        (Unicycle(b=0.3), {}, {"spacing": 0.1}, "points 0.087 m apart"),
        (Unicycle(b=0.3), {}, {"dt": 0.1}, "exit rule bridge"),
        (SingleIntegrator(b=0.02), {}, {}, "10000 x 10000 points"),
        (SingleIntegrator(), {}, {"dt": 1e-4}, "longer step dt"),
        (SingleIntegrator(), {}, {"spacing": -1.0}, "positive"),
        (SingleIntegrator(), {"q": lambda x, p: 1.0, "q_min": 1.0}, {}, "constant q"),
    ],
    ids=["car, little noise", "car, coarse", "car, steps", "puck, little noise", "short steps", "spacing", "q(x)"],
)
def test_what_no_grid_can_resolve_is_refused_with_the_grid_it_would_need(dynamics, rate, options, words):
    problem = Problem(dynamics=dynamics, scene=scene(), R=dynamics.m * np.eye(dynamics.m), **rate)
    with pytest.raises(PirrhtError, match=words) as refusal:
        Desirability.of(problem, FreeSpace.of(problem.scene), **options)
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
@pytest.mark.thorough
def test_judged_at_the_ends_of_steps_the_slit_looks_safer(slit, through_slit):
    """Independent: 9.452 and a share of 0.46 through the slit, against 9.535 and 0.05 in continuous time."""
    grid = Desirability.of(slit.with_settings(noise=0.3).problem, slit.space, dt=0.1)
    assert grid.value(START) == pytest.approx(9.452, abs=0.003)
    assert grid.shares(START, 2000)["0,0"] == pytest.approx(0.46, abs=4 * 0.011)
    assert through_slit[0.3].shares(START, 2000)["0,0"] == pytest.approx(0.048, abs=4 * 0.005)


@pytest.mark.slow
def test_the_discrete_solution_solves_its_own_equation():
    """psi(x) = exp(-q dt/lambda) E[psi(x + b dw)] by 200 000 draws, seed 0; four standard errors."""
    b, dt = 0.3, 0.1
    grid = solved(scene(post(2.0, 2.2, 0.3)), b, dt=dt)
    draws = np.random.default_rng(0).standard_normal((20_000, 2))
    for x in ([0.5, 2.0], [1.45, 2.1], [3.0, 2.4]):
        after = np.exp(grid.log_psi(np.array(x) + b * math.sqrt(dt) * draws) - grid.log_psi(np.array(x)) - dt / 0.18)
        assert after.mean() == pytest.approx(1.0, abs=4.0 * after.std() / math.sqrt(len(draws)))


@pytest.mark.slow
@pytest.mark.thorough
def test_the_value_of_a_car_agrees_with_samples():
    """10^5 passive paths each, seed 0: standard errors of 0.2 %; the grid has 1 % of its own."""
    room = scene(post(1.8, 2.2, 0.3), post(2.6, 1.2, 0.25))
    problem, space = Problem(dynamics=Unicycle(b=0.3), scene=room, R=np.eye(1)), FreeSpace.of(room)
    grid = Desirability.of(problem, space, spacing=0.04)
    sampler = path_integral(problem, space, Sampling(dt=0.05, guide="open-loop", samples=100_000))
    for x in ([0.5, 0.5, 0.8], [2.2, 1.7, 0.0], [2.5, 3.2, -2.0]):
        times = sampler.grid(4.0)
        estimate = sampler.estimate(led(sampler, np.array(x), times, still(times, 1), count=100_000, seed=0))
        error = problem.temperature / math.sqrt(estimate.ess)
        assert grid.value(np.array(x)) == pytest.approx(estimate.value, abs=0.01 * estimate.value + 4.0 * error)


Q, R = 1.0, 2.0


@cache
def solved_line(b: float, spacing: float = 0.01, fastest: float = 3.0, phi: float = np.inf) -> MassOnLine:
    return mass_on_line(b=b, q=Q, r=R, phi=phi, spacing=spacing, fastest=fastest)


@pytest.mark.slow
@pytest.mark.parametrize("b", first(mass_line.NOISES))
def test_the_value_that_samples_give_a_mass_is_the_grids(b):
    """At 20 random states within 1 %, 2000 samples each, seed 0."""
    truth, integral = solved_line(b, spacing=0.005), mass_line.sampler(b, threads=1)
    for p, v in mass_line.random_line_states(20, 0):
        assert mass_line.sampled(integral, p, v, 2000, 0).value == pytest.approx(truth.value(p, v), rel=0.01)
