"""The long tests of unit/pirrht/estimation/test_among_movers.py."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from moving import SCENES
from thoroughly import thorough
from trees import grown

from pirrht.control.controller import Controller
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.systems.single_integrator import SingleIntegrator


@cache
def known(name: str, b: float) -> Desirability:
    scene = SCENES[name]()
    problem = Problem(dynamics=SingleIntegrator(b=b), scene=scene, R=2.0 * np.eye(2))
    return Desirability.of(problem, FreeSpace.of(scene))


JUDGED = [(name, b) if (name, b) == ("crossing", 0.2) else thorough(name, b) for name in SCENES for b in (0.2, 0.3)]


@pytest.mark.parametrize(("name", "b"), JUDGED)
def test_plans_value_is_that_of_the_grid_at_random_states_and_times(name, b):
    """2000 samples per class at 8 states, seed 5: 4 standard errors and 0.3 %, all within 1 %; one may lack a class.

    A tree of 800 vertices that is aimed at a state does not find every dash through a gap that is about to close.
    """
    truth, space, rng, off = known(name, b), FreeSpace.of(SCENES[name]()), np.random.default_rng(5), []
    tree = grown(space, InTime(), 400, seed=1)
    sampling = Sampling(samples=2000, threads=1)
    one = Controller(truth.problem, space, tree, sampling, rng=np.random.default_rng(2))
    while len(off) < 8:
        x, t = rng.uniform([0.3, 0.3], [4.5, 4.7]), float(rng.uniform(0.0, 2.0))
        if not truth.value(x, t) < 14.0 or np.hypot(*(x - space.scene.goal.center)) < 0.5:
            continue
        one.begin(x, t)
        found, value = [one.plan(x) for _ in range(2)][1].estimate, truth.value(x, t)
        assert found is not None
        error = abs(found.value - value)
        off.append(0.0 if error < 4.0 * found.value_error + 3e-3 * value and error < 0.01 * value else error / value)
    assert np.count_nonzero(off) <= 1, off


def test_close_to_the_goal_the_control_is_that_of_the_grid():
    """Where paths arrive, and walls are near, before a guide's law or a mean over 0.4 s has told the control: it was
    off by 0.8 % along the rim, or 0.8 % too weak towards it. Mean over 6 states and both directions, seed 7.
    """
    truth, space, off = known("closing_door", 0.3), FreeSpace.of(SCENES["closing_door"]()), []
    tree = grown(space, InTime(), 100, seed=1)
    sampling = Sampling(samples=20_000, threads=1, first=0.01)
    one, goal = Controller(truth.problem, space, tree, sampling, rng=np.random.default_rng(7)), space.scene.goal
    for angle, beyond in ((1.4, 0.28), (1.0, 0.36), (0.8, 0.33), (-1.4, 0.28), (-1.0, 0.36), (-0.8, 0.33)):
        outward = np.array([np.cos(angle), np.sin(angle)])
        x = goal.center + (goal.radius + beyond) * outward
        one.begin(x, 2.1)
        found = one.plan(x).estimate
        assert found is not None
        around = np.array([-outward[1], outward[0]]) * np.sign(angle)
        error = found.control - truth.control(x, 2.1)
        off.append([(error @ side, math.hypot(*(side * found.control_error))) for side in (outward, around)])
    means, errors = np.array(off).mean(axis=0)[:, 0], np.sqrt(np.sum(np.array(off)[:, :, 1] ** 2, axis=0)) / len(off)
    assert np.all(np.abs(means) < 3.0 * errors), (means, errors)
    assert np.all(errors < 0.003)
