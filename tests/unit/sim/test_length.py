"""The length of a noisy path: that of the path it is driven along, however fine its steps are."""

import numpy as np
import pytest
from rooms import room

from pirrht import Problem, SingleIntegrator
from sim.drive.metrics import Length

STEP, TIME = 0.002, 6.0
SCENE = room().scene


def point(b: float) -> Problem:
    return Problem(dynamics=SingleIntegrator(b=b), scene=SCENE, R=2.0 * np.eye(2), q=1.0)


def measured(problem: Problem, path: np.ndarray, step: float = STEP, period: int = 5) -> Length:
    """A path (k, n), start included, as a run takes note of it, `period` steps at a time."""
    length = Length(path[0])
    for i in range(0, len(path) - 1, period):
        part = path[i : i + period + 1]
        length.add(problem, part[1:], step, float(np.hypot(*np.diff(part[:, :2], axis=0).T).sum()))
    return length


def noisy(path: np.ndarray, b: float, rng: np.random.Generator, step: float = STEP) -> np.ndarray:
    """A path (k, 2) with Brownian noise on it."""
    return path + b * np.sqrt(step) * np.vstack([np.zeros(2), rng.standard_normal((len(path) - 1, 2)).cumsum(axis=0)])


def straight(step: float = STEP) -> np.ndarray:
    along = np.arange(0.0, TIME + 0.5 * step, step)
    return np.column_stack([along, np.zeros_like(along)])


def cornered() -> np.ndarray:
    along, third = straight()[:, 0], TIME / 3
    x = np.minimum(along, third) + np.maximum(along - 2 * third, 0.0)
    return np.column_stack([x, np.clip(along - third, 0.0, third)])


@pytest.mark.parametrize(
    ("b", "path", "seed", "off"),
    [(0.03, straight(), 1, 0.03), (0.3, straight(), 1, 0.03), (0.3, cornered(), 2, 0.05)],
)
def test_a_path_is_as_long_as_its_mean_whatever_the_noise(b: float, path: np.ndarray, seed: int, off: float):
    rng, problem = np.random.default_rng(seed), point(b)
    lengths = [measured(problem, noisy(path, b, rng)) for _ in range(60)]
    assert np.mean([one.total for one in lengths]) == pytest.approx(TIME, rel=off)
    assert np.mean([one.noisy for one in lengths]) > 1.2 * TIME


def test_without_noise_it_is_the_length_of_the_path():
    angle = np.linspace(0.0, 9.0, 4000)
    circle = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert measured(point(1e-6), circle).total == pytest.approx(4.5, rel=1e-5)


@pytest.mark.parametrize(("finer", "period"), [(2, 1), (5, 10_000)])
def test_a_finer_physics_step_changes_the_noisy_length_only_and_the_control_period_nothing(finer: int, period: int):
    step = STEP / finer
    fine = noisy(straight(step), 0.3, np.random.default_rng(3), step)
    one, other = measured(point(0.3), fine, step), measured(point(0.3), fine[::finer])
    assert measured(point(0.3), fine, step, period).total == one.total
    assert one.total == pytest.approx(other.total, rel=1e-9)
    assert one.noisy > 1.3 * other.noisy


@pytest.mark.parametrize("seed", range(20))
def test_it_lies_between_the_distance_of_the_ends_and_the_noisy_length(seed: int):
    rng = np.random.default_rng(seed)
    b, count = float(rng.uniform(0.01, 1.0)), int(rng.integers(1, 900))
    path = noisy(straight()[: count + 1], b, rng)
    length = measured(point(b), path)
    assert np.hypot(*(path[-1] - path[0])) - 1e-12 <= length.total <= length.noisy + 1e-12
