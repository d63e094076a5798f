"""Trees of robots with corners: paths whose turns are free, and the name of the place where there is none."""

import math
from dataclasses import replace

import numpy as np
import pytest
from moving import SCENES
from trees import grown

from pirrht import Footprint, FreeSpace, NoReference, Problem, Scene
from pirrht.steering.in_time import InTime
from pirrht.steering.turn_and_go import TurnAndGo, wrapped
from pirrht.systems.rover import Rover
from sim.scenario.narrow_place import narrow_place

CART = Footprint.rectangle(1.0, 0.4)
WEDGE = Footprint.polygon([(-0.2, -0.25), (0.6, 0.0), (-0.2, 0.25)])
GAP = [(2.9, 0.0, 3.1, 2.25), (2.9, 2.75, 3.1, 5.0)]  # 0.5 m wide

CROSSING = [(0.0, 0.0, 2.7, 2.2), (3.3, 0.0, 6.0, 2.2), (0.0, 2.8, 2.7, 5.0), (3.3, 2.8, 6.0, 5.0)]  # 0.6 m wide


def bend(width: float, pocket: float = 0.0) -> list[tuple[float, ...]]:
    """A corridor along x that turns up, with room to the upper left of its corner."""
    left = [(4.0 - width - pocket, 1.0 + width + pocket, 4.0 - width, 5.0)] if pocket else []
    return [(0, 1 + width, 4 - width - pocket, 5), (4, 0, 6, 5), (0, 0, 6, 1), *left]


def task(
    boxes: list[tuple[float, ...]], start: tuple[float, ...], goal: tuple[float, ...], shape: Footprint = CART
) -> Problem:
    scene = Scene.from_boxes(boxes, lower=(0, 0), upper=(6, 5), start=start, goal=goal, footprint=shape)
    return Problem(dynamics=Rover(b=0.1), scene=scene, R=np.diag([2.0, 0.5]))


@pytest.mark.parametrize(
    ("boxes", "start", "goal"),
    [(GAP, (1, 1, 1.5), (5, 4, 0.3)), (bend(0.6, 0.6), (0.7, 1.3, 0), (3.7, 4, 0.2)),
     (bend(1.1), (0.7, 1.5, math.pi), (3.45, 4, 0.2))],
)  # fmt: skip
def test_a_cart_passes_lengthwise_and_turns_where_there_is_room_and_backs_out_of_where_there_is_none(
    boxes, start, goal
):
    problem = task(boxes, start, goal)
    space = FreeSpace.of(problem.scene)
    reference = grown(space, TurnAndGo.of(problem), 450).references(space.scene.start)[0]
    path = reference.path
    driven = space.scene.start.copy()
    for u, seconds in zip(reference.trajectory.controls, reference.trajectory.durations, strict=True):
        driven += seconds * u @ [[math.cos(driven[2]), math.sin(driven[2]), 0.0], [0.0, 0.0, 1.0]]  # drives or turns
    end = path.start[-1, :2] + path.length[-1, 0] * np.array([math.cos(path.start[-1, 2]), math.sin(path.start[-1, 2])])
    np.testing.assert_allclose(driven[:2], end, atol=1e-9)
    heading = space.scene.start[2]
    for tail, way, length in zip(path.tails, path.start[:, 2], path.length[:, 0], strict=True):
        along = min((way, way + math.pi), key=lambda one: abs(wrapped(one - heading)))
        turns = np.linspace(0.0, wrapped(along - heading), 50)
        ahead = np.linspace(0.0, length, 100)[:, None] * np.array([math.cos(way), math.sin(way)])
        poses = [np.column_stack([np.tile(tail[:2], (50, 1)), heading + turns])]
        poses.append(np.column_stack([tail[:2] + ahead, np.full(100, along)]))
        assert space.collision.clearance(np.vstack(poses)).min() > -1e-9
        heading = along


