"""Which bodies are listed around a path: all that can come near it, and for the most part no others."""

from __future__ import annotations

import numpy as np
import pytest
from discs import disc
from moving import busy, hall, moved

from pirrht.arrays import Array, IntArray
from pirrht.jit.jit import kernel
from pirrht.moving.broad_phase import Nearby, begin_list, held_of, list_around, listing, next_jump, surely
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.moving.tuning import CACHED_BODY, CACHED_LIST, CELL_STATE

FRAME = 0.0, 0.0, 6.0, 5.0
TIMES = np.concatenate([[0.0, 0.01, 0.03], np.arange(1, 21) * 0.1]) + 0.13


@kernel
def _listed(nearby, bodies, i, x, y, within, held, listed):  # type: ignore[no-untyped-def]
    begin_list(held)
    return list_around(nearby, bodies, i, x, y, within, 0, held, listed)


@kernel
def _jumps(nearby, times, held, out):  # type: ignore[no-untyped-def]
    begin_list(held)
    for k in range(times.shape[0]):
        out[k] = next_jump(nearby, times[k], held)


def listed(nearby: Nearby, bodies: int, i: int, x: Array, within: float) -> IntArray:
    room = np.full(bodies, -1)
    count = _listed(nearby, bodies, i, x[0], x[1], within, np.empty(CELL_STATE, np.int64), room)
    return room[:count]


def test_no_body_that_comes_within_reach_in_a_step_is_left_out():
    world, rng, left_out = busy(), np.random.default_rng(3), 0
    traffic, crowds = (
        MovingObstacleArrays.of(world),
        [MovingObstacles([mover], world.footprint) for mover in world.movers],
    )
    for _ in range(2000):
        reach = rng.choice([0.1, 0.4, 1.1])
        nearby = Nearby.of(traffic, FRAME, TIMES, reach)
        x, i = rng.uniform(FRAME[:2], FRAME[2:]), rng.integers(len(TIMES) - 1)
        found = listed(nearby, traffic.J, i, x, reach)
        assert np.all(np.diff(found) > 0)
        for j in set(range(traffic.J)) - set(found.tolist()):
            t = rng.uniform(TIMES[i], TIMES[i + 1])
            assert crowds[j].clearance(x, t) > reach
            left_out += 1
    assert left_out > 500


@pytest.mark.parametrize("asked", [{"within": 0.41}, {"x": np.array([6.1, 2.0])}, {"x": np.array([2.0, -0.1])}])
def test_beyond_the_reach_and_outside_of_the_cells_all_bodies_count(asked):
    traffic = MovingObstacleArrays.of(busy())
    nearby = Nearby.of(traffic, FRAME, TIMES, 0.4)
    given = {"x": np.array([0.2, 4.8]), "within": 0.4}
    assert len(listed(nearby, traffic.J, 3, **given)) < traffic.J
    assert listed(nearby, traffic.J, 3, **(given | asked)).tolist() == list(range(traffic.J))


def test_cells_grow_where_a_world_is_large():
    traffic, times = MovingObstacleArrays.of(busy()), np.linspace(0.0, 20.0, 201)
    nearby = Nearby.of(traffic, (-500.0, -3.0, 1500.0, 900.0), times, 0.3)
    assert len(nearby.first) < 1.2e5
    assert len(listed(nearby, traffic.J, 5, np.array([2.0, 1.5]), 0.3)) == traffic.J


def test_a_path_is_told_every_jump_to_come():
    """One body starts over every 0.9 s, another every 0.4 s; a third comes back to where it has been."""
    lap = [(0.0, 1.0, 1.0, 0.0), (0.9, 2.0, 1.0, 0.0)]
    short = [(0.0, 1.0, 3.0, 0.0), (0.4, 2.0, 3.0, 0.0)]
    round_trip = [(0.0, 4.0, 3.0, 0.0), (0.1, 4.5, 3.0, 0.0), (0.3, 4.0, 3.0, 0.0)]
    bodies = [
        moved(f"b{k}", rows, disc(f"d{k}", 0.0, 0.0, 0.2), repeat=True)
        for k, rows in enumerate([lap, short, round_trip])
    ]
    nearby = Nearby.of(MovingObstacleArrays.of(hall("laps", bodies)), FRAME, TIMES, 0.4)
    times = np.sort(np.random.default_rng(4).uniform(TIMES[0], TIMES[-1], 50))
    told = np.empty(50)
    _jumps(nearby, times, np.empty(CELL_STATE, np.int64), told)
    jumps = np.array(
        [t for t in np.sort(np.concatenate([0.9 * np.arange(1, 9), 0.4 * np.arange(1, 9)])) if t < TIMES[-1]]
    )
    right = [min(jumps[jumps > t], default=np.inf) for t in times]
    assert told == pytest.approx(right, abs=1e-12)


def test_a_list_serves_as_long_as_it_says():
    world, rng = busy(), np.random.default_rng(1)
    traffic, crowd = MovingObstacleArrays.of(world), MovingObstacles(world.movers, world.footprint)
    held, listed = held_of(traffic.J), np.empty(traffic.J, np.int64)
    served = 0
    for _ in range(200):
        x, t, within = rng.uniform([0.0, 0.0], [6.0, 5.0]), rng.uniform(0.0, 2.0), rng.uniform(0.2, 1.5)
        if listing(traffic, x[0], x[1], t, within, held, listed):
            continue
        for _ in range(4):
            y, s = x + rng.uniform(-0.5, 0.5, 2), t + rng.uniform(0.0, 0.4)
            known = surely(held, traffic.speed, y[0], y[1], s)
            assert known <= crowd.clearance(y, s) + 1e-6
            served += known > 0.0
    assert served > 50


def test_what_a_list_knows_from_before_leaves_out_no_body_that_is_near():
    """Along a random way, with and without what earlier lists have left."""
    world, rng = busy(), np.random.default_rng(2)
    traffic, skipped = MovingObstacleArrays.of(world), 0
    held, listed = held_of(traffic.J), np.empty(traffic.J, np.int64)
    x, t = np.array([1.0, 1.0]), 0.0
    for _ in range(400):
        x, t = np.clip(x + rng.normal(0.0, 0.1, 2), 0.0, 5.0), t + rng.uniform(0.0, 0.02)
        within, before = rng.uniform(0.1, 1.0), held[CACHED_LIST:].copy()
        found = listed[: listing(traffic, x[0], x[1], t, within, held, listed)].tolist()
        skipped += int(
            np.sum(np.all(held[CACHED_LIST:].reshape(-1, CACHED_BODY) == before.reshape(-1, CACHED_BODY), axis=1))
        )
        afresh = np.empty(traffic.J, np.int64)
        assert found == afresh[: listing(traffic, x[0], x[1], t, within, held_of(traffic.J), afresh)].tolist()
    assert skipped > 200
