"""Copies inside kernels, element by element.

With every assignment of an array to a slice numba compiles a message about shapes that differ: a seventh of the time
that kernels of a system of one's own took.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from pirrht.jit.jit import jitable


@jitable
def copy_row(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (n,) to out, which is as long."""
    for i in range(out.shape[0]):
        out[i] = source[i]


@jitable
def copy_rows(source: NDArray[Any], out: NDArray[Any]) -> None:
    """Write source (k, n) to out, which is as large."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = source[i, j]
