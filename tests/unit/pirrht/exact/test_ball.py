"""psi of a point in space, from a grid: closed forms, and rooms whose value is known from finer grids."""

from types import SimpleNamespace

import numpy as np
import pytest

from pirrht.arrays import Array
from pirrht.exact.ball import Lattice, evaluate, solve, weights_of
from pirrht.exact.grid import Domain

GOAL, RIM, RADIUS = np.array([5.2, 2.0, 1.0]), 0.3, 0.2  # centre and radius of the goal, radius of the robot [m]
WALL = (((2.9, 0, 0), (3.1, 4, 0.65)), ((2.9, 0, 1.35), (3.1, 4, 2.2)))
FRAME = (((2.9, 0, 0.65), (3.1, 1.65, 1.35)), ((2.9, 2.35, 0.65), (3.1, 4, 1.35)))
SHUTTER = (((2.9, 1, 0.5), (3.1, 3, 1.5)),)


def room(boxes: tuple, size: tuple = (6.0, 4.0, 3.0), lower: float = 0.0) -> Domain:
    """A room of boxes, grown by the robot's radius."""

    def clearance(points: Array) -> Array:
        found = np.minimum((points - lower).min(axis=1), (np.array(size) - points).min(axis=1)) - RADIUS
        for low, high in boxes:
            outside = np.maximum(np.maximum(np.array(low) - points, points - np.array(high)), 0.0)
            found = np.minimum(found, np.linalg.norm(outside, axis=1) - RADIUS)
        return found

    goal = SimpleNamespace(center=GOAL, radius=RIM)
    return Domain(lower=np.full(3, lower), upper=np.array(size), goal=goal, clearance=clearance)


def log_psi(grid: Lattice, x: Array) -> tuple[float, Array]:
    slope = np.zeros(3)
    return evaluate(grid, np.asarray(x, dtype=float), slope), slope


@pytest.mark.parametrize("kh", [0.05, 0.3, 0.8])
def test_the_sum_over_neighbours_is_exact_for_exponentials_of_all_directions(kh):
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
    weights = np.array([0.0, *weights_of(kh)])[np.sum(steps**2, axis=1)]
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    sums = np.exp(kh * steps @ directions.T).T @ weights
    assert weights.min() >= 0.0
    assert np.abs(sums - 1.0).max() < 1e-4 * kh**8


@pytest.mark.slow
def test_in_the_open_psi_falls_like_a_spherical_wave():
    """Walls are so far away that they take less than 1 % of it."""
    k = 8.0
    around = Domain(
        lower=GOAL - 0.95, upper=GOAL + 0.95, goal=SimpleNamespace(center=GOAL, radius=RIM),
        clearance=lambda points: 0.95 - np.abs(points - GOAL).max(axis=1),
    )  # fmt: skip
    grid = solve(around, wavenumber=k, wall=np.inf, spacing=0.04)
    rng = np.random.default_rng(1)
    for _ in range(20):
        away = rng.normal(size=3)
        away *= rng.uniform(0.42, 0.6) / np.linalg.norm(away)
        r = float(np.linalg.norm(away))
        found, slope = log_psi(grid, GOAL + away)
        assert found == pytest.approx(np.log(RIM / r) - k * (r - RIM), abs=0.02)
        assert slope == pytest.approx(-(k + 1.0 / r) * away / r, abs=0.02 * k)


@pytest.mark.parametrize(
    ("boxes", "b", "value"),
    [
        (WALL + FRAME, 0.35, 10.45),
        pytest.param(WALL + FRAME, 0.5, 13.92, marks=pytest.mark.slow),
        pytest.param(WALL + FRAME + SHUTTER, 0.35, 11.961, marks=pytest.mark.slow),
    ],
)
def test_values_of_a_window_and_of_a_closed_one_are_those_of_finer_grids(boxes, b, value):
    """They are known to 0.2 %; this grid has three points across the window."""
    grid = solve(room(boxes), wavenumber=1.0 / b**2, wall=np.inf, spacing=0.08)
    assert -2.0 * b * b * log_psi(grid, [0.8, 2.0, 1.0])[0] == pytest.approx(value, rel=5e-3)


def test_psi_falls_with_the_price_of_collisions_and_is_one_where_they_are_free_and_time_is():
    dear, cheap = (solve(room(WALL), wavenumber=8.0, wall=wall, spacing=0.15) for wall in (6.0, 3.0))
    free = dear.row != -2
    assert np.all(dear.log_psi[free] < cheap.log_psi[free] + 1e-5)
    assert cheap.log_psi.max() <= 0.0
    nothing = solve(room(WALL), wavenumber=1e-3, wall=0.0, spacing=0.15)
    assert np.abs(nothing.log_psi[free]).max() < 1e-4
