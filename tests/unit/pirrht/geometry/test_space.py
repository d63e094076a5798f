"""A footprint that turns with the heading, through tree, guide and sampler of a real plan."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from discs import disc, scene_of

from pirrht import Controller, Dubins, Footprint, FreeSpace, HomologyTree, Problem, Sampling, Scene, Unicycle
from pirrht.outcome import Outcome
from pirrht.steering.straight_line import Tracked
from pirrht.systems.rover import Rover

RADIUS = 0.1
SCENE = scene_of(
    [disc("pillar", 2.0, 1.5, 0.5)], start=(0.8, 1.45), goal=(3.4, 1.5, 0.3), side=(4.0, 3.0), radius=RADIUS
)
LONG = replace(SCENE, footprint=Footprint.rectangle(0.55, 0.2, 0.15))


def car(scene: Scene) -> tuple[Problem, Any]:
    problem = Problem(dynamics=Unicycle(b=0.2, rho=0.5), scene=scene, R=np.eye(1))
    return problem, Dubins.of(problem)


def rover(scene: Scene) -> tuple[Problem, Any]:
    problem = Problem(dynamics=Rover(b=0.1), scene=scene, R=np.diag([2.0, 0.5]))
    return problem, Tracked.of(problem)


def least_clearance(made: Any, scene: Scene, exact: Any) -> float:
    """The least clearance, of the long robot, of samples of a plan that arrive, 0 in contact [m]."""
    problem, steering = made(scene)
    space = FreeSpace.of(scene)
    tree = HomologyTree(space, steering, limit=0.8, rng=np.random.default_rng(0))
    tree.grow(300)
    controller = Controller(problem, space, tree, Sampling(samples=400), rng=np.random.default_rng(1))
    plan = controller.plan(problem.dynamics.state_of(SCENE.start))
    assert plan.fallback is None

    rollouts = plan.estimate.rollouts
    states, steps = controller.path_integral.replay.trace(rollouts, np.arange(rollouts.size))
    ended = zip(states, steps, rollouts.paths.outcome, strict=True)
    arrived = [path[:last] for path, last, outcome in ended if outcome == Outcome.GOAL]
    assert len(arrived) > 50
    return min(exact.clearance(path).min() for path in arrived)


@pytest.mark.slow
@pytest.mark.parametrize("made", [car, rover])
def test_tree_guides_and_samples_keep_a_member_off_walls_that_they_let_a_disc_about_the_position_pass(made):
    exact = FreeSpace.of(LONG).collision
    assert least_clearance(made, LONG, exact) > 0.0
    assert least_clearance(made, SCENE, exact) == 0.0
