"""Steps among bodies that move: what a straight way meets, and what masses and rovers meet that follow guides."""

from __future__ import annotations

import math

import numpy as np
import pytest
from moving import busy

from pirrht.geometry.world import NEVER
from pirrht.jit.jit import kernel
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.exits import sweep, watch
from pirrht.moving.obstacles import MovingObstacleArrays

RESTART = 0.9  # when one of them is suddenly elsewhere [s]


@kernel
def _watch(moving):  # type: ignore[no-untyped-def]
    return watch(moving)


def test_a_straight_way_is_met_where_fcl_says():
    world, rng = busy(), np.random.default_rng(0)
    traffic, crowd, met = MovingObstacleArrays.of(world), MovingObstacles(world.movers, world.footprint), 0
    notes = _watch(traffic)
    for _ in range(300):
        a, t, dt = rng.uniform([1.0, 0.5], [5.0, 3.5]), rng.uniform(0.0, 2.0), rng.uniform(0.05, 0.3)
        b = a + rng.uniform(-0.3, 0.3, 2)
        if crowd.clearance(a, t) < 2e-3:
            continue
        share = sweep(traffic, notes, (a[0], a[1], b[0], b[1], 0.0), t, dt, 1.0)
        found = share < NEVER
        right = crowd.meets(a, t, b, t + dt)
        met += right
        if found != right:  # by a hair, or where a body is gone that has been there
            times = np.linspace(0.0, 1.0, 400)
            least = min(crowd.clearance(a + s * (b - a), t + s * dt) for s in times)
            assert abs(least) < 2e-3
            continue
        if right:
            entered = crowd.clearance(a + share * (b - a), t + share * dt)
            assert entered == pytest.approx(0.0, abs=0.02) or abs(math.remainder(share * dt + t, RESTART)) < 1e-5
            assert not crowd.meets(a, t, a + 0.9 * share * (b - a), t + 0.9 * share * dt)
    assert met > 12
