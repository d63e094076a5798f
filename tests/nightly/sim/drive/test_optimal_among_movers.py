"""The exact law among bodies that move, driven in MuJoCo: it costs what the grid foretells."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.control.policy import RunState
from pirrht.exact.desirability import Desirability
from pirrht.outcome import Outcome
from sim.drive.truth import ExactReference
from sim.scenario import prepare


def test_a_drives_clock_runs_whether_it_is_driven_or_only_expected():
    scenario = prepare("pincer")
    drive = RunState(scenario.homology, scenario.start)
    drive.passed(0.3)
    drive.passed(0.2)
    assert drive.time == pytest.approx(0.5)


@pytest.mark.thorough
def test_drives_under_the_exact_law_cost_what_it_foretells_and_arrive():
    """`pincer`, b = 0.3: the mean cost of 24 drives is v to 3 standard errors and 1 %; seeds 0 to 23."""
    scenario = prepare("pincer", given={"noise": 0.3, "method": "optimal"})
    truth = Desirability.of(scenario.problem, scenario.space)
    v, costs, lost = float(truth.value(scenario.start)), [], 0
    for seed in range(24):
        one = scenario.with_settings(seed=seed)
        witness = ExactReference(truth)
        for frame in one.drive(one.plant(), one.driver(truth=truth)):
            assert witness.add(frame.plan).distance(frame.plan.control) < 1e-9
        lost += frame.outcome is not Outcome.GOAL
        costs += [frame.cost] if frame.outcome is Outcome.GOAL else []
    assert lost <= 3
    assert np.mean(costs) == pytest.approx(v, abs=3.0 * np.std(costs) / np.sqrt(len(costs)) + 0.01 * v)
