"""The numbers that samples are made of: normal, independent, and the same for everyone who asks again."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from pirrht.jit.jit import kernel
from pirrht.jit.streams import exponential, fill_normals, logarithm, stream, uniform
from pirrht.jit.streams import normals as two_normals


@kernel
def _normals(seed, first, out):  # type: ignore[no-untyped-def]
    for s in range(out.shape[0]):
        state = stream(seed, first + s)
        for i in range(0, out.shape[1], 2):
            state, out[s, i], other = two_normals(state)
            if i + 1 < out.shape[1]:
                out[s, i + 1] = other


@kernel
def _normals_abreast(seed, sample, pairs, out):  # type: ignore[no-untyped-def]
    state = stream(seed, sample)
    for i in range(0, out.shape[0], 2 * pairs):
        state = fill_normals(state, pairs, out[i : i + 2 * pairs])


@kernel
def _of_each(u, logs, exponentials):  # type: ignore[no-untyped-def]
    for i in range(u.shape[0]):
        logs[i], exponentials[i] = logarithm(abs(u[i])), exponential(u[i])


@kernel
def _uniforms(seed, out):  # type: ignore[no-untyped-def]
    for s in range(out.shape[0]):
        state = stream(seed, s)
        for i in range(out.shape[1]):
            state, out[s, i] = uniform(state)


def normals(seed: int, samples: int, draws: int, first: int = 0) -> np.ndarray:
    out = np.empty((samples, draws))
    _normals(np.uint64(seed), first, out)
    return out


def of_each(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of sizes, and exponentials."""
    logs, exponentials = np.empty((2, len(u)), np.float32)
    _of_each(np.asarray(u, np.float32), logs, exponentials)
    return logs, exponentials.astype(float)


def uniforms(seed: int, samples: int, draws: int) -> np.ndarray:
    out = np.empty((samples, draws))
    _uniforms(np.uint64(seed), out)
    return out


def test_normals_drawn_abreast_are_those_drawn_one_after_the_other():
    for pairs in (1, 5, 16):
        abreast = np.empty(160)
        _normals_abreast(np.uint64(13), 7, pairs, abreast)
        assert np.array_equal(abreast, normals(13, 1, 160, first=7)[0])


def test_the_logarithm_is_within_the_rounding_of_its_numbers():
    u = np.concatenate([2.0 ** -np.arange(33.0), np.random.default_rng(0).random(20_000)]).astype(np.float32)
    np.testing.assert_allclose(of_each(u)[0], np.log(u.astype(float)), rtol=3e-7, atol=1e-7)


@pytest.mark.slow
def test_the_two_numbers_of_a_draw_have_a_uniform_direction_and_a_radius_that_does_not_depend_on_it():
    """2 million pairs of seed 21; Kolmogorov-Smirnov, and the mean of cos(k angle) times the squared radius."""
    pairs = normals(21, 2000, 2000).reshape(-1, 2)
    angle, square = np.arctan2(pairs[:, 1], pairs[:, 0]), np.sum(pairs**2, axis=1)
    assert kstest(angle, "uniform", args=(-np.pi, 2.0 * np.pi)).pvalue > 1e-3
    assert kstest(0.5 * square, "expon").pvalue > 1e-3
    for k in range(1, 9):
        for wave in (np.cos(k * angle), np.sin(k * angle)):
            # The variance of wave times a centred exponential of mean 2 is 1/2 times 4.
            assert abs(np.mean(wave * (square - 2.0))) < 4.5 * np.sqrt(2.0 / len(square)), k


def test_uniforms_are_uniform_and_below_one():
    u = uniforms(14, 1000, 200).ravel()
    assert u.min() >= 0.0
    assert u.max() < 1.0
    assert kstest(u, "uniform").pvalue > 1e-3


def test_samples_do_not_depend_on_their_neighbours():
    x = normals(16, 2000, 250)
    for values in (x, x**2 - 1.0):
        for gap in (1, 2, 3, 64):
            pairs = values[gap:] * values[:-gap]
            assert abs(pairs.mean()) / values.var() < 4.5 / np.sqrt(pairs.size), gap


def test_the_sum_of_the_first_draws_of_all_samples_has_the_law_of_independent_ones():
    """Columns are draws, rows samples: the sums over 500 samples, 400 of them, have variance 500 (chi-squared)."""
    assert 1e-3 < chi2.cdf(np.sum((normals(19, 500, 400).sum(axis=0) / np.sqrt(500)) ** 2), df=400) < 1 - 1e-3


def test_a_number_depends_on_seed_sample_and_draw_alone():
    whole = normals(20, 100, 50)
    np.testing.assert_array_equal(whole, normals(20, 100, 50))
    np.testing.assert_array_equal(whole[40:60], normals(20, 20, 50, first=40))
    np.testing.assert_array_equal(whole[:, :10], normals(20, 100, 10))
    assert len(np.unique(whole)) == whole.size


@pytest.mark.slow
def test_the_exponential_is_exact_to_three_in_ten_million():
    edges = -np.log(2.0) * (np.arange(120) + 0.5)  # where the power of two changes
    drawn = np.random.default_rng(0).uniform(-86.9, 0.0, 200_000)
    for x in (drawn, edges, np.nextafter(edges.astype(np.float32), np.float32(0.0)), -np.logspace(-30.0, 1.9, 1000)):
        x = np.asarray(x, np.float32)
        np.testing.assert_allclose(of_each(x)[1], np.exp(x.astype(float)), rtol=3e-7)
