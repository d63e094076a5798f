"""Sums of short rows are those of their numbers one by one; small linear systems have the solutions of numpy."""

import numpy as np
import pytest

from pirrht.jit.jit import kernel
from pirrht.jit.vectors import axpy, blended, matvec, solve


def drawn(*shape):
    """Numbers with seed 11."""
    return np.random.default_rng(11).normal(size=shape)


@pytest.mark.parametrize(("count", "width"), [(2, 2), (3, 2), (5, 6), (1, 1)])
def test_rows_times_factors_are_added_in_their_order(count, width):
    multiply, add = matvec(count, width), axpy(width)

    @kernel
    def both(out, mixed, rows, factors):
        multiply(out.ctypes.data, rows.ctypes.data, factors.ctypes.data)
        add(mixed.ctypes.data, rows.ctypes.data, 2.0, out.ctypes.data, -0.7)

    rows, factors, out, mixed = drawn(count, width), drawn(count), np.zeros(width), np.zeros(width)
    both(out, mixed, rows, factors)
    assert out.tolist() == [sum((rows[k, j] * factors[k] for k in range(count)), 0.0) for j in range(width)]
    np.testing.assert_array_equal(mixed, 2.0 * rows[0] + -0.7 * out)


@pytest.mark.parametrize("m", [1, 2, 4])
def test_small_systems_are_solved(m):
    A, Y, X = drawn(m, m), drawn(m, 3), np.zeros((m, 3))
    A[0, 0] = 0.0 if m > 1 else 1.0  # a row that needs a pivot
    solve(A, Y, X)
    np.testing.assert_allclose(A @ X, Y, atol=1e-12)


def test_numbers_are_blended_between_four_rows():
    @kernel
    def blend(first, second):
        return blended(first.ctypes.data, second.ctypes.data, np.float32(0.25), np.float32(0.5), np.float32(0.75))

    (a, b), (c, d) = first, second = drawn(2, 2, 4).astype(np.float32)
    low, high = 0.75 * a + 0.25 * b, 0.5 * c + 0.5 * d
    np.testing.assert_allclose(blend(first, second), low + 0.75 * (high - low), rtol=1e-6)
