"""The long tests of unit/pirrht/estimation/test_path_integral_traps.py."""

from __future__ import annotations

import numpy as np
import pytest
from unit.pirrht.estimation.test_path_integral_traps import car, driven

from pirrht.outcome import Outcome


def test_weights_stay_finite_where_collisions_cost_a_million_lambda():
    problem, _ = car()
    assert problem.temperature == pytest.approx(0.0009)
    assert problem.phi / problem.temperature > 1e6
    around = driven([np.zeros(3), np.array([2.0, 0.56, 0.0]), np.array([4.0, 0.0, -0.6])])
    collided = around.rollouts.paths.outcome == Outcome.COLLISION
    assert 0 < collided.sum() < around.rollouts.size
    assert np.all(np.isfinite(around.rollouts.log_weight))
    assert np.all(around.weight[collided] == 0.0)
    assert around.weight.sum() == pytest.approx(1.0)
    assert 3.5 < around.value < 6.0
