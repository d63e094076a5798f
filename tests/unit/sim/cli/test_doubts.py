"""What `estimate` says where standard errors would mislead."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from sim.cli.tables import doubts
from sim.scenario import prepare

TEMPERATURE, VALUE = 0.1, 9.0
WAY = SimpleNamespace(id="0,0", cost=VALUE)


def said(*, ess: float = 100.0, heavy: bool = False, own: float = 100.0, weight: float = 1.0) -> Any:
    """An estimate of one class that has so many effective samples, and such a weight."""
    return SimpleNamespace(
        value=VALUE,
        ess=ess,
        doubtful=ess < 10.0,
        heavy_tailed=heavy,
        class_ess={"0,0": own},
        class_weights={"0,0": weight},
    )


def told(*estimates: Any, cost: float = VALUE) -> str:
    """All that is said of estimates, in one text."""
    way = SimpleNamespace(id=WAY.id, cost=cost)
    return "\n".join(doubts(estimates, [way], TEMPERATURE, None))


def test_estimates_that_may_be_trusted_are_not_doubted():
    assert told(said(), said(), None) == ""


def test_few_samples_are_told_before_their_tail_is():
    few = told(said(ess=3.0, heavy=True), said())
    assert "below 10 in 1 of 2 repeats" in few
    assert "heavy tail" not in few


def test_a_heavy_tail_is_told_where_enough_samples_weigh():
    assert "heavy tail in 2 of 3 repeats" in told(said(heavy=True), said(heavy=True), said())


def test_a_class_without_samples_is_told_unless_it_is_far_too_dear_to_matter():
    missed = said(own=1.0, weight=0.0)
    assert "class 0,0: hardly a sample in 2 of 2 repeats" in told(missed, missed)
    assert told(missed, missed, cost=VALUE + 6.0 * TEMPERATURE) == ""
    assert told(missed, said(weight=0.001), said(weight=0.001)) == ""
    assert "hardly a sample in 1 of 3" in told(missed, said(weight=0.2), said(weight=0.2))


def test_an_estimate_tells_the_tail_of_all_its_samples():
    """Of `slit` at b = 0.2 weights are light (2000 samples a class, seed 0)."""
    scenario = prepare("slit", given={"noise": 0.2, "vertices": 500, "samples": 2000})
    controller = scenario.driver(scenario.grown_tree())
    controller.begin(scenario.start)
    estimate = controller.plan(scenario.start).estimate
    assert estimate.tail < 0.6
    assert not estimate.heavy_tailed
    assert np.isfinite(estimate.tail)
