"""Heading for gates: what a sample does that follows a reference with corners, inside compiled rollouts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.addresses import load_float64
from pirrht.compiled.float32 import HALF, ONE, TWO
from pirrht.compiled.jit import inlined, kernel

PASSED = 0.03  # a gate counts as passed this far before it [m]


class Gates(NamedTuple):
    """Gates of H references, at most C each; plain arrays, so that kernels can take them."""

    count: NDArray[np.int64]  # type: ignore[assignment]  # (H,) gates, the goal as the last one; 0: none
    place: Array  # (H, C, 8) corner [m]; unit normal in the direction of travel; unit vector along the gate, away
    # from the obstacle; what follows, along these two from the corner [m]
    decay: float  # k, of psi per meter [1/m]


TINY = np.float32(1e-18)  # [m^2]


BEFORE, BESIDE, BEHIND, BEND = (np.float32(v) for v in (8.0, 2.0 * math.pi, 4.0, 8.0))


ODD, EVEN = np.float32((BEHIND - BEFORE) / TWO), np.float32((BEHIND + BEFORE) / TWO - BESIDE)


@inlined
def mean_offset(a):  # type: ignore[no-untyped-def]
    """Mean of s under s exp(-(s - a)^2 / 2), s > 0, within 1 %; a and s in standard deviations.

    Were it (a + sqrt(a^2 + c)) / 2 with a constant c, that would have to be 8 far below 0, 2 pi at 0 and 4 far above.
    """
    square = a * a
    t = a / math.sqrt(square + BEND)
    return HALF * (a + math.sqrt(square + BESIDE + t * (ODD + t * EVEN)))


@inlined
def aim(along, side, far, beside, decay):  # type: ignore[no-untyped-def]
    """Where on the gate to head for, in meters outward of the corner.

    The state lies `along` before the gate and `side` outward of the corner, what follows `far` behind and `beside`; k
    is `decay` [1/m]. Single precision suffices for a guide, as long as the likelihood ratio is that of what was
    followed; it divides and takes roots four times as fast.
    """
    along, side, far, beside = np.float32(along), np.float32(side), np.float32(far), np.float32(beside)
    crossing = (side * far + beside * along) / (along + far)
    off, rest = crossing - side, beside - crossing
    first, second = along * along + off * off, far * far + rest * rest
    one, two = math.sqrt(first), math.sqrt(second)
    # l'' = along^2 / first^1.5 + far^2 / second^1.5 over one denominator; sigma^2 = 1 / (decay l'')
    above = np.float32(decay) * (along * along * second * two + far * far * first * one)
    below = first * one * second * two
    scale = ONE / math.sqrt(above * below)
    return below * scale * mean_offset(crossing * above * scale)


@inlined
def towards(dx, dy):  # type: ignore[no-untyped-def]
    """One over the length of a vector (dx, dy) [1/m], in single precision."""
    x, y = np.float32(dx), np.float32(dy)
    return ONE / math.sqrt(x * x + y * y + TINY)


@inlined
def next_gate(place, at, last, s, x, y, decay):  # type: ignore[no-untyped-def]
    """The gate next for (x, y), the s-th or the one after it, and the vector to where to head for on it [m].

    Args: address of `Gates.place`, index of the reference's first gate, number of its last one, s, (x, y) [m], k [1/m].
    """
    k = 8 * (at + s)
    dx, dy = load_float64(place, k) - x, load_float64(place, k + 1) - y
    along = dx * load_float64(place, k + 2) + dy * load_float64(place, k + 3)
    if s < last and along < PASSED:
        s, k = s + 1, k + 8
        dx, dy = load_float64(place, k) - x, load_float64(place, k + 1) - y
        along = max(dx * load_float64(place, k + 2) + dy * load_float64(place, k + 3), PASSED)
    if s < last:
        nx, ny = load_float64(place, k + 4), load_float64(place, k + 5)
        far, beside = load_float64(place, k + 6), load_float64(place, k + 7)
        shift = aim(along, -(dx * nx + dy * ny), far, beside, decay)
        dx, dy = dx + shift * nx, dy + shift * ny
    return s, dx, dy


@kernel
def heading(gates, g, stage, x, y, out):  # type: ignore[no-untyped-def]
    """Write the unit vector from (x, y) [m] to the next gate of g, from `stage` on, to out (2,); returns its number."""
    place, at = gates.place.ctypes.data, g * gates.place.shape[1]
    before, dx, dy = -1, 0.0, 0.0
    while stage != before:
        before = stage
        stage, dx, dy = next_gate(place, at, gates.count[g] - 1, before, x, y, gates.decay)
    scale = towards(dx, dy)
    out[0], out[1] = scale * dx, scale * dy
    return stage
