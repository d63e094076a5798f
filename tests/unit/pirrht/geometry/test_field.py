"""The clearance field never claims more room than FCL finds, nor much less, for the first wall and for the second."""

from functools import cache

import numpy as np
import pytest
from rooms import DOORWAY, room
from tilted import RADIUS, cluttered, solid

from pirrht.arrays import Array, BoolArray
from pirrht.freespace import FreeSpace
from pirrht.geometry.collision import Collision
from pirrht.geometry.disc import certify_curve, certify_piece
from pirrht.geometry.field import REACH, clearance, interpolate
from pirrht.geometry.scene import Footprint, Kind, Workspace
from pirrht.geometry.space import BLOCKED, FREE, UNSURE
from pirrht.geometry.walls import APART_COSINE, RISE_SINE

ROUNDING = 1e-6  # the field is kept in single precision [m]
every_kind = pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.value)


def points_in(space: FreeSpace, count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(space.scene.lower, space.scene.upper, (count, 2))


def field_at(space: FreeSpace, points: Array) -> Array:
    return np.array([clearance(space.field, x, y) for x, y in points])


@every_kind
@pytest.mark.parametrize("seed", [0, 1])
def test_the_field_never_claims_more_room_than_fcl_finds(kind, seed):
    """Inside a solid, more than half a radius below the surface, it only has to stay negative."""
    space = cluttered(kind, seed)
    points = points_in(space, 1500, seed)
    exact, found = space.collision.clearance(points), field_at(space, points)
    tolerance = ROUNDING + (4e-6 if kind in (Kind.ELLIPSOID, Kind.MESH) else 0)
    shallow = exact > -0.5 * RADIUS
    assert np.all(found[shallow] <= exact[shallow] + tolerance)
    assert np.all(found[~shallow] < -0.4 * RADIUS)
    assert np.sum(exact < 0) > 20
    assert np.sum(exact > 0.2) > 20


@every_kind
def test_the_field_gives_little_room_away_near_the_surface(kind):
    """Twice the bound of interpolation, h^2 / (4 d) with d from the solid; one cell where two components meet."""
    space = cluttered(kind)
    h, points = space.field.spacing, points_in(space, 1500, 3)
    exact = space.collision.clearance(points)
    near = (exact > -0.5 * RADIUS) & (exact < 2 * h)
    lost = (exact - field_at(space, points))[near]
    assert near.sum() > 30
    assert np.median(lost) < 2 * h**2 / (4 * 0.5 * RADIUS)
    assert lost.max() < 1.5 * h


def test_the_border_is_exact_and_belongs_to_the_centre():
    space = cluttered(Kind.BOX)
    scene = space.scene
    for y in np.linspace(scene.lower[1] + 0.01, scene.upper[1] - 0.01, 7):
        assert clearance(space.field, scene.lower[0] + 0.005, y) == pytest.approx(0.005)
        assert clearance(space.field, scene.lower[0] - 0.3, y) == pytest.approx(-0.3)
        assert clearance(space.field, scene.upper[0] + 0.2, y) == pytest.approx(-0.2)


@pytest.mark.parametrize("seed", range(3))
def test_what_the_field_says_of_a_segment_fcl_confirms(seed):
    space = cluttered(None, seed)
    rng = np.random.default_rng(10 + seed)
    tails = points_in(space, 1200, 20 + seed)
    heads = tails + rng.normal(0, 0.7, tails.shape)
    verdict = np.array([certify_piece(space.static, tuple(a), tuple(b)) for a, b in zip(tails, heads, strict=True)])
    free = space.collision.segments_free(tails, heads)
    assert np.all(free[verdict == FREE])
    assert not np.any(free[verdict == BLOCKED])
    assert np.mean(verdict[free] == FREE) > 0.95
    assert {FREE, BLOCKED, UNSURE} == set(verdict)


def test_a_certified_arc_is_free_by_fcl_at_every_point():
    space = cluttered(None)
    rng, certified = np.random.default_rng(7), 0
    for start in points_in(space, 800, 8):
        kappa, length = rng.uniform(-3, 3), rng.uniform(0.1, 1.5)
        pose = np.array([*start, rng.uniform(-np.pi, np.pi)])
        if certify_curve(space.static, pose, np.array([kappa]), np.array([length])) != FREE:
            continue
        certified += 1
        heading = pose[2] + kappa * np.linspace(0, length, 60)
        arc = start + np.column_stack([np.sin(heading) - np.sin(pose[2]), np.cos(pose[2]) - np.cos(heading)]) / kappa
        assert np.all(space.collision.clearance(arc) > 0)
    assert certified > 100


GAP = 0.012  # the field tells at most this much less than the clearance in what follows [m]
HEIGHT = 0.12


def slopes(collision: Collision, m: int, points: Array) -> Array:
    """Planar gradients of the distance from one solid, (k, 2)."""
    h = 1e-6 * np.eye(2)
    ahead, back = ([collision.obstacle_distance(m, points + step) for step in side] for side in (h, -h))
    return (np.subtract(ahead, back) / 2e-6).T


def expected(collision: Collision, points: Array, reach: float) -> tuple[Array, Array, BoolArray]:
    """Distances of the two walls of k points, and where neither kind of rounding decides which they are, 3 x (k,)."""
    count = range(len(collision.world.obstacles))
    distances = np.array([collision.obstacle_distance(m, points) for m in count])  # (M, k)
    away = distances[..., None] * np.array([slopes(collision, m, points) for m in count])  # from nearest points
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


@pytest.mark.parametrize("reach", [0.5, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_both_walls_are_those_of_a_search_through_all_solids(seed: int, reach: float) -> None:
    rng = np.random.default_rng([3, seed])
    solids = tuple(solid(kind, kind.value, rng.uniform(0.5, 3.5, 2), rng) for kind in [*Kind, *Kind])
    collision = Collision(Workspace(np.zeros(2), np.full(2, 4.0), solids), Footprint.disc(HEIGHT, height=HEIGHT))
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
    field = space.field
    for grid, exact in ((field.nearest, jambs.min(axis=1)), (field.second, jambs.max(axis=1))):
        found = np.array([interpolate(field, grid, x, y) for x, y in points])
        assert np.all(found <= exact - 0.1 + 1e-6)
        assert np.all(found > exact - 0.1 - GAP)


def test_the_field_tells_no_more_of_the_second_wall_than_there_is() -> None:
    """Further off, its clearance is known on coarser grids; a few points are beside one where another wall counts."""
    space = doorway()
    (nearest, second, label) = space.field.held.values()
    rows = np.argwhere((nearest > 0.005) & (nearest < 0.1))[::17]
    _, exact, sure = expected(space.collision, space.scene.lower + rows * space.field.spacing, REACH + 0.1)
    at, exact = tuple(rows[sure].T), exact[sure] - 0.1
    assert np.all(second[at] <= exact + 2e-3)
    assert np.mean(second[at] > exact - GAP) > 0.97
    assert sure.sum() > 300
    assert set(label[at]) == {0, 1, 2, 3, 4}
