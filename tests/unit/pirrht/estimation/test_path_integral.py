"""Estimates against closed forms, and the symmetries that no choice of references or counts may break."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import (
    RIGHT,
    at_strip,
    strip,
    strip_space,
)

from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling

# -- invariances -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("guide", ["feedback", "open-loop"])
def test_a_reference_may_be_split_into_two_of_half_the_samples(guide):
    integral = path_integral(strip(0.5, 0.5), strip_space(0.5), Sampling(dt=0.05, samples=600, guide=guide))
    whole = at_strip(integral, 0.2, (1, -1), 3, counts=[600, 600])
    split = at_strip(integral, 0.2, (1, 1, -1), 3, counts=[200, 400, 600])
    np.testing.assert_allclose(split.rollouts.log_weight, whole.rollouts.log_weight, atol=1e-9)
    np.testing.assert_allclose(split.control, whole.control, atol=1e-9)


def test_without_the_likelihood_ratio_only_what_controls_cost_is_left_out():
    """With passive samples "biased" is what "balance" says; with samples that are driven, v lacks half of its cost."""
    b, L = 0.5, 0.5
    problem, space = strip(b, L), strip_space(L)
    said = {}
    for weights in ("balance", "biased"):
        for sides in ((), RIGHT):
            sampling = Sampling(dt=0.05, samples=4000, guide="open-loop", weights=weights)
            said[weights, sides] = at_strip(path_integral(problem, space, sampling), 0.2, sides, 3)
    assert said["biased", ()].value == said["balance", ()].value
    assert said["biased", RIGHT].value < 0.9 * said["balance", RIGHT].value
