"""Systems whose position is noisy next to the corners of boxes, and their guides with and without a covariance."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pirrht import Controller, Dynamics, FreeSpace, HomologyTree, Problem, Sampling, Scene
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.straight_line import Tracked
from pirrht.systems.rover import Rover

BOX = (1.0, -1.0, 2.0, 0.0)  # two of its corners lie on the way
START = np.array([0.0, -0.35, 0.5])
GOAL = (3.0, -0.35, 0.3)


def controller(
    dynamics: Dynamics | None = None, *boxes: Sequence[float], R: np.ndarray | None = None, **sampling: float
) -> Controller:
    """A controller at the start, of a rover of little noise unless another system is given."""
    scene = Scene.from_boxes(
        boxes or (BOX,), lower=(-1.0, -2.0), upper=(4.0, 2.0), start=START[:2], goal=GOAL, robot_radius=0.2
    )
    problem = Problem(dynamics=dynamics or Rover(b=0.03), scene=scene, R=np.diag([2.0, 0.5]) if R is None else R)
    space = FreeSpace.of(scene)
    tree = HomologyTree(space, Tracked.of(problem, 1.0), limit=0.8, rng=np.random.default_rng(0))
    tree.grow(200)
    made = Controller(problem, space, tree, Sampling(**sampling), rng=np.random.default_rng(1))  # type: ignore[arg-type]
    made.begin(START[: problem.dynamics.n])
    return made


def cheapest(made: Controller, x: np.ndarray) -> DDPGuide:
    """The guide of the cheapest class from a state."""
    made.begin(x)
    made.plan(x)
    return min((optima[0] for optima in made.run.starts.optima.values()), key=lambda one: one.penalised)


def passive_noise(guide: DDPGuide) -> DDPGuide:
    """A guide whose samples have the covariance of the passive noise."""
    unit = np.tile(np.eye(guide.share.shape[1]), (len(guide.share), 1, 1))
    return replace(guide, share=unit, inverse=unit, volume=np.zeros(len(unit)))
