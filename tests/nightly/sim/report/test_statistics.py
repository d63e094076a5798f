"""The long tests of unit/sim/report/test_statistics.py."""

import numpy as np
import pytest

from sim.report.statistics import mean, sign_flips


def test_the_bootstrap_covers_as_often_as_it_says():
    rng = np.random.default_rng(2)
    hits = [(i := mean(rng.exponential(1.0, 60), seed=seed))["low"] <= 1.0 <= i["high"] for seed in range(200)]
    assert 0.88 <= np.mean(hits) <= 0.985


def test_p_values_of_random_sign_flips_are_uniform():
    rng = np.random.default_rng(4)
    p = [sign_flips(rng.normal(0.0, 1.0, 30), seed) for seed in range(200)]
    assert 0.01 <= np.mean(np.array(p) < 0.05) <= 0.1
    assert np.mean(p) == pytest.approx(0.5, abs=0.08)
