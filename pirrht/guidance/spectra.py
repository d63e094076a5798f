"""Small symmetric matrices inside compiled kernels: their eigenvalues, and functions of them."""

from __future__ import annotations

import math

from pirrht.compiled.jit import kernel

SWEEPS = 12  # of Jacobi's method at most; it converges quadratically


@kernel
def diagonalise(A, vectors):  # type: ignore[no-untyped-def]
    """Turn symmetric A (m, m) into the diagonal of its eigenvalues, by Jacobi's rotations; `vectors` (m, m) in columns.

    What stands off the diagonal of A afterwards means nothing.
    """
    m = A.shape[0]
    for i in range(m):
        for j in range(m):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        off, size = 0.0, 0.0
        for i in range(m):
            size += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if off <= 1e-28 * size:
            return
        for i in range(m):
            for j in range(i):
                if A[i, j] == 0.0:
                    continue
                half = 0.5 * (A[j, j] - A[i, i]) / A[i, j]
                t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + math.sqrt(half * half + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(m):
                    A[k, i], A[k, j] = c * A[k, i] - s * A[k, j], s * A[k, i] + c * A[k, j]
                for k in range(m):
                    A[i, k], A[j, k] = c * A[i, k] - s * A[j, k], s * A[i, k] + c * A[j, k]
                for k in range(m):
                    one, other = vectors[k, i], vectors[k, j]
                    vectors[k, i], vectors[k, j] = c * one - s * other, s * one + c * other


@kernel
def recompose(A, vectors, out):  # type: ignore[no-untyped-def]
    """Write V diag(A) V' to out (m, m), of the diagonal of A (m, m) and vectors V (m, m) in columns."""
    m = A.shape[0]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for k in range(m):
                total += vectors[i, k] * A[k, k] * vectors[j, k]
            out[i, j] = total
