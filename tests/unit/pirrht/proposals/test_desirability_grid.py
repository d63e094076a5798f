"""Desirability of classes on coarse grids in space: against the open, the exact grid, and one class at a time."""

from functools import cache

import numpy as np
import pytest
from spaces import box, pillars, window

from pirrht import Controller, Desirability, FreeSpace, Problem, Sampling, Scene, grown_tree
from pirrht.geometry.scene import Goal
from pirrht.proposals.desirability_grid import DesirabilityGrid, barriers
from pirrht.steering.pieces import SpaceLine
from pirrht.systems.ball import Ball

pytestmark = pytest.mark.slow  # kernels of robots in space

B = 0.35
DECAY = 1.0 / B**2  # for q = 1, R = 2 I [1/m]
OFFSET = 2.0 / DECAY


@cache
def controller_in(which: str) -> Controller:
    """Return a controller in `window`, among pillars around a crate, or in a room of that name."""
    scene = {"window": window, "pillars": pillars, "open": open_room, "crate": crate}[which]()
    space = FreeSpace.of(scene)
    problem = Problem(dynamics=Ball(b=B), scene=scene, R=2.0 * np.eye(3))
    tree = grown_tree(space, SpaceLine.of(problem), scene.start, vertices=400, seed=0, limit=1.0)
    return Controller(problem, space, tree, Sampling(samples=300, least=60.0), rng=np.random.default_rng(0))


def open_room(*solids) -> Scene:
    goal = Goal(center=np.array([3.2, 1.9, 1.6]), radius=0.3)
    return Scene(
        name="room", lower=np.full(3, 0.2), upper=np.array([3.8, 3.6, 3.0]), obstacles=solids, goal=goal,
        start=np.array([0.6, 1.9, 1.6]), robot_radius=0.2,
    )  # fmt: skip


def crate() -> Scene:
    """Return a crate that floats between start and goal: ways to all its sides are of one class."""
    return open_room(box("crate", (1.6, 1.6, 1.3), (2.2, 2.2, 1.9)))


def lines_in(controller: Controller) -> list[np.ndarray]:
    goal = controller.space.scene.goal.center
    found = controller.tree.references(controller.space.scene.start)
    return [np.vstack([one.path.tails, goal]) for one in found]


def grid_in(controller: Controller, own: int = 0) -> DesirabilityGrid:
    world = controller.path_integral.proposals.world.setup.world
    return DesirabilityGrid.of(controller.space, world, lines_in(controller), own, DECAY, OFFSET)


def test_in_the_open_it_is_that_of_a_ball():
    controller = controller_in("open")
    goal = controller.space.scene.goal
    grid = grid_in(controller)
    places = np.random.default_rng(0).uniform(1.2, 2.4, (50, 3))
    away = np.linalg.norm(places - goal.center, axis=1)
    expected = np.log(goal.radius / away) - DECAY * (away - goal.radius)
    off = [grid.at(place) for place in places] - expected
    assert np.abs(off).max() < 2.0 * DECAY * grid.spacing  # `at` takes the closest point


@pytest.mark.parametrize("which", ["window", "pillars"])
def test_of_all_classes_together_it_is_the_exact_one_within_a_nat(which):
    controller = controller_in(which)
    truth = Desirability.of(controller.problem, controller.space, spacing=0.07)
    best = grid_in(controller)
    for x in (controller.space.scene.start, np.add(controller.space.scene.start, (0.7, 0.3, 0.2))):
        value = -best.at(x) * controller.problem.temperature
        assert value == pytest.approx(float(truth.value(x)), abs=controller.problem.temperature)


def test_a_grid_keeps_to_the_class_of_its_reference():
    """Over the wall v is 11.96, as with the window closed; through the window it is 10.45."""
    controller = controller_in("window")
    through, over = (
        -controller.problem.temperature * grid_in(controller, k).at(np.array([0.8, 2.0, 1.0])) for k in (0, 1)
    )
    assert through == pytest.approx(10.45, rel=0.03)
    assert over == pytest.approx(11.96, rel=0.03)


def test_only_obstacles_that_tell_classes_apart_are_barriers():
    space = controller_in("crate").space
    start, goal = space.scene.start, space.scene.goal.center
    aside = [np.array([start, (1.9, y, 1.6), goal]) for y in (1.2, 2.6)]
    assert len(barriers(space, aside, 0)) == 0
    among = controller_in("pillars")
    assert all(len(barriers(among.space, lines_in(among), k)) > 0 for k in range(2))


def test_one_proposal_covers_all_sides_of_an_obstacle_that_floats():
    """A path on one side of the crate alone has a quarter of the desirability: v + lambda log 4, 0.34 too much."""
    controller = controller_in("crate")
    truth = Desirability.of(controller.problem, controller.space, spacing=0.05)
    start = controller.space.scene.start
    controller.begin(start)
    estimate = controller.plan(start).estimate
    assert estimate.ess >= 60.0
    error = np.hypot(estimate.value_error, 0.01 * float(truth.value(start)))
    assert abs(estimate.value - float(truth.value(start))) < 3.0 * error


def test_a_run_solves_for_a_class_once():
    controller = controller_in("window")
    x = controller.space.scene.start
    controller.begin(x)
    controller.step(x, 0.05)
    first = dict(controller.run.starts.grids)
    controller.step(np.add(x, (0.05, 0.0, 0.0)), 0.05)
    assert first
    assert all(controller.run.starts.grids[one] is grid for one, grid in first.items())


def test_maps_of_trees_and_plans_in_space_are_seen_from_above():
    controller = controller_in("window")
    x = controller.space.scene.start
    assert controller.tree.plot(x).get_xlabel() == "x [m]"
    controller.begin(x)
    assert controller.plan(x).plot().get_ylabel() == "y [m]"
