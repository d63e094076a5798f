"""The long tests of unit/pirrht/proposals/test_ways.py."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import annulus
from scipy.special import k0, k1
from solved import slope

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling

# -- closed forms ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("b", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("radius", [0.1, 0.3])
def test_in_an_empty_room_a_way_climbs_the_bessel_function(radius, b):
    """psi = K0(k r) / K0(k radius) around the goal, of slope -k K1 / K0; sections pass it on without losing it."""
    problem, space = annulus(b, radius)
    integral, k = path_integral(problem, space, Sampling()), 1.0 / b**2
    for r in (0.5, 1.2, 3.0, 6.0):
        x = r * np.array([np.cos(0.7), np.sin(0.7)])
        lead = integral.proposals.climbing(x, np.zeros((1, 2)))
        steep = k * k1(k * r) / k0(k * r)
        np.testing.assert_allclose(slope(integral, lead, x), -steep * x / r, atol=0.02 * steep)
        exact = np.log(k0(k * r) / k0(k * radius))
        # What a first section takes psi of the disc for is off by what the rim does, 1 / (8 k radius), and no more.
        assert lead.promise == pytest.approx(exact, abs=0.01 + 0.15 / (k * radius))
