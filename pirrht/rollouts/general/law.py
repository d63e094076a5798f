"""The step of a law that is for the state nearest to a path's own."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.compiled.addresses import load_float64
from pirrht.compiled.jit import inlined, part
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
