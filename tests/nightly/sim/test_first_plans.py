"""No built-in scene begins with a control that is a guess, and the first plan alone draws more samples for that."""

from __future__ import annotations

import pytest

from sim.mjcf import scene_names
from sim.scenario import prepare
from sim.scenario.scenario import ENOUGH


@pytest.mark.parametrize("name", scene_names())
def test_the_first_plan_of_every_scene_rests_on_enough_effective_samples(name):
    for seed in range(3):
        scenario = prepare(name, given={"seed": seed})
        estimate = scenario.driver(scenario.grown_tree()).plan(scenario.start).estimate
        assert estimate is not None
        assert estimate.ess >= ENOUGH, seed
