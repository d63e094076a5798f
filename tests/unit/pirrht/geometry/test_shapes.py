"""Closed forms agree with FCL, and what they spare FCL changes no distance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pirrht.geometry.collision import PROBE, Collision
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from pirrht.geometry.shapes import FORMS, Solids, distance_from, tiles

HEIGHT = 0.12


def scene(kinds: list[Kind], seed: int) -> Scene:
    """Solids of the given kinds, tilted, some upright."""
    rng = np.random.default_rng(seed)
    obstacles = tuple(
        Obstacle(
            name=f"{kind.value}{i}", kind=kind, size=np.exp(rng.uniform(np.log(0.08), np.log(0.6), 3)),
            position=np.array([*rng.uniform(0.8, 3.2, 2), 0.1 + rng.uniform(-0.2, 0.2)]),
            rotation=np.eye(3) if i % 3 == 0 else Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(),
        )
        for i, kind in enumerate(kinds)
    )  # fmt: skip
    return Scene(
        name="solids", lower=np.zeros(2), upper=np.full(2, 4.0), obstacles=obstacles, start=np.full(3, 0.05),
        goal=Goal(center=np.full(2, 3.9), radius=0.1), robot_radius=HEIGHT,
    )  # fmt: skip


def checker(of: Scene) -> Collision:
    return Collision(of.world, of.footprint)


@pytest.mark.parametrize("kind", FORMS, ids=lambda kind: kind.value)
def test_closed_forms_are_the_distances_that_fcl_finds(kind: Kind) -> None:
    where = scene([kind] * 12, 1)
    collision, points = checker(where), np.random.default_rng(2).uniform(-1, 5, (300, 2))
    solids = Solids.of(where.obstacles)
    inside = 0
    for m in range(12):
        found = np.array([distance_from(solids, m, *point, where.robot_height) for point in points])
        exact = collision.obstacle_distance(m, points)
        np.testing.assert_allclose(np.where(found > PROBE, found, 0.0), exact, atol=1e-12)
        inside += int(np.sum(exact == 0.0))
    assert inside > 10


def test_fcl_is_asked_little_about_solids_with_a_closed_form_and_always_about_others() -> None:
    points = np.random.default_rng(5).uniform(0, 4, (2000, 2))
    asked = []
    for kind in (Kind.CYLINDER, Kind.ELLIPSOID):
        collision = checker(scene([kind] * 5, 6))
        collision.nearest_walls(points, range(5), 1.0)
        asked.append(collision.calls)
    assert asked[0] <= 5 * 16
    assert asked[1] > 1000


def test_a_closed_form_that_fcl_contradicts_is_not_used() -> None:
    collision = checker(scene([Kind.BOX, Kind.SPHERE], 7))
    collision._forms.size[0] *= 1.01
    points = np.random.default_rng(8).uniform(0, 4, (200, 2))
    first = collision.nearest_walls(points, range(2), 1.0).first
    expected = np.min([collision.obstacle_distance(m, points) for m in range(2)], axis=0)
    np.testing.assert_allclose(first, np.minimum(expected, 1.0), atol=1e-9)
    assert list(collision._confirmed) == [False, True]


def test_tiles_hold_every_point_once() -> None:
    points = np.random.default_rng(9).uniform(-3, 7, (500, 2))
    rows = []
    for part, low, high in tiles(points, 0.7):
        assert np.all((points[part] >= low) & (points[part] <= high))
        assert np.all(high - low <= 0.7 + 1e-12)
        rows += part.tolist()
    assert sorted(rows) == list(range(500))
    assert not list(tiles(np.zeros((0, 2)), 1.0))
