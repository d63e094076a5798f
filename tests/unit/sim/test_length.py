"""The length of a noisy path: that of the way it is driven along, however finely it is looked at."""

from __future__ import annotations

import numpy as np
import pytest
from rooms import room

from pirrht.arrays import Array
from pirrht.problem import Problem
from pirrht.systems.single_integrator import SingleIntegrator
from pirrht.systems.unicycle import Unicycle
from sim.drive.odometer import Length

STEP, TIME = 0.002, 6.0
SCENE = room().scene


def point(b: float) -> Problem:
    return Problem(dynamics=SingleIntegrator(b=b), scene=SCENE, R=2.0 * np.eye(2), q=1.0)


def measured(problem: Problem, path: Array, step: float = STEP, period: int = 5) -> Length:
    """A path (k, n), start included, as a drive takes note of it, `period` steps at a time."""
    length = Length(problem, path[0])
    for i in range(0, len(path) - 1, period):
        part = path[i : i + period + 1]
        length.add(part[1:], step, float(np.hypot(*np.diff(part[:, :2], axis=0).T).sum()))
    return length


def noisy(way: Array, b: float, rng: np.random.Generator, step: float = STEP) -> Array:
    """A way (k, 2) with Brownian noise on it."""
    return way + b * np.sqrt(step) * np.vstack([np.zeros(2), rng.standard_normal((len(way) - 1, 2)).cumsum(axis=0)])


def straight(step: float = STEP) -> Array:
    along = np.arange(0.0, TIME + 0.5 * step, step)
    return np.column_stack([along, np.zeros_like(along)])


@pytest.mark.parametrize("b", [0.03, 0.1, 0.2, 0.3])
def test_a_straight_drive_is_as_long_as_its_mean_path_whatever_the_noise(b: float):
    rng, problem = np.random.default_rng(1), point(b)
    found = [measured(problem, noisy(straight(), b, rng)) for _ in range(60)]
    assert np.mean([one.total for one in found]) == pytest.approx(TIME, rel=0.03)
    assert np.mean([one.noisy for one in found]) > 1.2 * TIME  # what was told before


@pytest.mark.parametrize("b", [0.1, 0.3])
def test_a_way_with_corners_is_as_long_as_its_mean_path(b: float):
    rng, problem, way = np.random.default_rng(2), point(b), straight()
    third = TIME / 3
    x = np.minimum(way[:, 0], third) + np.maximum(way[:, 0] - 2 * third, 0.0)
    corners = np.column_stack([x, np.clip(way[:, 0] - third, 0.0, third)])
    found = [measured(problem, noisy(corners, b, rng)).total for _ in range(60)]
    assert np.mean(found) == pytest.approx(TIME, rel=0.05)


def test_without_noise_it_is_the_length_of_the_path():
    angle = np.linspace(0.0, 9.0, 4000)
    circle = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert measured(point(1e-6), circle).total == pytest.approx(4.5, rel=1e-5)


@pytest.mark.parametrize("finer", [2, 5])
def test_a_finer_physics_step_changes_the_noisy_length_only(finer: int):
    b, rng = 0.3, np.random.default_rng(3)
    step = STEP / finer
    fine = noisy(straight(step), b, rng, step)
    one, other = measured(point(b), fine, step), measured(point(b), fine[::finer])
    assert one.total == pytest.approx(other.total, rel=1e-9)
    assert one.noisy > 1.3 * other.noisy


@pytest.mark.parametrize("period", [1, 7, 50, 10_000])
def test_the_control_period_changes_nothing(period: int):
    path = noisy(straight(), 0.2, np.random.default_rng(4))
    assert measured(point(0.2), path, period=period).total == measured(point(0.2), path).total


def test_noise_that_turns_a_car_smooths_nothing():
    problem = Problem(dynamics=Unicycle(b=0.3), scene=SCENE, R=np.eye(1), phi=1000.0)
    path = np.random.default_rng(5).normal(size=(40, 3)).cumsum(axis=0)
    length = measured(problem, path)
    assert length.total == length.noisy == pytest.approx(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())


@pytest.mark.parametrize("seed", range(20))
def test_it_lies_between_the_distance_of_the_ends_and_the_noisy_length(seed: int):
    rng = np.random.default_rng(seed)
    b, count = float(rng.uniform(0.01, 1.0)), int(rng.integers(1, 900))
    path = noisy(straight()[: count + 1], b, rng)
    length = measured(point(b), path)
    assert np.hypot(*(path[-1] - path[0])) - 1e-12 <= length.total <= length.noisy + 1e-12


def test_a_drive_that_has_not_begun_has_no_length():
    length = Length(point(0.3), np.zeros(2))
    length.add(np.zeros((0, 2)), STEP, 0.0)
    assert length.total == length.noisy == 0.0
