"""Sampled paths as strokes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pirrht.control.controller import Controller
from pirrht.planner.tree import HomologyTree
from sim.drawing.strokes import fans
from sim.scenario import Scenario


def test_samples_without_weight_are_drawn_and_not_seen(slit: Scenario, slit_tree: HomologyTree):
    """Of a plan whose earlier samples have all the weight: nothing is divided by it."""
    controller = slit.with_settings(samples=20).controller(slit_tree)
    assert isinstance(controller, Controller)
    plan = controller.plan(slit.start)
    assert plan.estimate is not None
    weightless = replace(plan.estimate, weight=np.zeros_like(plan.estimate.weight))
    found = fans(controller.path_integral, weightless, plan.classes, points=400, everything=False)
    assert found
    for fan in found.values():
        assert len(fan.opacity) > 0
        assert not fan.opacity.any()
