"""Moving walls around a path: all that are near are found, whatever earlier queries of the path have left."""

from __future__ import annotations

import numpy as np
import pytest
from moving import busy

from pirrht.arrays import Array
from pirrht.geometry.world import WALL
from pirrht.jit.jit import kernel
from pirrht.moving.collision import MovingObstacles
from pirrht.moving.exits import LISTING, SEEN, Watch, walls, watch
from pirrht.moving.obstacles import MovingObstacleArrays


@kernel
def _watch(moving):  # type: ignore[no-untyped-def]
    return watch(moving)


@kernel
def _walls(moving, notes, x, y, t, within, out):  # type: ignore[no-untyped-def]
    return walls(moving, notes, x, y, t, within, out)


def near(traffic: MovingObstacleArrays, notes: Watch, x: Array, t: float, within: float) -> tuple[Array, float]:
    out = np.empty((traffic.J, WALL))
    count, until = _walls(traffic, notes, x[0], x[1], t, within, out)
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
        rows, until = near(traffic, notes, x, t, within)
        kept += notes.listing[SEEN] == before
        afresh, change = near(traffic, _watch(traffic), x, t, within)
        np.testing.assert_allclose(rows, afresh, atol=1e-9)
        assert until == pytest.approx(change)
        assert until > t
        assert len(rows) == sum(crowd.clearance(x, t) < within - 1e-6 for crowd in crowds) or np.any(
            [abs(crowd.clearance(x, t) - within) < 1e-3 for crowd in crowds]
        )
        found += len(rows)
    assert kept > 100
    assert found > 40
