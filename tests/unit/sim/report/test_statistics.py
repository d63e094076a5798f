"""Intervals and tests against published values, exact enumeration and their own coverage."""

from itertools import product
from math import comb

import numpy as np
import pytest

from sim.report.statistics import holm, mcnemar, mean, paired_shares, sign_flips, wilson


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilsons_interval_is_the_one_that_newcombe_tabulates(successes, runs, low, high):
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    found = wilson(successes, runs)
    assert found["value"] == successes / runs
    assert (found["low"], found["high"]) == pytest.approx((low, high), abs=5e-5)


def test_mcnemar_is_the_two_sided_sign_test():
    for gained, lost in product(range(8), range(8)):
        n, k = gained + lost, min(gained, lost)
        exact = min(1.0, 2 * sum(comb(n, i) for i in range(k + 1)) * 0.5**n)
        assert mcnemar(gained, lost) == pytest.approx(exact)
        assert mcnemar(gained, lost) == mcnemar(lost, gained)
    assert mcnemar(0, 6) == pytest.approx(0.03125)
    assert mcnemar(5, 15) == pytest.approx(0.04138947)
    assert mcnemar(0, 5000) == 0.0 or mcnemar(0, 5000) < 1e-300


def test_the_bootstrap_of_a_mean_agrees_with_the_normal_interval():
    x = np.random.default_rng(1).normal(3.0, 2.0, 400)
    found, half = mean(x), 1.96 * x.std() / np.sqrt(len(x))
    assert found["value"] == pytest.approx(x.mean())
    assert (found["low"], found["high"]) == pytest.approx((x.mean() - half, x.mean() + half), abs=0.08 * half)
    assert mean(x) == found


def test_the_difference_of_paired_shares_follows_bonett_and_price():
    """12 and 3 of 50: (13 - 4)/52 +- 1.96 sqrt((17/52 - (9/52)^2)/52)."""
    found = paired_shares(12, 3, 50)
    half = 1.959964 * np.sqrt((17 / 52 - (9 / 52) ** 2) / 52)
    assert found["value"] == pytest.approx(9 / 50)
    assert (found["low"], found["high"]) == pytest.approx((9 / 52 - half, 9 / 52 + half))
    assert not found["low"] <= 0.0 <= found["high"]
    even = paired_shares(3, 3, 50)
    assert even["low"] <= 0.0 <= even["high"]
    assert paired_shares(50, 0, 50)["high"] == 1.0


def test_sign_flips_enumerate_few_pairs_and_draw_for_many():
    d = np.array([1.0, 2.0, -0.5, 3.0])
    sums = [abs(sum(s * x for s, x in zip(signs, d, strict=True))) for signs in product((-1, 1), repeat=4)]
    assert sign_flips(d) == np.mean([s >= abs(d.sum()) - 1e-12 for s in sums])
    assert sign_flips([]) == sign_flips([0.0, 0.0]) == sign_flips([0.4]) == 1.0
    rng = np.random.default_rng(4)
    assert sign_flips(rng.normal(1.0, 1.0, 100)) == pytest.approx(1 / 10_001)


def test_holms_adjustment_is_the_textbook_one():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []
