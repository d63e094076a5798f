"""What is known of bodies that move never says more than FCL does where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from thoroughly import first
from tilted import RADIUS, solid

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Workspace
from pirrht.moving.collision import MovingObstacles, jumps, radius_of, speed_bound

FOOTPRINT = Footprint(RADIUS, 0.1)
EVERYWHERE = np.full(2, np.inf)


def disc(radius: float = 0.3, at: tuple[float, float] = (0.0, 0.0)) -> Obstacle:
    size, position = np.array([radius, 0.5, 0.0]), np.array([*at, 0.5])
    return Obstacle(name="disc", kind=Kind.CYLINDER, size=size, position=position, rotation=np.eye(3))


def mover(rows: list[list[float]], *solids: Obstacle, repeat: bool = False) -> Mover:
    return Mover(name="m", solids=solids or (disc(),), motion=Motion(rows=np.array(rows), repeat=repeat))


def wandering(seed: int, *, turning: float = 2.0) -> list[Mover]:
    """Five bodies of all kinds of tilted solids on ways with corners, some of which start over elsewhere.

    Their yaws lie within `turning` of one another's [rad].
    """
    rng = np.random.default_rng(seed)
    bodies = []
    for k, kind in enumerate((Kind.BOX, Kind.MESH, Kind.ELLIPSOID, Kind.CAPSULE, Kind.CYLINDER)):
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.6, 4))])
        rows = np.column_stack([times, rng.uniform(-1, 1, (5, 2)), 0.3 + rng.uniform(-turning, turning, 5)])
        solids = [solid(kind, "a", rng.uniform(-0.4, 0.4, 2), rng), disc(0.1, (0.5, 0.2))]
        bodies.append(mover(rows.tolist(), *solids, repeat=k % 2 == 0))
    return bodies


def questions(crowd: MovingObstacles) -> int:
    """How often FCL was asked."""
    return sum(shape.calls for shape in (body.shape for body in crowd._bodies))


def truth(bodies: list[Mover], place: Array, time: float) -> float:
    solids = tuple(one for body in bodies for one in body.at(time))
    return float(Collision(Workspace(-EVERYWHERE, EVERYWHERE, solids), FOOTPRINT).clearance(place[None])[0])


@pytest.mark.parametrize("seed", range(3))
def test_a_clearance_is_that_of_the_bodies_as_they_stand_then_whatever_was_asked_before(seed):
    bodies, rng = wandering(seed), np.random.default_rng(seed)
    crowd = MovingObstacles(bodies, FOOTPRINT)
    for _ in range(60):
        place, time = rng.uniform(-2, 2, 2), rng.uniform(0, 5)
        for step in range(4):
            near, later = place + 0.02 * step * rng.standard_normal(2), time + 0.01 * step
            assert crowd.surely(near, later) <= truth(bodies, near, later) + 1e-5
            assert crowd.clearance(near, later) == pytest.approx(truth(bodies, near, later), abs=1e-5)


@pytest.mark.parametrize("turning", [2.0, 0.0])
@pytest.mark.parametrize("seed", first(range(3)))
def test_what_is_surely_free_is_free_and_what_is_met_is_met(seed, turning):
    bodies, rng = wandering(seed, turning=turning), np.random.default_rng(10 + seed)
    crowd, hits = MovingObstacles(bodies, FOOTPRINT), 0
    for _ in range(60):
        a, begin, span = rng.uniform(-1.5, 1.5, 2), rng.uniform(0, 4), rng.uniform(0.001, 0.05)
        b = a + rng.uniform(-0.3, 0.3, 2)
        shares = np.linspace(0.0, 1.0, 81)
        least = min(truth(bodies, a + s * (b - a), begin + s * span) for s in shares)
        met = crowd.meets(a, begin, b, begin + span)
        hits += met
        if least < -1e-3:
            assert met
        if met:
            assert least < 0.05  # the samples miss a little of it
    assert 5 < hits < 55


@pytest.mark.parametrize(("gap", "met"), [(1e-6, False), (1e-3, False), (-1e-6, True)])
def test_a_way_that_grazes_a_body_costs_one_question_a_row_if_the_body_does_not_turn(gap, met):
    """A wall of 4 m on wheels comes along and stops; the robot slides along it for 2 s."""
    wall = solid(Kind.BOX, "wall", np.zeros(2), np.random.default_rng(0))
    wall = replace(wall, size=np.array([2.0, 0.1, 0.5]), rotation=np.eye(3), position=np.array([0.0, 0.0, 0.5]))
    crowd = MovingObstacles([mover([[0, 0, 0, 0], [0.7, 0.4, 0, 0], [1.4, 0.4, 0, 0]], wall)], FOOTPRINT)
    a, b = np.array([-1.0, 0.1 + RADIUS + gap]), np.array([1.0, 0.1 + RADIUS + gap])
    assert crowd.meets(a, 0.0, b, 2.0) == met
    assert questions(crowd) <= 3


@pytest.mark.parametrize(("gap", "met"), [(1e-4, False), (2e-2, False), (-1e-4, True)])
def test_a_way_that_grazes_a_body_that_turns_costs_few_questions(gap, met):
    """A disc turns by 3 rad on 5 m of its way, and the robot, beside it at first, goes a little faster."""
    crowd = MovingObstacles([mover([[0, 0, 0, 0], [1, 5, 0, 3]], disc(0.3))], FOOTPRINT)
    far = 0.3 + RADIUS + gap
    a, b = np.array([0.0, far]), np.array([6.0, far])
    assert crowd.meets(a, 0.0, b, 1.0) == met
    assert questions(crowd) <= 150


def test_a_thin_body_that_is_past_at_the_end_of_a_step_has_met_the_robot():
    fast = mover([[0, -1, 0, 0], [0.02, 1, 0, 0]], disc(0.002))
    origin = np.zeros(2)
    assert MovingObstacles([fast], FOOTPRINT).meets(origin, 0.0, origin, 0.02)
    aside = np.array([0.0, RADIUS + 0.003])
    assert not MovingObstacles([fast], FOOTPRINT).meets(aside, 0.0, aside, 0.02)
    along = np.array([2.0, 0.0])
    ahead = np.array([-1.0 + RADIUS + 0.01, 0.0])  # it runs before the body, as fast
    assert not MovingObstacles([fast], FOOTPRINT).meets(ahead, 0.0, ahead + along, 0.02)


def test_a_motion_that_starts_over_sweeps_nothing_on_its_way_back_and_is_felt_where_it_lands():
    back = mover([[0, -2, 0, 0], [1, 2, 0, 0]], disc(0.1), repeat=True)
    crowd = MovingObstacles([back], FOOTPRINT)
    origin, landing = np.zeros(2), np.array([-2.0, 0.0])
    assert not crowd.meets(origin, 0.99, origin, 1.01)
    assert crowd.meets(landing, 0.99, landing, 1.01)
    assert crowd.meets(landing, 0.99, landing, 1.0)
    assert crowd.meets(origin, 0.99, origin, 1.51)
    assert crowd.clearance(landing, 0.999) > 3.0 > 0.0 > crowd.clearance(landing, 1.001)
    assert jumps(back.motion)


def test_a_leap_between_two_rows_is_swept_and_costs_few_questions_wherever_it_is():
    """Five million metres a second, for a microsecond of a step."""
    leap = mover([[0, -1, 0, 0], [1, -1, 0, 0], [1 + 1e-6, 4, 0, 0], [2, 4, 0, 0]], disc(0.1))
    for x, y, met in ((1.5, 0.0, True), (1.5, 0.23, False), (1.5, 0.21, True), (-1.5, 0.0, False), (3.0, -0.3, False)):
        crowd, place = MovingObstacles([leap], FOOTPRINT), np.array([x, y])
        assert crowd.meets(place, 0.9995, place, 1.0015) == met
        assert not crowd.meets(place, 0.9975, place, 0.9995)
        assert questions(crowd) <= 4
    crowd, bystander = MovingObstacles([leap], FOOTPRINT), np.array([1.5, 3.0])
    assert not any(crowd.meets(bystander, 0.002 * k, bystander, 0.002 * (k + 1)) for k in range(1000))
    assert questions(crowd) <= 1002  # one a step, and one more for each row within


def test_a_whole_turn_is_no_jump():
    assert not jumps(Motion(rows=np.array([[0, 1, 2, 0], [1, 3, 2, 4], [2, 1, 2, 2 * np.pi]]), repeat=True))
    assert not jumps(Motion(rows=np.array([[0, 1, 2, 0], [1, 3, 2, 4]])))


numbers = st.floats(-3, 3)
steps = st.lists(st.tuples(st.floats(0.05, 2), numbers, numbers, numbers), min_size=1, max_size=5)


@settings(max_examples=60)
@given(steps, st.floats(0, 8), st.floats(0, 8), st.floats(-1, 1), st.floats(-1, 1))
def test_no_point_of_a_body_is_faster_than_its_bound(steps, one, other, x, y):
    rows = np.cumsum(np.array([(0.0, 0.0, 0.0, 0.0), *steps]), axis=0)
    spot = disc(0.001, (x, y))
    bar = mover(rows.tolist(), spot)
    bound = speed_bound(bar.motion, radius_of(bar))
    a, b = (bar.at(time)[0].position[:2] for time in (one, other))
    assert np.hypot(*(a - b)) <= bound * abs(one - other) + 1e-9
    crowd = MovingObstacles([bar], FOOTPRINT)
    assert np.hypot(*(a - b)) <= crowd.travel(min(one, other), max(one, other)) + 1e-9
