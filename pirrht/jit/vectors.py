"""Rows of numbers inside kernels: copies, sums, and small linear systems.

Numba assigns slices with a message for shapes that differ, which takes a seventh of the time that kernels compile.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numpy.typing import NDArray

from pirrht.jit.jit import jitable, kernel, load_float64, part, store_float64


@jitable
def copy_row(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (n,) to out (n,)."""
    for i in range(out.shape[0]):
        out[i] = source[i]


@jitable
def copy_rows(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (k, n) to out (k, n)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]


@kernel
def solve(A, Y, X):  # type: ignore[no-untyped-def]
    """Solve A X = Y for small A (m, m) by elimination with row pivots; Y, X (m, k)."""
    m, width = A.shape[0], Y.shape[1]
    work = A.copy()
    copy_rows(Y, X)
    for i in range(m):
        pivot = i
        for r in range(i + 1, m):
            if abs(work[r, i]) > abs(work[pivot, i]):
                pivot = r
        for c in range(m):
            work[i, c], work[pivot, c] = work[pivot, c], work[i, c]
        for k in range(width):
            X[i, k], X[pivot, k] = X[pivot, k], X[i, k]
        for r in range(m):
            if r != i:
                factor = work[r, i] / work[i, i]
                for c in range(i, m):
                    work[r, c] -= factor * work[i, c]
                for k in range(width):
                    X[r, k] -= factor * X[i, k]
    for i in range(m):
        for k in range(width):
            X[i, k] /= work[i, i]


@cache
def axpy(width: int) -> Any:
    """Return the function (out, x, a, y, b), of addresses and numbers, that writes a x + b y of rows of that width."""

    @part
    def combine(out, x, a, y, b):  # type: ignore[no-untyped-def]
        for j in range(width):
            store_float64(out, j, a * load_float64(x, j) + b * load_float64(y, j))

    return combine


@cache
def matvec(count: int, width: int) -> Any:
    """Return the function (out, rows, factors), of addresses, that writes sum_k factors_k rows_k.

    There are `count` rows of `width` numbers, one after the other; the output overlaps none of them.
    """

    @part
    def multiply(out, rows, factors):  # type: ignore[no-untyped-def]
        for j in range(width):
            total = 0.0
            for k in range(count):
                total += load_float64(factors, k) * load_float64(rows, k * width + j)
            store_float64(out, j, total)

    return multiply
