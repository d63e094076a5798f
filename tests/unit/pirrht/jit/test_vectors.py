"""Sums of short rows at once are those of their numbers one by one, to the last bit."""

import numpy as np
import pytest

from pirrht.jit.jit import kernel
from pirrht.jit.vectors import affine, axpy, clip, matvec

SHAPES = [(2, 2), (3, 2), (4, 4), (5, 6), (1, 1)]


def drawn(*shape):
    """Numbers with seed 11."""
    return np.random.default_rng(11).normal(size=shape)


@pytest.mark.parametrize(("count", "width"), SHAPES)
def test_rows_times_factors_are_added_in_their_order(count, width):
    add, multiply = affine(count, width), matvec(count, width)

    @kernel
    def both(whole, without, first, rows, factors):
        add(whole.ctypes.data, first.ctypes.data, rows.ctypes.data, factors.ctypes.data)
        multiply(without.ctypes.data, rows.ctypes.data, factors.ctypes.data)

    first, rows, factors = drawn(width), drawn(count, width), drawn(count)
    whole, without = np.zeros(width), np.zeros(width)
    both(whole, without, first, rows, factors)
    for j in range(width):
        total, bare = first[j], rows[0, j] * factors[0]
        for k in range(count):
            total += rows[k, j] * factors[k]
        for k in range(1, count):
            bare += rows[k, j] * factors[k]
        assert whole[j] == total
        assert without[j] == bare


@pytest.mark.parametrize("width", [1, 2, 3, 4, 6])
def test_rows_are_mixed_and_kept_within_bounds_number_by_number(width):
    mix, bind = axpy(width), clip(width)

    @kernel
    def both(out, x, y):
        mix(out.ctypes.data, x.ctypes.data, 2.0, y.ctypes.data, -0.7)
        bind(x.ctypes.data, 0.3)

    x, y, out = drawn(width), drawn(width)[::-1].copy(), np.zeros(width)
    before = x.copy()
    both(out, x, y)
    np.testing.assert_array_equal(out, 2.0 * before + -0.7 * y)
    np.testing.assert_array_equal(x, np.clip(before, -0.3, 0.3))


def test_a_row_may_be_written_where_it_was_read():
    multiply = matvec(2, 2)

    @kernel
    def turned(matrix, row):
        multiply(row.ctypes.data, matrix.ctypes.data, row.ctypes.data)

    row = np.array([3.0, 5.0])
    turned(np.array([[0.0, 1.0], [1.0, 0.0]]), row)
    np.testing.assert_array_equal(row, [5.0, 3.0])
