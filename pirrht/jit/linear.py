"""Small systems of linear equations inside kernels."""

from __future__ import annotations

from pirrht.jit.jit import kernel


@kernel
def solve(A, Y, X):  # type: ignore[no-untyped-def]
    """Solve A X = Y for small A (m, m) by elimination with row pivots; Y, X (m, k)."""
    m = A.shape[0]
    work = A.copy()
    for i in range(m):
        for k in range(Y.shape[1]):
            X[i, k] = Y[i, k]
    for i in range(m):
        pivot = i
        for r in range(i + 1, m):
            if abs(work[r, i]) > abs(work[pivot, i]):
                pivot = r
        for c in range(m):
            work[i, c], work[pivot, c] = work[pivot, c], work[i, c]
        for k in range(Y.shape[1]):
            X[i, k], X[pivot, k] = X[pivot, k], X[i, k]
        for r in range(m):
            if r != i:
                factor = work[r, i] / work[i, i]
                for c in range(i, m):
                    work[r, c] -= factor * work[i, c]
                for k in range(Y.shape[1]):
                    X[r, k] -= factor * X[i, k]
    for i in range(m):
        for k in range(Y.shape[1]):
            X[i, k] /= work[i, i]
