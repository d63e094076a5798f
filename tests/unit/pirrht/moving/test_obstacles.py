"""What kernels know of moving obstacles is what FCL says, whatever was queried before."""

import math
from dataclasses import replace

import numpy as np
import pytest
from moving import SCENES, busy, clearance_among

from pirrht.geometry.footprint import Footprint
from pirrht.geometry.scene import Scene
from pirrht.geometry.space import NEVER
from pirrht.geometry.world import WALL
from pirrht.jit.jit import kernel
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.distances import disc_of, fastest_of, moving_clearance
from pirrht.moving.exits import LISTING, SEEN, Watch, sweep, walls, watch
from pirrht.moving.obstacles import MovingObstacleArrays

CART = Footprint.rectangle(1.0, 0.4, 0.1)
HEXAGON = Footprint.polygon([(0.4, 0.0), (0.2, 0.3), (-0.2, 0.3), (-0.4, 0.0), (-0.2, -0.3), (0.2, -0.3)])


def truth(scene: Scene, place: np.ndarray, time: float) -> float:
    return clearance_among(scene.movers, scene.footprint, place, time)


@pytest.mark.parametrize("scene", [busy, *SCENES.values()])
def test_clearances_are_those_of_the_bodies_as_they_stand_then(scene):
    world, rng = scene(), np.random.default_rng(1)
    traffic, crowd, met = MovingObstacleArrays.of(world), MovingObstacles(world.movers, world.footprint), 0
    for _ in range(150):
        place, time = rng.uniform(world.lower, world.upper), rng.uniform(0.0, 6.0)
        found, right = moving_clearance(traffic, tuple(place), time), truth(world, place, time)
        assert found == pytest.approx(crowd.clearance(place, time), abs=2e-3) or min(found, right) >= traffic.cutoff
        if right > 0.0:
            assert found == pytest.approx(min(right, traffic.cutoff), abs=2e-3)
        else:
            assert found <= 2e-3
            met += 1
    assert met < 75


def test_walls_lie_where_the_clearance_rises_from_and_move_as_it_changes():
    world, rng, dt, seen = busy(), np.random.default_rng(2), 1e-6, 0
    for mover in world.movers:
        alone = replace(world, movers=(mover,))
        traffic = MovingObstacleArrays.of(alone)
        for _ in range(100):
            place, time = rng.uniform(world.lower, world.upper), rng.uniform(0.0, 2.0)
            rows = traffic.walls(tuple(place), time, 0.8)
            if len(rows) == 0:
                assert truth(alone, place, time) > 0.79
                continue
            d, nx, ny, _, vx, vy = rows[0]
            assert d == pytest.approx(moving_clearance(traffic, tuple(place), time), abs=1e-12)
            if d > 0.0:
                beyond = moving_clearance(traffic, tuple(place + dt * np.array([nx, ny])), time)
                assert (beyond - d) / dt == pytest.approx(1.0, abs=0.06)
                assert (moving_clearance(traffic, tuple(place), time + dt) - d) / dt == pytest.approx(
                    -(vx * nx + vy * ny), abs=0.06
                )
                seen += 1
    assert seen > 30


@pytest.mark.parametrize("footprint", [CART, HEXAGON], ids=["cart", "hexagon"])
def test_a_polygon_meets_what_it_touches_or_passes_within_a_centimetre(footprint):
    """Boxes, discs and meshes that turn: clearance, its change with pose and time, and where a step meets one."""
    world, rng, h, met = replace(busy(), footprint=footprint), np.random.default_rng(4), 1e-7, 0
    traffic, exact, off = MovingObstacleArrays.of(world), MovingObstacles(world.movers, footprint), []
    for _ in range(300):
        pose, t = rng.uniform([0.8, 0.3, -7.0], [5.2, 3.7, 7.0]), rng.uniform(0.0, 1.0)
        found, right = traffic.clearance(tuple(pose), t), min(exact.clearance(pose, t), traffic.cutoff)
        assert found <= right or right == 0.0
        assert found > right - (0.01 if right < 0.09 else 0.06) or right == 0.0
        if found <= 0.0:
            continue
        for _, *away, vx, vy in traffic.walls(tuple(pose), t, found + 1e-9):
            rises = [traffic.clearance(tuple(pose + h * one), t) - found for one in np.eye(3)]
            rises.append(traffic.clearance(tuple(pose), t + h) - found)
            off.append(np.abs(np.array(rises) / h - [*away, -away[0] * vx - away[1] * vy]).max())
        step = rng.uniform([-0.3, -0.3, -0.6], [0.3, 0.3, 0.6])
        hit = sweep(traffic, watch(traffic), (tuple(pose), tuple(pose + step), 0.0), t, 0.1, 1.0)
        least = min(exact.clearance(pose + s * step, t + 0.1 * s) for s in min(hit, 1.0) * np.linspace(0.0, 1.0, 60))
        met += hit < NEVER
        assert least < 0.02 if hit < NEVER else least > 0.0
    assert met > 10
    assert np.mean(np.array(off) > 0.05) < 0.1  # at corners, and where motions change


