"""The shape of a tail is that of the distribution which weights are drawn from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import genpareto

from pirrht.estimation.weights import heavy, tail_shape


@pytest.mark.parametrize("shape", [-0.3, 0.0, 0.3, 0.6, 0.9, 1.3])
@pytest.mark.parametrize("log_scale", [-800.0, 0.0])
def test_weights_of_a_known_shape_are_told_it(shape, log_scale):
    """20 times 20 000 weights, seed 0: within three standard errors of its mean, and of the pull to one half."""
    rng = np.random.default_rng(0)
    drawn = [np.log(genpareto.rvs(shape, size=20_000, random_state=rng)) + log_scale for _ in range(20)]
    found = np.array([tail_shape(one) for one in drawn])
    pull = 10.0 * (0.5 - shape) / (3.0 * np.sqrt(20_000) + 10.0)
    assert abs(np.mean(found) - shape - pull) < 3.0 * np.std(found, ddof=1) / np.sqrt(20) + 0.01


def test_who_died_counts_for_the_number_of_samples_alone():
    z = np.random.default_rng(2).normal(size=5000)
    dead = np.concatenate([z, np.full(5000, -np.inf)])
    assert tail_shape(dead) == pytest.approx(tail_shape(np.concatenate([z, np.full(5000, -50.0)])), abs=1e-9)


@pytest.mark.parametrize("weights", [np.zeros(0), np.zeros(10), np.full(100, -np.inf), np.zeros(1000)])
def test_of_few_or_equal_weights_no_shape_is_told(weights):
    assert np.isnan(tail_shape(weights))
    assert not heavy(tail_shape(weights), len(weights))


def test_few_samples_stand_less_of_a_tail():
    assert heavy(0.65, 500)
    assert not heavy(0.65, 5000)
    assert heavy(0.71, 10**6)
