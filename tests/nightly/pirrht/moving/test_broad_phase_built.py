"""The long tests of unit/pirrht/rollouts/test_nearby.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pirrht.moving.broad_phase import Nearby
from sim.scenario import prepare


@pytest.mark.parametrize(("scene", "robot"), [("pincer", None), ("crossing", "rover"), ("closing_door", "car")])
def test_paths_are_the_same_whether_few_bodies_are_listed_or_all(scene, robot, monkeypatch):
    """Up to rounding: bodies that were seen before are followed on, which may add a step where a motion changes."""
    scenario = prepare(scene, robot=robot, given={"samples": 100, "vertices": 300})
    controller = scenario.controller(scenario.grown_tree())
    integral = controller.path_integral
    batch = controller.batch(scenario.start, controller.tree.references(controller.tree.at(scenario.start, 0.0)))
    few = integral.rollout(batch, 1).paths
    made = Nearby.of
    monkeypatch.setattr(Nearby, "of", lambda traffic, frame, times, _: made(traffic, frame, times, 1e-3))
    everybody = integral.rollout(replace(batch, state=batch.state.copy()), 1).paths  # tables are made anew
    alike = np.isclose(few.work, everybody.work, atol=1e-5) & (few.outcome == everybody.outcome)
    assert np.mean(alike) > 0.98
