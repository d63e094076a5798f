"""The clearance field never claims more room than FCL finds, nor much less; what it certifies FCL confirms."""

from __future__ import annotations

import numpy as np
import pytest
from tilted import RADIUS, cluttered

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import BLOCKED, FREE, UNSURE, certify_curve, certify_segment
from pirrht.geometry.field import clearance
from pirrht.geometry.scene import Kind

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
    exact, found = space.collision.clearance(points), field_at(space, points)
    near = (exact > -0.5 * RADIUS) & (exact < 2 * h)
    lost = (exact - found)[near]
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
    verdict = np.array([certify_segment(space.field, *a, *b) for a, b in zip(tails, heads, strict=True)])
    free = space.collision.segments_free(tails, heads)
    assert np.all(free[verdict == FREE])
    assert not np.any(free[verdict == BLOCKED])
    assert np.mean(verdict[free] == FREE) > 0.95
    assert {FREE, BLOCKED, UNSURE} == set(verdict)


def test_a_certified_arc_is_free_by_fcl_at_every_point():
    space = cluttered(None)
    rng = np.random.default_rng(7)
    certified = 0
    for start in points_in(space, 800, 8):
        kappa, length = rng.uniform(-3, 3), rng.uniform(0.1, 1.5)
        pose = np.array([*start, rng.uniform(-np.pi, np.pi)])
        if certify_curve(space.field, pose, np.array([kappa]), np.array([length])) != FREE:
            continue
        certified += 1
        s = np.linspace(0, length, 60)
        heading = pose[2] + kappa * s
        arc = start + np.column_stack([np.sin(heading) - np.sin(pose[2]), np.cos(pose[2]) - np.cos(heading)]) / kappa
        assert np.all(space.collision.clearance(arc) > 0)
    assert certified > 100
