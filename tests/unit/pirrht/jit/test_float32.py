"""Functions in single precision against those of numpy in double precision."""

from __future__ import annotations

import numpy as np
import pytest

from pirrht.jit.jit import kernel
from pirrht.jit.streams import exponential


@kernel
def exponentials(x, out):
    for i in range(len(x)):
        out[i] = exponential(x[i])


def found(x):
    x = np.asarray(x, np.float32)
    out = np.empty_like(x)
    exponentials(x, out)
    return out.astype(float), np.exp(x.astype(float))


@pytest.mark.slow
def test_the_exponential_is_exact_to_three_in_ten_million():
    edges = -np.log(2.0) * (np.arange(120) + 0.5)  # where the power of two changes
    drawn = np.random.default_rng(0).uniform(-86.9, 0.0, 200_000)
    for x in (drawn, edges, np.nextafter(edges.astype(np.float32), np.float32(0.0)), -np.logspace(-30.0, 1.9, 1000)):
        out, exact = found(x)
        np.testing.assert_allclose(out, exact, rtol=3e-7)


def test_the_exponential_of_nothing_is_one_and_falls():
    assert found([0.0, -0.0])[0].tolist() == [1.0, 1.0]
    out, _ = found(-np.linspace(0.0, 86.0, 100_000))
    assert np.all(np.diff(out) <= 4e-7 * out[1:])


@pytest.mark.parametrize("x", [-87.5, -1e3, -1e30, -np.inf])
def test_below_its_least_argument_the_exponential_stays_what_it_is_there(x):
    out, _ = found([x, -87.0])
    assert out[0] == out[1] == pytest.approx(np.exp(-87.0), rel=1e-5)
