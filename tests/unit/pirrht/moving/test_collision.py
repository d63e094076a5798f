"""What is known of bodies that move never says more than FCL does where they are."""

import discs
import numpy as np
import pytest
from moving import clearance_among, moved
from thoroughly import first
from tilted import RADIUS, solid

from pirrht.geometry.scene import Footprint, Kind, Obstacle
from pirrht.moving.collision import MovingObstacles, jumps

FOOTPRINT = Footprint.disc(RADIUS)


def disc(radius: float, x: float = 0.0, y: float = 0.0) -> Obstacle:
    return discs.disc("disc", x, y, radius)


def wandering(seed: int, *, turning: float = 2.0):
    """Five bodies of all kinds of tilted solids on ways with corners, some of which start over elsewhere.

    Their yaws lie within `turning` of one another's [rad].
    """
    rng = np.random.default_rng(seed)
    bodies = []
    for k, kind in enumerate((Kind.BOX, Kind.MESH, Kind.ELLIPSOID, Kind.CAPSULE, Kind.CYLINDER)):
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.6, 4))])
        rows = np.column_stack([times, rng.uniform(-1, 1, (5, 2)), 0.3 + rng.uniform(-turning, turning, 5)])
        solids = [solid(kind, "a", rng.uniform(-0.4, 0.4, 2), rng), disc(0.1, 0.5, 0.2)]
        bodies.append(moved("m", rows, *solids, repeat=k % 2 == 0))
    return bodies


@pytest.mark.parametrize("seed", range(3))
def test_a_clearance_is_that_of_the_bodies_as_they_stand_then_whatever_was_asked_before(seed):
    bodies, rng = wandering(seed), np.random.default_rng(seed)
    crowd = MovingObstacles(bodies, FOOTPRINT)
    for _ in range(60):
        place, time = rng.uniform(-2, 2, 2), rng.uniform(0, 5)
        for step in range(4):
            near, later = place + 0.02 * step * rng.standard_normal(2), time + 0.01 * step
            truth = clearance_among(bodies, FOOTPRINT, near, later)
            assert crowd.surely(near, later) <= truth + 1e-5
            assert crowd.clearance(near, later) == pytest.approx(truth, abs=1e-5)


@pytest.mark.parametrize("turning", [2.0, 0.0])
@pytest.mark.parametrize("seed", first(range(3)))
def test_what_is_surely_free_is_free_and_what_is_met_is_met(seed, turning):
    rng = np.random.default_rng(10 + seed)
    crowd, hits = MovingObstacles(wandering(seed, turning=turning), FOOTPRINT), 0
    for _ in range(60):
        a, begin, span = rng.uniform(-1.5, 1.5, 2), rng.uniform(0, 4), rng.uniform(0.001, 0.05)
        b = a + rng.uniform(-0.3, 0.3, 2)
        shares = np.linspace(0.0, 1.0, 81)
        least = min(crowd.clearance(a + s * (b - a), begin + s * span) for s in shares)
        met = crowd.meets(a, begin, b, begin + span)
        hits += met
        if least < -1e-3:
            assert met
        if met:
            assert least < 0.05  # the samples miss a little of it
    assert 5 < hits < 55


def test_a_thin_body_that_is_past_at_the_end_of_a_step_has_met_the_robot():
    fast = moved("m", [(0, -1, 0, 0), (0.02, 1, 0, 0)], disc(0.002))
    origin = np.zeros(2)
    assert MovingObstacles([fast], FOOTPRINT).meets(origin, 0.0, origin, 0.02)
    aside = np.array([0.0, RADIUS + 0.003])
    assert not MovingObstacles([fast], FOOTPRINT).meets(aside, 0.0, aside, 0.02)
    along = np.array([2.0, 0.0])
    ahead = np.array([-1.0 + RADIUS + 0.01, 0.0])  # it runs before the body, as fast
    assert not MovingObstacles([fast], FOOTPRINT).meets(ahead, 0.0, ahead + along, 0.02)


def test_a_motion_that_starts_over_sweeps_nothing_on_its_way_back_and_is_felt_where_it_lands():
    back = moved("m", [(0, -2, 0, 0), (1, 2, 0, 0)], disc(0.1), repeat=True)
    crowd = MovingObstacles([back], FOOTPRINT)
    origin, landing = np.zeros(2), np.array([-2.0, 0.0])
    assert not crowd.meets(origin, 0.99, origin, 1.01)
    assert crowd.meets(landing, 0.99, landing, 1.01)
    assert crowd.meets(landing, 0.99, landing, 1.0)
    assert crowd.meets(origin, 0.99, origin, 1.51)
    assert crowd.clearance(landing, 0.999) > 3.0 > 0.0 > crowd.clearance(landing, 1.001)
    assert jumps(back.motion)
