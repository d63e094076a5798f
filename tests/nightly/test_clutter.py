"""The obstacle course is as hard and as varied as it claims."""

from __future__ import annotations

import numpy as np
import pytest

from sim.scenario import prepare

NARROW = 4 * 0.15  # four robot radii [m]


@pytest.mark.parametrize("seed", [0, 1])
def test_gaps_are_wide_enough_for_the_noise_the_cheapest_way_squeezes_through_two_and_ten_classes_are_near(seed):
    scenario = prepare("clutter", given={"seed": seed, "classes": 16})
    tree = scenario.grown_tree()
    references, passages = scenario.references(tree), tree.passages
    assert passages.width.min() > 0.5
    crossed = passages.crossed(references[0].trajectory.points)
    assert np.count_nonzero(passages.width[crossed] < NARROW) >= 2
    costs = np.array([reference.cost for reference in references])
    assert len(costs) >= 10
    assert costs[9] <= 1.3 * costs[0]
