"""What gates push: the rate at which the logarithm of a normal probability rises."""

import math

import numpy as np
import pytest

from pirrht.rollouts.general.law import MILLS, TUNING, mills


def exact(z):
    return math.exp(-0.5 * z * z) * math.sqrt(2.0 / math.pi) / math.erfc(-z / math.sqrt(2.0))


def test_the_rate_read_off_the_table_is_the_ratio_of_density_to_probability():
    """4000 places drawn with seed 3."""
    for z in np.random.default_rng(3).uniform(TUNING.mills_from, TUNING.mills_to, 4000):
        assert mills(z) == pytest.approx(exact(z), rel=1e-4)


def test_between_rows_it_changes_as_its_own_equation_says():
    """h' = -h (z + h), whose slopes the cubic has at both rows: differences over 1e-4 agree to a thousandth."""
    for z in np.random.default_rng(4).uniform(-5.9, 3.0, 1000):
        slope = (mills(z + 1e-4) - mills(z - 1e-4)) / 2e-4
        assert slope == pytest.approx(-exact(z) * (z + exact(z)), rel=2e-3)


def test_beyond_the_table_it_goes_on_without_a_jump_that_matters():
    assert mills(TUNING.mills_from) == pytest.approx(MILLS[0], rel=2e-3)
    assert mills(-30.0) == pytest.approx(30.0 + 1.0 / 30.0, rel=1e-6)
    assert mills(TUNING.mills_to) == 0.0
    assert MILLS[-1] < 1e-8
