"""The law of any system: the step of it that is for the state nearest to a path's own, and what that says."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.compiled.addresses import load_float64
from pirrht.compiled.jit import inlined, part
from pirrht.compiled.vectors import bounded, mixed, product, summed
from pirrht.systems.heading import wrapped


@inlined
def columns_of(n, modes):  # type: ignore[no-untyped-def]
    """Where a row of a law (`law_width`) has slopes, its state, the deviation of noise, its inverse and log det."""
    there = modes + modes * n
    shape = there + n
    return modes, there, shape, shape + modes * modes, shape + 2 * modes * modes


@cache
def nearest_of(n: int, angles: int) -> Any:
    """The kernel (address, pitch, s, last, x, there, weights) that finds it from step s on, for states (n,).

    Bits of `angles` tell which are headings. Rows of the law begin at the address, `pitch` bytes apart; their states
    begin at column `there`, the weights of squares at `weights`. Steps are followed as long as they come nearer.
    """

    @part
    def apart(row, x, there, weights):  # type: ignore[no-untyped-def]
        """Square of how far x (n,) is from the state that a step of a law, a row at an address, is for."""
        total = 0.0
        for k in range(n):
            off = x[k] - load_float64(row, there + k)
            if (angles >> k) & 1:
                off = wrapped(off)
            total += load_float64(row, weights + k) * off * off
        return total

    @part
    def nearest(first, pitch, s, last, x, there, weights):  # type: ignore[no-untyped-def]
        """The step, up to the last one."""
        here = apart(first + pitch * s, x, there, weights)
        onward = apart(first + pitch * (s + 1), x, there, weights) if s < last else np.inf
        if onward < here:
            while onward < here:
                s, here = s + 1, onward
                onward = apart(first + pitch * (s + 1), x, there, weights) if s < last else np.inf
            return s
        while s > 0:
            onward = apart(first + pitch * (s - 1), x, there, weights)
            if onward >= here:
                break
            s, here = s - 1, onward
        return s

    return nearest


@cache
def sums_of(n: int, m: int, most: int) -> Any:
    """Kernels for rows of m or of `most` modes, at addresses: what a law says, bounds, products and mixtures.

    (out, row of the law, beside, modes) adds slopes times how far the state is off, (row, bound, modes) keeps it within
    the bound, (out, matrix, row, modes) multiplies, and (out, x, a, y, b, modes) writes a x + b y.
    """
    few, many = summed(n, m), summed(n, most)
    least, all_of = product(m, m), product(most, most)
    mix_few, mix_many = mixed(m), mixed(most)
    bind_few, bind_many = bounded(m), bounded(most)

    @part
    def said(out, row, beside, modes):  # type: ignore[no-untyped-def]
        if modes == most:
            many(out, row, row + 8 * most, beside)
        else:
            few(out, row, row + 8 * m, beside)

    @part
    def bound(row, most_of, modes):  # type: ignore[no-untyped-def]
        if modes == most:
            bind_many(row, most_of)
        else:
            bind_few(row, most_of)

    @part
    def multiplied(out, matrix, row, modes):  # type: ignore[no-untyped-def]
        if modes == most:
            all_of(out, matrix, row)
        else:
            least(out, matrix, row)

    @part
    def mix(out, x, a, y, b, modes):  # type: ignore[no-untyped-def]
        if modes == most:
            mix_many(out, x, a, y, b)
        else:
            mix_few(out, x, a, y, b)

    return said, bound, multiplied, mix
