"""The second wall is the nearest solid that stands in another direction than the nearest, whatever it joins."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from rooms import DOORWAY, room
from tilted import solid

from pirrht.arrays import Array, BoolArray
from pirrht.freespace import FreeSpace
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import REACH, interpolate
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Workspace
from pirrht.geometry.walls import APART_COSINE, RISE_SINE

GAP = 0.012  # the field tells at most this much less than the clearance in what follows [m]
HEIGHT = 0.12


def among(*obstacles: Obstacle) -> Collision:
    return Collision(Workspace(np.zeros(2), np.full(2, 4.0), obstacles), Footprint(HEIGHT, HEIGHT))


def slopes(collision: Collision, m: int, points: Array) -> Array:
    """Planar gradients of the distance from one solid, (k, 2)."""
    h = 1e-6
    ahead, back = (
        np.array([collision.obstacle_distance(m, points + sign * h * axis) for axis in np.eye(2)]) for sign in (1, -1)
    )
    return ((ahead - back) / (2 * h)).T


def vectors(collision: Collision, points: Array) -> tuple[Array, Array]:
    """Distances (M, k) [m] of all solids and vectors (M, k, 2) from their nearest points [m], by FCL's distances."""
    count = len(collision.world.obstacles)
    distances = np.array([collision.obstacle_distance(m, points) for m in range(count)])
    return distances, distances[..., None] * np.array([slopes(collision, m, points) for m in range(count)])


def expected(collision: Collision, points: Array, reach: float) -> tuple[Array, Array, BoolArray]:
    """Distances of the two walls of k points, and where neither kind of rounding decides which they are, 3 x (k,)."""
    distances, away = vectors(collision, points)
    which, columns = np.argmin(distances, axis=0), np.arange(len(points))
    first, a = distances[which, columns], away[which, columns]
    along, lengths = np.sum(away * a, axis=-1), np.linalg.norm(away, axis=-1) * np.linalg.norm(a, axis=-1)
    square = np.sum(a * a, axis=-1)
    between = np.linalg.norm(a - away, axis=-1)
    margin = np.maximum(along - APART_COSINE * lengths, along - square + RISE_SINE * np.sqrt(square) * between)
    counts = (margin < 0) | (along <= 0) | (distances == 0)
    counts[which, columns] = False
    second = np.where(counts, distances, np.inf).min(axis=0)
    rough = (np.abs(margin) < 0.02 * lengths) & (distances > 0)
    rough[which, columns] = False
    order = np.sort(distances, axis=0)
    sure = ~rough.any(axis=0) & (order[1] - order[0] > 1e-3) & (first > 0.02)
    return np.minimum(first, reach), np.where(first < reach, np.minimum(second, reach), reach), sure


def of_field(space: FreeSpace, points: Array) -> tuple[Array, Array]:
    field = space.field
    both = [[interpolate(field, grid, x, y) for x, y in points] for grid in (field.nearest, field.second)]
    return np.array(both[0]), np.array(both[1])


@pytest.mark.parametrize("reach", [0.5, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_both_walls_are_those_of_a_search_through_all_solids(seed: int, reach: float) -> None:
    rng = np.random.default_rng([3, seed])
    collision = among(*(solid(kind, kind.value, rng.uniform(0.5, 3.5, 2), rng) for kind in [*Kind, *Kind]))
    points = rng.uniform(0, 4, (300, 2))
    found = collision.nearest_walls(points, range(12), reach)
    first, second, sure = expected(collision, points, reach)
    assert found.first == pytest.approx(first, abs=1e-5)
    assert found.second[sure] == pytest.approx(second[sure], abs=1e-5)
    assert sure.sum() > 60
    assert np.any(second[sure] < reach)


@cache
def doorway() -> FreeSpace:
    return room(*DOORWAY)


def test_both_jambs_of_a_doorway_count_although_they_join() -> None:
    space = doorway()
    assert len(space.obstacles) == 1
    points = np.array([[3.2, 2.5], [3.4, 2.5], [3.4, 2.45], [3.65, 2.6]])
    jambs = np.abs(points[:, 1:] - [2.25, 2.75])
    nearest, second = of_field(space, points)
    for found, exact in ((nearest, jambs.min(axis=1)), (second, jambs.max(axis=1))):
        assert np.all(found <= exact - 0.1 + 1e-6)
        assert np.all(found > exact - 0.1 - GAP)


def test_the_field_tells_no_more_of_the_second_wall_than_there_is() -> None:
    """Further off, its clearance is known on coarser grids; a few points are beside one where another wall counts."""
    space = doorway()
    field, (nearest, second, label) = space.field, space.field.arrays
    rows = np.argwhere((nearest > 0.005) & (nearest < 0.1))[::17]
    _, exact, sure = expected(space.collision, space.scene.lower + rows * field.spacing, REACH + 0.1)
    at, exact = tuple(rows[sure].T), exact[sure] - 0.1
    assert np.all(second[at] <= exact + 2e-3)
    assert np.mean(second[at] > exact - GAP) > 0.97
    assert sure.sum() > 300
    assert set(label[at]) == {0, 1, 2, 3, 4}
