"""Grid points that all but touch a wall: psi there, and around, is that of an independent solution."""

import discs
import numpy as np
import pytest
from benchmarks.scenes import scene_of
from discs import disc
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu
from thoroughly import thorough

from pirrht import Desirability, FreeSpace, Problem, Scene, SingleIntegrator
from pirrht.exact.grid import Domain


def beside_a_disc() -> Scene:
    """A grid point of the default spacing at b = 0.1 lies 9 micrometers off the disc, at (3.73, 2.37)."""
    post = disc("disc", 3.27335, 2.928797, 0.515644)
    return discs.scene_of([post], start=(0.703, 0.895), goal=(4.347, 2.948, 0.18), side=5.0, radius=0.206)


def exact(scene: Scene, b: float, spacing: float | None = None) -> Desirability:
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2))
    return Desirability.of(problem, FreeSpace.of(scene), spacing=spacing)


def differences(domain: Domain, b: float, lower: np.ndarray, upper: np.ndarray, h: float) -> np.ndarray:
    """log psi by five-point differences with unequal arms (Shortley and Weller) at the points of a box, (nx, ny)."""
    nx, ny = np.rint((upper - lower) / h).astype(int) + 1
    points = lower + h * np.stack(np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"), axis=-1)
    wall = domain.clearance(points.reshape(-1, 2)).reshape(nx, ny)
    wall[[0, -1]], wall[:, [0, -1]] = np.minimum(wall[[0, -1]], 0.0), np.minimum(wall[:, [0, -1]], 0.0)
    rim = np.hypot(*np.moveaxis(points - domain.goal.center, -1, 0)) - domain.goal.radius
    free = (wall > 1e-9) & (rim > 1e-9)
    i, j = np.nonzero(free)
    number = np.full((nx, ny), -1)
    number[free] = np.arange(len(i))
    arm, ends, inner = np.full((4, len(i)), h), np.zeros((4, len(i))), np.zeros((4, len(i)), dtype=int)
    for a, (di, dj) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        inner[a] = number[i + di, j + dj]
        for gap, value in ((wall, 0.0), (rim, 1.0)):
            tail, head = gap[i, j], gap[i + di, j + dj]
            length = np.where(head <= 1e-9, h * tail / np.where(head <= 1e-9, tail - head, 1.0), np.inf)
            nearer = (inner[a] < 0) & (length < arm[a] + 1e-12)
            arm[a][nearer], ends[a][nearer] = np.maximum(length[nearer], 1e-9), value
    weight = 2.0 / (arm * np.repeat(arm[::2] + arm[1::2], 2, axis=0))
    rows = np.tile(np.arange(len(i)), (4, 1))
    diagonal = weight.sum(axis=0) + b**-4
    known = (weight * ends * (inner < 0)).sum(axis=0) / diagonal
    entries, at = -(weight / diagonal)[inner >= 0], (rows[inner >= 0], inner[inner >= 0])
    one = np.arange(len(i))
    matrix = csc_matrix((np.append(entries, np.ones(len(i))), (np.append(at[0], one), np.append(at[1], one))))
    log_psi = np.full((nx, ny), -1e9)
    log_psi[free] = np.log(np.maximum(splu(matrix, permc_spec="MMD_AT_PLUS_A").solve(known), 1e-300))
    return log_psi


@pytest.mark.parametrize(
    ("which", "b", "h", "lower", "upper"),
    [
        ("disc", 0.1, 0.005, [3.5, 2.1], [4.65, 3.25]),
        thorough("0", 0.2, 0.0125, [0.0, 0.0], [5.0, 5.0]),
        thorough("13", 0.2, 0.0125, [0.0, 0.0], [5.0, 5.0]),
    ],
)
def test_where_grid_points_touch_walls_the_value_is_that_of_finite_differences(which, b, h, lower, upper):
    """Differences at two spacings, extrapolated; the grid is right to 0.5 % of v or 0.001."""
    scene = beside_a_disc() if which == "disc" else scene_of(int(which))
    grid = exact(scene, b)
    low, high, domain = np.array(lower), np.array(upper), Domain.of(grid.space)
    coarse, fine = (differences(domain, b, low, high, step) for step in (h, 0.5 * h))
    log_psi = (4.0 * fine[::2, ::2] - coarse) / 3.0
    points = low + h * np.stack(np.indices(coarse.shape), axis=-1)
    inside = np.min(np.minimum(points - low, high - points), axis=-1) > (0.1 if which == "disc" else 0.0)
    clear = domain.clearance(points.reshape(-1, 2)).reshape(coarse.shape)
    rim = np.hypot(*np.moveaxis(points - scene.goal.center, -1, 0)) - scene.goal.radius
    asked = np.argwhere(inside & (clear > h) & (rim > h) & (log_psi > -600.0))
    asked = asked[np.random.default_rng(0).permutation(len(asked))[:3000]]
    assert grid.value(low + h * asked) == pytest.approx(-2.0 * b**2 * log_psi[tuple(asked.T)], rel=0.005, abs=0.001)