@pytest.mark.slow  # its kernels take long to compile
@pytest.mark.parametrize("name", ["closing_door", "oblique"])
def test_among_moving_obstacles_a_cart_is_free_along_its_legs_and_while_it_turns_at_their_ends(name):
    problem = Problem(dynamics=Rover(b=0.1), scene=replace(SCENES[name](), footprint=CART), R=np.diag([2.0, 0.5]))
    space, steering = FreeSpace.of(problem.scene), InTime.of(problem)
    tree = grown(space, steering, 500)
    for one in tree.references(steering.at(space.scene.start, 0.0)):
        heading, path = space.scene.start[2], one.path
        assert np.all(np.diff(path.knots[:, 2]) > 0.0)
        assert tree.homology.winding(path.knots) == one.winding
        for i, (ax, ay, s, bx, by, t) in enumerate(path.path):
            way, after = math.atan2(by - ay, bx - ax), path.heads[i, 3]
            ways = [way, way + math.pi] if (ax, ay) != (bx, by) else [heading]
            along = min(ways, key=lambda way: abs(wrapped(way - heading)) + abs(wrapped(after - way)))
            at, moments = np.linspace(0.0, 1.0, 60)[:, None], np.linspace(s, t, 60)
            turns = [np.hstack([np.tile([x, y], (60, 1)), first + at * wrapped(last - first)])
                     for x, y, first, last in ((ax, ay, heading, along), (bx, by, along, after))]  # fmt: skip
            legs = np.hstack([[ax, ay] + at * [bx - ax, by - ay], np.full((60, 1), along)])
            poses, times = np.vstack([*turns, legs]), np.concatenate([np.full(60, s), np.full(60, t), moments])
            assert space.collision.clearance(poses).min() > -1e-9
            assert min(map(space.moving.distance, poses, times)) > -1e-9
            heading = after


@pytest.mark.parametrize(
    ("boxes", "start", "goal", "at"),
    [(bend(0.6), (0.7, 1.3, 0), (3.7, 4, 0.2), (3.4, 1.6)), (CROSSING, (0.7, 2.5, 0), (3.0, 4.4, 0.2), (2.7, 2.7))],
)  # fmt: skip
def test_a_bend_or_crossing_that_is_too_narrow_to_turn_in_is_named(boxes, start, goal, at):
    problem = task(boxes, start, goal)
    space = FreeSpace.of(problem.scene)
    tree = grown(space, TurnAndGo.of(problem), 300)
    with pytest.raises(NoReference):
        tree.references(space.scene.start)
    place = narrow_place(tree, space.scene.start)
    assert place is not None
    assert place.at == pytest.approx(at, abs=0.6)
    assert place.width == pytest.approx(0.6, abs=0.1)
    assert "it needs 0.4 m there at best" in place.says(CART)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("boxes", "start", "shape"),
    [([(0, 0, 6, 1)], (3, 1.51, -0.5 * math.pi), CART), ([(0, 0, 6, 1)], (1, 1.258, 0), WEDGE),
     ([(0, 0, 2, 1.8), (0, 2.22, 2, 5)], (0.6, 2.01, math.pi), CART)],
)  # fmt: skip
def test_a_start_next_to_a_wall_that_forbids_turns_is_left_straight_ahead_or_behind(boxes, start, shape, seed):
    problem = task(boxes, start, (5, 4, 0.3), shape)
    space = FreeSpace.of(problem.scene)
    assert grown(space, TurnAndGo.of(problem), 150, seed=seed).references(space.scene.start)


def test_a_path_that_leads_back_to_a_corner_that_the_robot_has_passed_is_shortened_anew():
    problem = task([(1.6, 1.0, 2.4, 2.9)], (0.8, 3.2, 0.0), (5.0, 2.2, 0.3), Footprint.rectangle(0.5, 0.4))
    space = FreeSpace.of(problem.scene)
    steering = TurnAndGo.of(problem)
    tree = grown(space, steering, 30)
    corners = np.array([[0.8, 3.2, 0.0], [0.9, 3.4, 0.0], [2.2, 3.4, 0.0], [5.0, 2.2, 0.0]])
    before = tree.checker.until_goal(steering.connect(corners[:-1], corners[1:]))
    x = np.array([1.2, 2.5, 0.0])
    fresh = tree.references(x)
    again = tree.references(x, before={one.winding: before for one in fresh})
    assert again[0].winding == fresh[0].winding
    assert again[0].cost < 1.01 * fresh[0].cost
