"""The long tests of unit/pirrht/proposals/test_unicycle_guides.py."""

from __future__ import annotations

import numpy as np
import pytest
from batches import batch_of
from guides import best
from unit.pirrht.proposals.test_unicycle_guides import WINDING, narrow, setting, tapes

from pirrht.estimation.assembly import path_integral
from pirrht.proposals.guide import DDPGuide
from pirrht.steering.motion import running_cost


def test_feedback_holds_noisy_paths_together():
    spread = {}
    for guide_by in ("feedback", "open-loop"):
        integral, times, guides = setting(guide=guide_by)
        leaders = guides[:1] if guide_by == "feedback" else None
        tape = guides[0].tape[None]
        batch = batch_of(integral, np.zeros(3), times, tape, counts=[300], guides=leaders)
        rollouts = integral.rollout(batch, 1)
        states, steps = integral.replay.trace(rollouts, np.arange(300))
        at = 22  # beside the post
        under_way = states[steps > at, at]
        off = under_way[:, :2] - guides[0].states[at, :2]
        spread[guide_by] = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    assert spread["feedback"] < 0.02
    assert spread["feedback"] < 0.4 * spread["open-loop"]


def test_both_ways_of_guiding_estimate_the_same_value():
    values = {}
    for guide_by, samples in (("feedback", 2000), ("open-loop", 60000)):
        integral, times, guides = setting(False, 0.3, 2.0, guide=guide_by)
        batch = batch_of(
            integral, np.zeros(3), times, tapes(times, False, 0.3, 2.0), counts=[samples] * len(guides),
            guides=guides if guide_by == "feedback" else None,
        )  # fmt: skip
        found = [integral.estimate(integral.rollout(batch, seed)).value for seed in range(8)]
        values[guide_by] = np.mean(found), np.std(found, ddof=1) / np.sqrt(len(found))
    (one, error_one), (two, error_two) = values["feedback"], values["open-loop"]
    assert abs(one - two) < 3.0 * np.hypot(error_one, error_two)


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
