"""Lists of bodies near a path: none that is near is left out, and a list serves as long as it says."""

from __future__ import annotations

import numpy as np
from moving import busy

from pirrht.moving.broad_phase import held_of, listing, surely
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.moving.tuning import CACHED_BODY, CACHED_LIST


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
