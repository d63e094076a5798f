"""Distances from solids agree with FCL."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tilted import solid as tilted_solid

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision, solid_of
from pirrht.geometry.scene import Footprint, Goal, Kind, Obstacle, Scene, Workspace
from pirrht.geometry.shapes import PROBE

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
        goal=Goal(center=np.full(2, 3.9), radius=0.1), robot_radius=HEIGHT, robot_height=HEIGHT,
    )  # fmt: skip


def sphere(point: Array) -> fcl.CollisionObject:
    return fcl.CollisionObject(fcl.Sphere(PROBE), fcl.Transform(np.append(point, HEIGHT)))


@pytest.mark.parametrize("kind", [Kind.BOX, Kind.CYLINDER, Kind.SPHERE, Kind.CAPSULE], ids=lambda kind: kind.value)
def test_closed_forms_are_the_distances_that_fcl_finds(kind: Kind) -> None:
    where = scene([kind] * 12, 1)
    collision, points = Collision(where.world, where.footprint), np.random.default_rng(2).uniform(-1, 5, (300, 2))
    inside = 0
    for m, obstacle in enumerate(where.obstacles):
        solid = solid_of(obstacle)
        exact = np.array([PROBE + fcl.distance(sphere(point), solid) for point in points])
        exact = np.where(exact > PROBE, exact, 0.0)
        np.testing.assert_allclose(collision.obstacle_distance(m, points), exact, atol=1e-12)
        inside += int(np.sum(exact == 0.0))
    assert inside > 10


@pytest.mark.parametrize("kind", [Kind.ELLIPSOID, Kind.MESH], ids=lambda kind: kind.value)
@pytest.mark.parametrize("seed", range(3))
def test_a_ball_of_the_distance_just_touches(kind: Kind, seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacle = tilted_solid(kind, "solid", rng.uniform(1.0, 3.0, 2), rng)
    body, collision = (
        solid_of(obstacle),
        Collision(Workspace(np.zeros(2), np.full(2, 4.0), (obstacle,)), Footprint(HEIGHT, HEIGHT)),
    )
    points = rng.uniform(0, 4, (300, 2))

    def hits(point: Array, radius: float) -> bool:
        ball = fcl.CollisionObject(fcl.Sphere(radius), fcl.Transform(np.append(point, HEIGHT)))
        return fcl.collide(ball, body) > 0

    found = collision.obstacle_distance(0, points)
    for point, d in zip(points, found, strict=True):
        assert hits(point, d + 1e-5)
        assert d < 1e-5 or not hits(point, d - 1e-5)
