"""Shortest paths of MPPI's terminal cost against lengths in closed form."""

import numpy as np
import pytest
from discs import disc, scene_of

from pirrht import FreeSpace, Mppi, Problem, Sampling, Scene, SingleIntegrator, StraightLine
from pirrht.control.cost_to_go import cost_to_go, shortest_paths, straight_lines
from pirrht.steering.motion import running_cost

TASK = {"lower": (0.0, 0.0), "upper": (4.0, 3.0), "start": (0.6, 1.5), "goal": (3.4, 1.5, 0.3), "robot_radius": 0.2}


def walls(*boxes: tuple[float, float, float, float]) -> FreeSpace:
    return FreeSpace.of(Scene.from_boxes(boxes, **TASK))


def test_a_path_around_a_disc_has_its_length_and_begins_along_the_tangent() -> None:
    middle, goal = np.array([2.0, 1.5]), np.array([3.5, 1.5])
    space = FreeSpace.of(scene_of([disc("disc", *middle, 0.4)], start=(0.5, 1.5), goal=(*goal, 0.25), side=(4.0, 3.0)))
    R = 0.4 + space.scene.robot_radius
    places = np.array([[0.5, 1.4], [0.7, 1.45], [1.2, 1.1]])  # the shortest path is the lower one
    for place, vector in zip(places, shortest_paths(space)(places), strict=True):
        to_disc, near, far = middle - place, np.hypot(*(middle - place)), np.hypot(*(goal - middle))
        between = np.arccos((place - middle) @ (goal - middle) / (near * far))
        tangents = np.sqrt(near**2 - R**2) + np.sqrt(far**2 - R**2)
        length = tangents + R * (between - np.arccos(R / near) - np.arccos(R / far)) - space.scene.goal.radius
        assert np.hypot(*vector) == pytest.approx(length, rel=0.01)
        tangent = np.arctan2(to_disc[1], to_disc[0]) - np.arcsin(R / near)
        assert np.arctan2(vector[1], vector[0]) == pytest.approx(tangent, abs=0.08)


def test_without_obstacles_a_path_is_the_straight_line_and_none_in_the_goal() -> None:
    space = walls()
    places = np.array([[0.6, 1.5], [3.0, 2.7], [0.3, 0.3], [3.4, 1.5], [3.5, 1.6]])
    straight = straight_lines(space.scene.goal)(places)
    np.testing.assert_allclose(shortest_paths(space)(places), straight, atol=0.05)
    np.testing.assert_array_equal(straight[3:], 0.0)


def test_a_passage_hardly_wider_than_the_robot_is_passed_and_a_narrower_one_is_not() -> None:
    straight = 2.8 - 0.3
    for width, passes in ((0.402, True), (0.37, False)):
        slit = walls((1.9, 0.5, 2.1, 1.507 - width / 2), (1.9, 1.507 + width / 2, 2.1, 3.0))
        length = np.hypot(*shortest_paths(slit)(np.array([[0.6, 1.5]]))[0])
        assert (length < 1.02 * straight) == passes
        assert length < 2.0 * straight


def test_from_a_place_that_is_cut_off_a_path_begins_at_the_nearest_free_one() -> None:
    remaining = shortest_paths(walls((1.0, 0.0, 1.2, 3.0)))(np.array([[0.6, 1.5], [1.1, 1.5]]))
    assert np.all(np.isfinite(remaining))
    assert np.all(np.hypot(*remaining.T) > 1.5)


def test_the_cost_to_go_of_a_point_is_that_of_its_straight_reference() -> None:
    problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=walls().scene, R=2.0 * np.eye(2))
    goal, line = problem.scene.goal, StraightLine.of(problem)
    tail = goal.center - np.array([[1.0, 0.4]])
    beyond = cost_to_go(problem, straight_lines(goal))
    reference = line.trajectory(line.connect(tail, goal.center[None]))
    assert beyond(tail)[0] == pytest.approx(running_cost(problem, tail[0], reference) - 2.0 * goal.radius)
    assert beyond(goal.center[None])[0] == 0.0


def test_mppi_leaves_a_pocket_along_the_shortest_path() -> None:
    """The straight line home leads to its back."""
    space = walls((2.0, 0.5, 2.2, 2.4), (1.0, 0.5, 2.2, 0.7), (1.0, 2.2, 2.2, 2.4))
    problem = Problem(dynamics=SingleIntegrator(b=0.3), scene=space.scene, R=2.0 * np.eye(2))
    speed, straight = {}, cost_to_go(problem, straight_lines(space.scene.goal))
    for name, terminal_cost in (("path", None), ("straight", straight)):
        sampling = Sampling(samples=400, guide="open-loop", draws="independent")
        rng = np.random.default_rng(0)
        mppi = Mppi(problem, space, sampling, horizon=0.5, rng=rng, terminal_cost=terminal_cost)
        mppi.begin(np.array([1.5, 1.5]))
        speed[name] = float(np.mean([mppi.plan(np.array([1.5, 1.5])).control[0] for _ in range(5)]))
    assert speed["path"] < 0.0 < speed["straight"]
