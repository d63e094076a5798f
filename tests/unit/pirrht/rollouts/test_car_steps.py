"""Steps of a car: fitted ones say what ten times as fine ones say, uniform ones are the plain chain.

A sampled path of the plain chain is steered by one number per step. What it cannot do makes the best path dearer by
about the integral of (du/dt dt)^2 / 24, several lambda at steps of 0.1 s.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from batches import led, still
from discs import disc, scene_of
from trees import grown

from pirrht import Dubins, FreeSpace, HomologyTree, Problem, Sampling, Unicycle, path_integral
from pirrht.arrays import Array

STEP = 0.1


@cache
def case(b: float) -> tuple[Problem, FreeSpace, HomologyTree]:
    """A car in front of a post, and the goal behind it."""
    ends = {"start": (0.0, 0.0), "goal": (4.0, -0.6, 0.3), "lower": (-1.0, -3.0), "side": (6.0, 3.0)}
    scene = scene_of([disc("post", 2.2, -0.2, 0.4)], **ends, radius=0.15)
    problem, space = Problem(dynamics=Unicycle(b=b), scene=scene, R=np.eye(1), phi=1000.0), FreeSpace.of(scene)
    return problem, space, grown(space, Dubins.of(problem), 300)


def passive(b: float, steps: str, count: int) -> Array:
    """States (count, 3, 3) at 0, STEP and 2 STEP of paths from 0 that nothing leads."""
    problem, space, _ = case(b)
    integral = path_integral(problem, space, Sampling(dt=STEP, steps=steps, draws="independent"))
    times = STEP * np.arange(3)
    rollouts = led(integral, np.zeros(3), times, still(times, 1), count=count, seed=1)
    return integral.replay.trace(rollouts, np.arange(count))[0]


def test_within_fitted_steps_a_car_sways_as_the_integral_of_its_heading_does():
    """Heading and offset after one and two steps: moments of (w, integral of w); 40 000 paths, seed 1, 4 deviations."""
    b, count = 0.3, 40_000
    states = passive(b, "fitted", count)
    for k in (1, 2):
        t = k * STEP
        x, y, heading = states[:, k].T
        ahead = 2.0 / b**2 * (1.0 - np.exp(-0.5 * b**2 * t))  # E of the integral of cos
        assert abs(x.mean() - ahead) < 4.0 * x.std() / np.sqrt(count) + 1e-6
        products = heading * heading, heading * y, y * y
        for product, exact in zip(products, b**2 * np.array([t, t**2 / 2.0, t**3 / 3.0]), strict=True):
            assert product.mean() == pytest.approx(exact, abs=4.0 * product.std() / np.sqrt(count) + 0.003 * exact)
