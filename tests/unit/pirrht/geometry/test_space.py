"""A second member of the interface of footprints through tree, guide and sampler of a real plan."""

from typing import Any

import numpy as np
import pytest
from discs import disc, scene_of
from offset_disc import offset

from pirrht import Controller, Dubins, FreeSpace, HomologyTree, Problem, Sampling, Unicycle
from pirrht.outcome import Outcome
from pirrht.steering.straight_line import Tracked
from pirrht.systems.rover import Rover

AHEAD, RADIUS = 0.35, 0.1
SCENE = scene_of(
    [disc("pillar", 2.0, 1.5, 0.5)], start=(0.8, 1.45), goal=(3.4, 1.5, 0.3), side=(4.0, 3.0), radius=RADIUS
)


def test_walls_of_a_member_are_gradients_of_its_clearance_in_the_pose():
    static, rng = offset(FreeSpace.of(SCENE), AHEAD).static, np.random.default_rng(0)
    kernels, compared = static.kernels, 0
    for pose in rng.uniform([0.6, 0.6, -np.pi], [3.4, 2.4, np.pi], (200, 3)):
        nearest, away, *_ = kernels.walls(static, tuple(pose))
        steps = 1e-4 * np.eye(3)
        slope = [kernels.clearance(static, tuple(pose + h)) - kernels.clearance(static, tuple(pose - h)) for h in steps]
        if nearest > 0.05 and np.hypot(*slope[:2]) > 1.9e-4:  # no kink between two walls
            np.testing.assert_allclose(away, np.array(slope) / 2e-4, atol=0.1)
            compared += 1
    assert compared > 100


def car() -> tuple[Problem, Any]:
    problem = Problem(dynamics=Unicycle(b=0.2, rho=0.5), scene=SCENE, R=np.eye(1))
    return problem, Dubins.of(problem)


def rover() -> tuple[Problem, Any]:
    problem = Problem(dynamics=Rover(b=0.1), scene=SCENE, R=np.diag([2.0, 0.5]))
    return problem, Tracked.of(problem)


def least_clearance(problem: Problem, steering: Any, space: FreeSpace, exact: Any) -> float:
    """The least clearance by FCL of samples of a plan that arrive [m]."""
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
    problem, steering = made()
    plain = FreeSpace.of(SCENE)
    space = offset(plain, AHEAD)
    assert least_clearance(problem, steering, space, space.collision) > -0.01
    assert least_clearance(problem, steering, plain, space.collision) < -0.03
