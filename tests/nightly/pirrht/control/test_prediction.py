"""The long tests of unit/pirrht/control/test_prediction.py."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from thoroughly import thorough
from unit.pirrht.control.test_prediction import START, controller

from pirrht.control.proposals import ProposalBuilder
from pirrht.exact.desirability import Desirability


@pytest.mark.parametrize("name", [thorough("crossing"), "pincer"])
def test_plans_of_controllers_agree_with_the_grid_at_a_place_and_a_time(name):
    """Within 4 standard errors and 0.3 %, at two times; seed 1."""
    one = controller(name)
    truth = Desirability.of(one.problem, one.space)
    for x, t in ((START, 0.0), (np.array([1.8, 2.7]), 0.6)):
        one.begin(x, t)
        plan = [one.plan(x) for _ in range(2)][1]
        assert plan.time == t
        assert plan.estimate is not None
        value = truth.value(x, t)
        assert abs(plan.estimate.value - value) < 4.0 * plan.estimate.value_error + 3e-3 * value
        assert plan.estimate.ess > 10.0


def test_among_bodies_too_samples_go_where_they_contribute_and_the_value_stays_the_grids(monkeypatch):
    """Ten plans from one place where one way has most of the weight; seed 1, within 4 standard errors."""
    one, place, t = controller("crossing", b=0.1), np.array([2.4, 2.0]), 1.2
    one.begin(place, t)
    counts, batch = [], ProposalBuilder.batch

    def counted(*given):
        made = batch(*given)
        counts.append(Counter())
        for proposal in made.proposals:
            counts[-1][proposal.name] += proposal.count
        return made

    monkeypatch.setattr(ProposalBuilder, "batch", counted)
    estimates = [plan.estimate for plan in (one.plan(place) for _ in range(10)) if plan.estimate is not None]
    favourite = max(estimates[-1].class_weights, key=estimates[-1].class_weights.__getitem__)
    assert set(counts[0].values()) == {400}  # nothing is known at first
    assert {count.total() for count in counts} == {counts[0].total()}
    assert counts[-1][favourite] > 1.4 * counts[0][favourite]
    assert min(counts[-1].values()) >= 60  # 15 % of 400 go around every class
    assert np.median([estimate.ess for estimate in estimates[5:]]) > 1.3 * estimates[0].ess
    truth = Desirability.of(one.problem, one.space).value(place, t)
    for estimate in estimates:
        assert abs(estimate.value - truth) < 4.0 * estimate.value_error + 3e-3 * truth
