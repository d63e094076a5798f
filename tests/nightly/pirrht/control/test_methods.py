"""The long tests of unit/pirrht/control/test_methods.py."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import annulus

from pirrht.control.controller import Controller
from pirrht.estimation.sampling import Sampling
from pirrht.planner.tree import HomologyTree
from pirrht.steering.straight_line import StraightLine

# -- the best class ----------------------------------------------------------------------------------------------


def test_where_there_is_one_class_the_best_of_them_is_what_all_of_them_say():
    problem, space = annulus(0.3)
    tree = HomologyTree(space, StraightLine(), limit=0.6, rng=np.random.default_rng(0))
    plans = {}
    for method in ("pi-rrht", "best-class"):
        sampling = Sampling(samples=100, first=0.01)
        controller = Controller(problem, space, tree, sampling, method=method, rng=np.random.default_rng(3))
        plans[method] = [controller.plan(problem.scene.start[:2])]
        controller.observe(np.array([[1.19, 0.01]]), 0.01)
        plans[method].append(controller.plan(np.array([1.19, 0.01])))
    for one, other in zip(*plans.values(), strict=True):
        np.testing.assert_allclose(one.control, other.control, rtol=1e-9)
        np.testing.assert_allclose(one.tape, other.tape, rtol=1e-9, atol=1e-12)
        assert one.estimate.value == pytest.approx(other.estimate.value, rel=1e-12)
        nearby = one.state + 0.003
        np.testing.assert_allclose(one.at(nearby, 0.004), other.at(nearby, 0.004), rtol=1e-9)
