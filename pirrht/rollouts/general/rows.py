"""Rows of a law, which has m modes per step or, where sways are drawn too, twice as many."""

from __future__ import annotations

from functools import cache
from typing import Any

from pirrht.compiled.jit import part
from pirrht.compiled.vectors import bounded, mixed, product, summed


@cache
def rows_of(n: int, m: int, most: int) -> tuple[Any, Any, Any, Any]:
    """Kernels for rows of m or of `most` modes, at addresses; they tell which by their last argument."""
    said_by_few, said_by_many = summed(n, m), summed(n, most)
    bind_few, bind_many = bounded(m), bounded(most)
    times_few, times_many = product(m, m), product(most, most)
    mix_few, mix_many = mixed(m), mixed(most)

    @part
    def said(out, row, beside, modes):  # type: ignore[no-untyped-def]
        """Write what a row of a law says at a state that is `beside` (n,) its own: a + K beside."""
        if modes == most:
            said_by_many(out, row, row + 8 * most, beside)
        else:
            said_by_few(out, row, row + 8 * m, beside)

    @part
    def bind(row, bound, modes):  # type: ignore[no-untyped-def]
        """Keep all of a row within plus and minus a bound."""
        if modes == most:
            bind_many(row, bound)
        else:
            bind_few(row, bound)

    @part
    def times(out, matrix, row, modes):  # type: ignore[no-untyped-def]
        """Write a matrix, which lies transposed, times a row."""
        if modes == most:
            times_many(out, matrix, row)
        else:
            times_few(out, matrix, row)

    @part
    def mix(out, x, a, y, b, modes):  # type: ignore[no-untyped-def]
        """Write a x + b y."""
        if modes == most:
            mix_many(out, x, a, y, b)
        else:
            mix_few(out, x, a, y, b)

    return said, bind, times, mix
