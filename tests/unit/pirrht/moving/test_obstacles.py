"""What kernels are told of bodies that move is what FCL says of the bodies as they stand then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discs import block, disc
from moving import SCENES, as_mesh, hall, moved

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import Scene, Workspace
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.distances import disc_of, fastest_of, moving_clearance
from pirrht.moving.obstacles import MovingObstacleArrays

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
