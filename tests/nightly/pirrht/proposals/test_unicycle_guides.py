"""The long tests of unit/pirrht/proposals/test_unicycle_guides.py."""

from __future__ import annotations

import numpy as np
import pytest
from guides import best
from unit.pirrht.proposals.test_unicycle_guides import WINDING, narrow

from pirrht.estimation.assembly import path_integral
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import running_cost


@pytest.mark.parametrize("state", WINDING)
def test_a_cold_guide_and_one_continued_from_it_at_the_same_state_agree_in_cost(state):
    """Five continuations gain less than three lambda in all, and none of them leaves its class or touches anything."""
    scenario, tree = narrow()
    x = np.array(state)
    integral = path_integral(scenario.problem, scenario.space, scenario.sampling)
    assert integral.guidance is not None
    references = tree.references(x)
    times = integral.grid(min(running_cost(scenario.problem, x, r.trajectory) for r in references))
    made = 0
    for reference in references:
        key = scenario.space.homology.key(reference.winding)
        cold = best(integral.guidance, x, times, key, reference.trajectory)
        if cold is None:  # a curve that takes longer than any path that weighs anything
            continue
        assert cold.valid
        made += 1
        last: DDPGuide | None = cold
        for _ in range(5):
            last = best(integral.guidance, x, times, key, reference.trajectory, last, 0.0)
            assert last is not None
            assert last.valid
        assert abs(last.penalised - cold.penalised) < 3.0 * scenario.problem.temperature
    assert made > 0