def test_no_point_of_a_body_is_faster_than_its_bound_or_outside_of_its_disc():
    world, rng = busy(), np.random.default_rng(3)
    traffic = MovingObstacleArrays.of(world)
    for j, mover in enumerate(world.movers):
        alone = MovingObstacleArrays.of(replace(world, movers=(mover,)))
        for _ in range(60):
            place, time = rng.uniform(world.lower, world.upper), rng.uniform(0.0, 2.0)
            x, y, _ = mover.motion.pose(time)
            lower = np.hypot(place[0] - x, place[1] - y) - disc_of(traffic, j)
            assert lower <= max(truth(replace(world, movers=(mover,)), place, time), 0.0) + 1e-9
            for row in alone.walls(tuple(place), time, 0.8):
                assert np.hypot(row[4], row[5]) <= fastest_of(traffic, j) + 1e-9


@kernel
def _watch(moving):  # type: ignore[no-untyped-def]
    return watch(moving)


@kernel
def _walls(moving, notes, pose, t, within, out):  # type: ignore[no-untyped-def]
    return walls(moving, notes, pose, t, within, out)


def near_walls(
    traffic: MovingObstacleArrays, notes: Watch, x: np.ndarray, t: float, within: float
) -> tuple[np.ndarray, float]:
    out = np.empty((traffic.J, WALL))
    count, until = _walls(traffic, notes, (x[0], x[1]), t, within, out)
    return out[:count], until


@pytest.mark.parametrize("onward", [True, False])
def test_what_a_path_knows_from_before_leaves_out_no_body_that_is_near(onward):
    """Along a random way, in either direction of time, with and without what earlier queries have left."""
    world, rng = busy(), np.random.default_rng(2)
    traffic, kept, found = MovingObstacleArrays.of(world), 0, 0
    crowds = [MovingObstacles([mover], world.footprint) for mover in world.movers]
    notes = _watch(traffic)
    assert notes.listing.shape == (LISTING,)
    x, t = np.array([3.5, 2.0]), 0.0 if onward else 4.0
    for _ in range(400):
        x, t = np.clip(x + rng.normal(0.0, 0.1, 2), 1.0, 4.5), t + (1.0 if onward else -1.0) * rng.uniform(0.0, 0.02)
        within, before = rng.uniform(0.1, 1.0), notes.listing[SEEN]
        rows, until = near_walls(traffic, notes, x, t, within)
        kept += notes.listing[SEEN] == before
        afresh, change = near_walls(traffic, _watch(traffic), x, t, within)
        np.testing.assert_allclose(rows, afresh, atol=1e-9)
        assert until == pytest.approx(change)
        assert until > t
        assert len(rows) == sum(crowd.clearance(x, t) < within - 1e-6 for crowd in crowds) or np.any(
            [abs(crowd.clearance(x, t) - within) < 1e-3 for crowd in crowds]
        )
        found += len(rows)
    assert kept > 100
    assert found > 40


RESTART = 1.1  # when one of them is suddenly elsewhere [s]


def test_a_straight_way_is_met_where_fcl_says():
    world, rng = busy(), np.random.default_rng(0)
    traffic, crowd, met = MovingObstacleArrays.of(world), MovingObstacles(world.movers, world.footprint), 0
    notes = _watch(traffic)
    for _ in range(300):
        a, t, dt = rng.uniform([1.0, 0.5], [5.0, 3.5]), rng.uniform(0.0, 2.0), rng.uniform(0.05, 0.3)
        b = a + rng.uniform(-0.3, 0.3, 2)
        if crowd.clearance(a, t) < 2e-3:
            continue
        share = sweep(traffic, notes, (tuple(a), tuple(b), 0.0), t, dt, 1.0)
        found = share < NEVER
        right = crowd.meets(a, t, b, t + dt)
        met += right
        if found != right:  # by a hair, or where a body is gone that has been there
            assert abs(min(crowd.clearance(a + s * (b - a), t + s * dt) for s in np.linspace(0.0, 1.0, 400))) < 2e-3
            continue
        if right:
            entered = crowd.clearance(a + share * (b - a), t + share * dt)
            assert entered == pytest.approx(0.0, abs=0.02) or abs(math.remainder(share * dt + t, RESTART)) < 1e-5
            assert not crowd.meets(a, t, a + 0.9 * share * (b - a), t + 0.9 * share * dt)
    assert met > 12
