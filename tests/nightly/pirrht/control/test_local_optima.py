"""One class with two local optima: to pass a bar before it comes down, or to pass below its end later."""

from __future__ import annotations

import numpy as np
import pytest
from discs import block
from moving import hall, moved

from pirrht.control.controller import Controller
from pirrht.estimation.sampling import Sampling
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.in_time import InTime
from pirrht.systems.single_integrator import SingleIntegrator

ROWS = [(0.0, 2.19, 3.28, -2.86), (0.91, 2.43, 2.95, -1.67), (1.82, 2.27, 2.32, -0.48), (2.58, 2.14, 1.80, -0.86)]
BAR = moved("bar", ROWS, block("bar", 0.0, 0.0, (0.46, 0.07)))
SCENE = hall("sweeper", [BAR], goal=(4.23, 2.735))
SPACE = FreeSpace.of(SCENE)
HERE = np.array([0.38, 1.447, 0.758])


@pytest.mark.parametrize("seed", range(3))
def test_both_optima_are_sampled_where_noise_makes_them_alike(seed: int):
    problem = Problem(dynamics=SingleIntegrator(b=0.2), scene=SCENE, R=2.0 * np.eye(2))
    tree = HomologyTree(SPACE, InTime(), limit=0.8, rng=np.random.default_rng(seed))
    tree.grow(600)
    controller = Controller(problem, SPACE, tree, Sampling(samples=300, threads=1), rng=np.random.default_rng(1))
    controller.begin(HERE[:2], float(HERE[2]))
    plan = controller.plan(HERE[:2])
    assert plan.estimate is not None
    [(own, other)] = [optima for optima in controller.run.memory.optima.values() if len(optima) > 1]
    assert own.log_ratio_to(other) > 3.0
    assert own.penalised == pytest.approx(other.penalised, abs=3.0 * problem.temperature)
