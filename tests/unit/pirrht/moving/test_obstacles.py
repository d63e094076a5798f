"""What kernels are told of bodies that move is what FCL says of the bodies as they stand then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discs import block, disc
from moving import SCENES, as_mesh, hall, moved
from thoroughly import first

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Kind, Scene, Workspace
from pirrht.moving import obstacles
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.distances import disc_of, fastest_of, moving_clearance, piece_of
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.moving.tuning import TUNING

EVERYWHERE = np.full(2, np.inf)


def busy() -> Scene:
    """Bodies of one and two solids that turn, one of which starts over elsewhere and one where it ends."""
    way = [(0.0, 1.5, 1.5, 0.3), (0.4, 2.0, 1.2, 1.0), (1.1, 2.5, 2.4, -1.0)]
    lap = [(0.0, 4.0, 1.0, 0.0), (0.5, 4.6, 1.6, 2.0), (0.9, 4.0, 1.0, 6.283185307179586)]
    ell = block("ell", 0.2, 0.0, (0.1, 0.4), yaw=0.3), disc("end", -0.3, 0.1, 0.2)
    bodies = [
        moved("once", way, *ell),
        moved("again", way, as_mesh(block("box", 0.1, 0.2, (0.15, 0.3))), repeat=True),
        moved("around", lap, block("bar", 0.0, 0.0, (0.5, 0.05)), repeat=True),
    ]
    return hall("busy", bodies)


def truth(scene: Scene, place: Array, time: float) -> float:
    solids = tuple(one for mover in scene.movers for one in mover.at(time))
    return float(Collision(Workspace(-EVERYWHERE, EVERYWHERE, solids), scene.footprint).clearance(place[None])[0])


@pytest.mark.parametrize("scene", [busy, *SCENES.values()])
def test_clearances_are_those_of_the_bodies_as_they_stand_then(scene):
    world, rng = scene(), np.random.default_rng(1)
    traffic, crowd, met = MovingObstacleArrays.of(world), MovingObstacles(world.movers, world.footprint), 0
    for _ in range(150):
        place, time = rng.uniform(world.lower, world.upper), rng.uniform(0.0, 6.0)
        found, right = moving_clearance(traffic, place[0], place[1], time), truth(world, place, time)
        assert found == pytest.approx(crowd.clearance(place, time), abs=2e-3) or min(found, right) >= traffic.cutoff
        if right > 0.0:
            assert found == pytest.approx(min(right, traffic.cutoff), abs=2e-3)
        else:
            assert found <= 2e-3
            met += 1
    assert met < 75


@pytest.mark.parametrize("time", first([0.25, -0.3, 0.0, 0.4, 1.7, 8.0]))
def test_poses_are_those_of_the_motions_also_on_a_later_clock(time):
    world = busy()
    traffic = MovingObstacleArrays.of(world)
    for later in (0.0, 0.35):
        onward = traffic.with_motions([replace(mover, motion=mover.motion.after(later)) for mover in world.movers])
        for j, mover in enumerate(world.movers):
            assert piece_of(onward, j, time)[:3] == pytest.approx(mover.motion.pose(time + later), abs=1e-12)


def test_walls_lie_where_the_clearance_rises_from_and_move_as_it_changes():
    world, rng, dt, seen = busy(), np.random.default_rng(2), 1e-6, 0
    for mover in world.movers:
        alone = replace(world, movers=(mover,))
        traffic = MovingObstacleArrays.of(alone)
        for _ in range(100):
            place, time = rng.uniform(world.lower, world.upper), rng.uniform(0.0, 2.0)
            rows = traffic.walls(*place, time, 0.8)
            if len(rows) == 0:
                assert truth(alone, place, time) > 0.79
                continue
            d, nx, ny, vx, vy = rows[0]
            assert d == pytest.approx(moving_clearance(traffic, place[0], place[1], time), abs=1e-12)
            if d > 0.0:
                off = 1e-6 * np.array([nx, ny])
                beyond = moving_clearance(traffic, place[0] + off[0], place[1] + off[1], time)
                assert (beyond - d) / 1e-6 == pytest.approx(1.0, abs=0.06)
                later = moving_clearance(traffic, place[0], place[1], time + dt)
                assert (later - d) / dt == pytest.approx(-(vx * nx + vy * ny), abs=0.06)
                seen += 1
    assert seen > 30


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
            for row in alone.walls(*place, time, 0.8):
                assert np.hypot(row[3], row[4]) <= fastest_of(traffic, j) + 1e-9


def test_where_nothing_moves_all_is_free():
    still = MovingObstacleArrays.of(hall("still", []))
    assert still.J == 0
    assert moving_clearance(still, 1.0, 1.0, 0.0) == still.cutoff


@pytest.mark.parametrize("radius", [0.001, 0.002])
def test_for_a_small_robot_tables_stay_small_and_never_report_more_clearance_than_there_is(monkeypatch, radius):
    monkeypatch.setattr(obstacles, "TUNING", TUNING._replace(table_points=20_000))
    egg = replace(block("egg", 0.0, 0.0, (0.3, 0.1)), kind=Kind.ELLIPSOID)
    way = [(0.0, 1.5, 1.5, 0.3), (1.0, 2.0, 1.2, 1.0)]
    movers = [moved("box", way, as_mesh(block("box", 0.1, 0.2, (0.15, 0.3)))), moved("egg", way[:1], egg)]
    world, rng = hall("small", movers, radius=radius), np.random.default_rng(2)
    traffic = MovingObstacleArrays.of(world)
    assert len(traffic.arrays[-1]) < 22_000
    for _ in range(300):
        place, time = rng.normal((1.7, 1.5), 0.3), rng.uniform(0.0, 1.0)
        found, right = moving_clearance(traffic, place[0], place[1], time), truth(world, place, time)
        assert found <= max(right, -radius) + 4e-3  # by which FCL errs beside ellipsoids
        assert found >= min(right, traffic.cutoff) - 1.5 * traffic.pitch
    for place in world.movers[0].motion.pose_at(0.0)[:2] + rng.normal(0.0, 0.3, (300, 2)):
        alone = hall("alone", movers[:1], radius=radius)
        found = moving_clearance(traffic, place[0], place[1], 0.0)
        assert found <= truth(alone, place, 0.0) + 1e-9 or truth(alone, place, 0.0) <= 0.0
