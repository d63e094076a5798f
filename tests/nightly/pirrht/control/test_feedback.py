"""The long tests of unit/pirrht/control/test_feedback.py."""

import numpy as np
from unit.pirrht.control.test_feedback import START, noisy, plan  # noqa: F401

from pirrht.exact.desirability import Desirability


def test_a_step_aside_from_the_ridge_between_two_ways_the_law_turns_as_the_optimal_one_does(noisy, plan):
    """20000 samples per class; standard error of u about 0.03, held control off by 0.3 and more."""
    scenario, _ = noisy
    truth = Desirability.of(scenario.problem, scenario.space)
    beside = START + 0.08 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)])
    exact = truth.control(beside)
    followed = np.mean([np.sum((plan.law(x, 0.0) - u) ** 2) for x, u in zip(beside, exact, strict=True)])
    held = np.mean([np.sum((plan.control - u) ** 2) for u in exact])
    assert followed < 0.5 * held
