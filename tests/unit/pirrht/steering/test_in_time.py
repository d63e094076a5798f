"""Edges in space and time: forward, no faster than the limit, paid for by the integral, never through anything."""

import math

import numpy as np
import pytest
from discs import block, disc
from moving import SCENES, as_mesh, hall, moved
from thoroughly import thorough

from pirrht import FreeSpace, Problem, Scene, SingleIntegrator
from pirrht.geometry.collision import Collision
from pirrht.geometry.space import BLOCKED, FREE
from pirrht.moving.collision import MovingObstacles
from pirrht.steering.in_time import InTime
from pirrht.systems.rover import Rover

GOAL = np.array([[5.5, 2.5, np.nan]])


def tumbling() -> Scene:
    """A mesh and a bar that turn while they drift, and one body that starts over elsewhere."""
    plank = as_mesh(block("plank", 0.0, 0.0, (0.5, 0.1)))
    rows = [(0.0, 2.0, 3.5, 0.0), (1.5, 3.0, 2.2, 4.0), (3.0, 2.2, 1.5, 9.0)]
    jump = [(0.0, 4.0, 1.0, 0.0), (1.0, 4.0, 4.0, 0.0)]
    movers = [moved("plank", rows, plank), moved("jump", jump, disc("disc", 0.0, 0.0, 0.25), repeat=True)]
    return hall("tumbling", movers, [block("block", 3.2, 3.9, (0.2, 0.3))])


def edges(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    tails = np.column_stack([rng.uniform(0.2, 4.8, (count, 2)), rng.uniform(0.0, 4.0, count)])
    step = np.column_stack([rng.normal(0.0, 0.5, (count, 2)), rng.uniform(-0.2, 1.2, count)])
    step[::9, :2] = 0.0
    return tails, tails + step


def fcl_free(scene: Scene, crowd: MovingObstacles, path: np.ndarray) -> bool:
    """Whether FCL finds a robot free everywhere on a way (6,), asked every 2 ms."""
    shares = np.linspace(0.0, 1.0, max(2, math.ceil((path[5] - path[2]) / 2e-3)))[:, None]
    places = path[:3] + shares * (path[3:] - path[:3])
    standing = Collision(scene.world, scene.footprint).clearance(places[:, :2])
    return bool(np.all(standing > 0.0)) and all(crowd.clearance(place[:2], float(place[2])) > 0.0 for place in places)


@pytest.mark.parametrize("scene", [*map(SCENES.get, ("crossing", "closing_door", "oblique")), thorough(tumbling)])
def test_edges_never_collide_and_only_what_nearly_collides_is_refused(scene):
    space, steering = FreeSpace.of(scene()), InTime()
    tails, heads = edges(3, 160)
    motions = steering.connect(tails, heads)
    judged = steering.checker(space).inspect(motions, np.zeros(len(tails), dtype=bool))
    crowd = MovingObstacles(space.scene.movers, space.scene.footprint)
    possible, counts = np.isfinite(motions.cost), [0, 0]
    for i in np.flatnonzero(possible):
        path = motions.path[i]
        if np.hypot(*(path[3:5] - space.scene.goal.center)) < 1.0:
            continue
        counts[int(judged.status[i] == FREE)] += 1
        assert fcl_free(space.scene, crowd, path) == (judged.status[i] == FREE)
    assert min(counts) > 5


def test_costs_are_those_of_the_integral():
    steering = InTime(q=1.3, r=0.7)
    tails, heads = edges(0, 200)
    motions = steering.connect(tails, heads)
    for i in np.flatnonzero(np.isfinite(motions.cost)):
        dt = heads[i, 2] - tails[i, 2]
        v = np.hypot(*(heads[i, :2] - tails[i, :2])) / dt
        assert motions.cost[i] == pytest.approx((1.3 + 0.35 * v * v) * dt)
    assert steering.distance(tails, heads) == pytest.approx(motions.cost)


def test_no_edge_runs_backward_in_time_or_faster_than_the_limit():
    steering = InTime(speed=1.5)
    tails, heads = edges(1, 500)
    dt = heads[:, 2] - tails[:, 2]
    fast = np.hypot(*(heads - tails)[:, :2].T) > 1.5 * dt * (1.0 + 1e-8)
    assert np.array_equal(np.isinf(steering.distance(tails, heads)), (dt <= 0.0) | fast)
    assert fast.sum() > 50
    assert (dt <= 0.0).sum() > 20


@pytest.mark.parametrize("forward", [True, False])
def test_nearest_states_are_those_of_least_cost_in_either_direction(forward):
    steering, rng = InTime(), np.random.default_rng(2)
    states = np.column_stack([rng.uniform(0.0, 5.0, (300, 2)), rng.uniform(0.0, 5.0, 300)])
    x = np.array([2.0, 2.0, 2.5])
    cost = steering.distance(x, states) if forward else steering.distance(states, x)
    found = steering.nearest(states, x, 20, forward=forward)
    assert np.array_equal(found, np.argsort(cost, kind="stable")[:20])
    assert np.isfinite(cost[found]).all()


def test_a_way_into_the_goal_is_paid_up_to_the_rim_and_other_ways_must_not_enter_it():
    steering = InTime()
    checker = steering.checker(FreeSpace.of(hall("empty", [])))
    motions = steering.connect(np.array([[1.0, 2.5, 0.0]]), GOAL)
    assert checker.inspect(motions, np.array([True])).cost[0] == pytest.approx(2.0 * 4.2)
    assert checker.inspect(motions, np.array([False])).status[0] == BLOCKED
    path = checker.until_goal(motions)
    assert path.path[0, 3:] == pytest.approx([5.2, 2.5, 4.2])
    assert path.cost[0] == pytest.approx(8.4)


def test_a_point_is_steered_by_its_own_cost_and_other_systems_track_at_their_pace():
    scene = hall("empty", [])
    point = InTime.of(Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=3.0 * np.eye(2), q=1.5))
    assert (point.q, point.r, point.drives) == (1.5, 3.0, True)
    rover = InTime.of(Problem(dynamics=Rover(), scene=scene, R=np.diag([2.0, 0.5]), q=1.0), speed=1.2)
    assert not rover.drives
    assert (rover.m, rover.limit) == (2, 1.2)
    found = rover.trajectory(rover.connect(np.array([[1.0, 1.0, 0.0]]), np.array([[2.0, 1.0, 1.0]])))
    assert np.array_equal(found.controls, np.zeros((1, 2)))
    assert found.slack == rover.slack > 0.0
