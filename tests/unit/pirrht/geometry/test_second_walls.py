"""The second wall is the nearest solid that stands in another direction than the nearest, whatever it joins."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from rooms import DOORWAY, room
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array, BoolArray
from pirrht.freespace import FreeSpace
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import REACH, interpolate, nearest_label
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Workspace
from pirrht.geometry.shapes import Solids, distance_from, offset_from
from pirrht.geometry.walls import APART_COSINE, RISE_SINE, stands_apart

GAP = 0.012  # the field tells at most this much less than the clearance in what follows [m]
HEIGHT = 0.12


def solid(kind: Kind, rng: np.random.Generator, tilted: bool) -> Obstacle:
    size = np.exp(rng.uniform(np.log(0.08), np.log(0.6), 3))
    vertices = faces = None
    if kind is Kind.MESH:
        corners = rng.uniform(-1, 1, (12, 3)) * size
        hull = ConvexHull(corners)
        vertices, faces = corners[hull.vertices], np.searchsorted(hull.vertices, hull.simplices)
    turn = Rotation.random(random_state=int(rng.integers(2**31)))
    return Obstacle(
        name=kind.value, kind=kind, size=size, position=np.array([*rng.uniform(0.5, 3.5, 2), HEIGHT]),
        rotation=turn.as_matrix() if tilted else np.eye(3), vertices=vertices, faces=faces,
    )  # fmt: skip


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


@pytest.mark.parametrize("tilted", [False, True], ids=["upright", "tilted"])
@pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.value)
def test_offsets_point_along_the_slope_of_the_distance(kind: Kind, tilted: bool) -> None:
    rng = np.random.default_rng(1)
    collision, points = among(*(solid(kind, rng, tilted) for _ in range(4))), rng.uniform(0, 4, (100, 2))
    forms = Solids.of(collision.world.obstacles)
    for m in range(4):
        d = np.array([distance_from(forms, m, *point, HEIGHT) for point in points])
        found = np.array([offset_from(forms, m, *point, HEIGHT) for point in points])
        out = d > 1e-3
        assert found[out] == pytest.approx((d[:, None] * slopes(collision, m, points))[out], abs=1e-4)
        assert out.sum() > 50


@pytest.mark.parametrize("reach", [0.5, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_both_walls_are_those_of_a_search_through_all_solids(seed: int, reach: float) -> None:
    rng = np.random.default_rng([3, seed])
    collision = among(*(solid(kind, rng, i % 2 == 0) for i, kind in enumerate([*Kind, *Kind])))
    points = rng.uniform(0, 4, (300, 2))
    found = collision.nearest_walls(points, range(12), reach)
    first, second, sure = expected(collision, points, reach)
    assert found.first == pytest.approx(first, abs=1e-5)
    assert found.second[sure] == pytest.approx(second[sure], abs=1e-5)
    assert sure.sum() > 60
    assert np.any(second[sure] < reach)


def test_solids_that_do_not_count_are_ignored() -> None:
    rng = np.random.default_rng(4)
    solids = [solid(kind, rng, True) for kind in [*Kind, *Kind]]
    points = rng.uniform(0, 4, (200, 2))
    some = among(*solids).nearest_walls(points, [1, 4, 5, 9], 1.0)
    alone = among(*(solids[i] for i in (1, 4, 5, 9))).nearest_walls(points, range(4), 1.0)
    assert np.array_equal(some.first, alone.first)
    assert np.array_equal(some.second, alone.second)
    assert np.array_equal(some.which, np.array([1, 4, 5, 9, -1])[alone.which])


def test_where_no_solid_is_near_no_wall_is_known() -> None:
    found = among(solid(Kind.SPHERE, np.random.default_rng(5), False)).nearest_walls(np.full((1, 2), 40.0), [0], 1.0)
    assert [part.tolist() for part in found] == [[1.0], [1.0], [-1], [[0.0, 0.0]], [1.0]]
    none = among().nearest_walls(np.full((1, 2), 1.0), [], 1.0)
    assert none.which.tolist() == [-1]


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


def test_facing_walls_match_up_across_the_middle() -> None:
    """The wall that is nearest on one side of the middle is the second on the other."""
    space, x = doorway(), 3.4
    y = np.concatenate([np.linspace(2.36, 2.49, 40), np.linspace(2.51, 2.64, 40)])
    nearest, second = of_field(space, np.column_stack([np.full(80, x), y]))
    below = y < 2.5
    assert np.where(below, nearest, second) == pytest.approx(y - 2.25 - 0.1, abs=GAP)
    assert np.where(below, second, nearest) == pytest.approx(2.75 - 0.1 - y, abs=GAP)
    labels = [nearest_label(space.field, x, each) for each in y]
    assert labels == [1] * 40 + [0] * 40


def test_boxes_in_line_are_one_wall() -> None:
    """However far along the wall the next box begins, and though the boxes meet only within a millimetre."""
    space = room((1.0, 2.0, 1.6, 2.3), (1.6, 2.0, 2.2, 2.301), (2.2, 2.0, 2.5, 2.299), (2.5, 2.0, 4.5, 2.3))
    points = np.column_stack([np.linspace(1.05, 4.45, 200), np.full(200, 2.48)])
    nearest, second = of_field(space, points)
    assert nearest == pytest.approx(np.full(200, 0.08), abs=GAP)
    assert np.all(second > REACH - 2 * GAP)


def test_a_concave_corner_is_two_walls() -> None:
    space = room((1.0, 1.0, 4.0, 1.3), (1.0, 1.3, 1.3, 4.0))
    points = np.random.default_rng(6).uniform([1.45, 1.45], [1.8, 1.8], (200, 2))
    nearest, second = of_field(space, points)
    exact = np.sort(points - 1.3 - 0.1, axis=1)
    assert np.all(nearest <= exact[:, 0] + 1e-6)
    assert np.all(nearest > 0.75 * exact[:, 0] - GAP)  # coarse where both are equally far
    assert second == pytest.approx(exact[:, 1], abs=GAP)


def test_a_convex_corner_is_one_wall() -> None:
    space = room((1.0, 1.0, 2.0, 2.0))
    _, second = of_field(space, np.random.default_rng(7).uniform(0.5, 2.5, (100, 2)))
    assert np.all(second > REACH - 2 * GAP)


def test_directions_a_sixth_of_a_turn_apart_are_two() -> None:
    for angle, two in ((0.0, False), (55.0, False), (65.0, True), (120.0, True), (180.0, True)):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        assert stands_apart(1.2 * c, 1.2 * s, 1.0, 0.0) == two
    assert stands_apart(0.0, 0.0, 1.0, 0.0)
    assert stands_apart(1.0, 0.0, 0.0, 0.0)


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
