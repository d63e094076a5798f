"""Gaussian sums over a planar grid of numbers that span thousands of nats: each tile has an exponent of its own."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel

TILE = 16  # points along each side of a tile


def one_round(phi: Array, power: Array, into: Array, known: Array, taps: Array, loss: float) -> tuple[Array, Array]:
    """One application of `phi = exp(-loss) E[psi]` with psi = into phi + known; returns phi and power.

    Args:
        phi: (nx, ny), scaled tile by tile: what is meant is phi exp(power).
        power: (nx/TILE, ny/TILE) exponent of each tile [nats].
        into, known: (nx, ny).
        taps: (2 R + 1,) weights of the Gaussian along each axis.
        loss: q dt/lambda [nats].
    """
    source, first = np.empty_like(phi), np.empty_like(power)
    _combine(phi, power, into, known, source, first)
    middle, second = np.empty_like(phi), np.empty_like(power)
    _along_y(source, first, taps, middle, second)
    out, third = np.empty_like(phi), np.empty_like(power)
    _along_x(middle, second, taps, out, third)
    return out, third - loss


def logarithm(phi: Array, power: Array) -> Array:
    """log phi at every point, (nx, ny) [nats], of phi (nx, ny) and power (nx/TILE, ny/TILE) [nats]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        value: Array = np.log(np.maximum(phi, 0.0)) + np.kron(power, np.ones((TILE, TILE)))
    return value


@kernel
def _combine(phi, power, into, known, out, raised):  # type: ignore[no-untyped-def]
    """psi = into * phi + known, tile by tile with a new exponent."""
    for a in range(power.shape[0]):
        for b in range(power.shape[1]):
            i, j = a * TILE, b * TILE
            most = 0.0
            for k in range(i, i + TILE):
                for e in range(j, j + TILE):
                    most = max(most, known[k, e])
            base = max(power[a, b], math.log(most) if most > 0.0 else -math.inf)
            raised[a, b] = base
            if base == -math.inf:
                out[i : i + TILE, j : j + TILE] = 0.0
                continue
            old, new = math.exp(power[a, b] - base), math.exp(-base) if most > 0.0 else 0.0
            for k in range(i, i + TILE):
                for e in range(j, j + TILE):
                    out[k, e] = into[k, e] * phi[k, e] * old + known[k, e] * new


@kernel
def _along_y(source, power, taps, out, raised):  # type: ignore[no-untyped-def]
    """Convolve every row with the taps."""
    reach = taps.shape[0] // 2
    wide = -(-reach // TILE)
    window = np.zeros((2 * wide + 1) * TILE)
    for a in range(power.shape[0]):
        for b in range(power.shape[1]):
            base = -math.inf
            for c in range(max(b - wide, 0), min(b + wide + 1, power.shape[1])):
                base = max(base, power[a, c])
            most = 0.0
            for k in range(a * TILE, (a + 1) * TILE):
                if base == -math.inf:
                    out[k, b * TILE : (b + 1) * TILE] = 0.0
                    continue
                window[:] = 0.0
                for c in range(max(b - wide, 0), min(b + wide + 1, power.shape[1])):
                    factor = math.exp(power[a, c] - base)
                    at = (c - b + wide) * TILE
                    for e in range(TILE):
                        window[at + e] = source[k, c * TILE + e] * factor
                for e in range(TILE):
                    total = 0.0
                    first = wide * TILE + e - reach
                    for t in range(taps.shape[0]):
                        total += taps[t] * window[first + t]
                    out[k, b * TILE + e] = total
                    most = max(most, abs(total))
            raised[a, b] = _normalise(out, a, b, base, most)


@kernel
def _along_x(source, power, taps, out, raised):  # type: ignore[no-untyped-def]
    """Convolve every column with the taps."""
    reach = taps.shape[0] // 2
    wide = -(-reach // TILE)
    factor = np.zeros(2 * wide + 1)
    for a in range(power.shape[0]):
        low, high = max(a - wide, 0), min(a + wide + 1, power.shape[0])
        for b in range(power.shape[1]):
            base = -math.inf
            for c in range(low, high):
                base = max(base, power[c, b])
            out[a * TILE : (a + 1) * TILE, b * TILE : (b + 1) * TILE] = 0.0
            most = 0.0
            if base > -math.inf:
                for c in range(low, high):
                    factor[c - a + wide] = math.exp(power[c, b] - base)
                for k in range(a * TILE, (a + 1) * TILE):
                    for t in range(max(k - reach, 0), min(k + reach + 1, source.shape[0])):
                        f = taps[t - k + reach] * factor[t // TILE - a + wide]
                        for e in range(b * TILE, (b + 1) * TILE):
                            out[k, e] += f * source[t, e]
                    for e in range(b * TILE, (b + 1) * TILE):
                        most = max(most, abs(out[k, e]))
            raised[a, b] = _normalise(out, a, b, base, most)


@inlined
def _normalise(out, a, b, base, most):  # type: ignore[no-untyped-def]
    """Scale a tile to a greatest entry of one; its exponent."""
    if most == 0.0:
        return -math.inf
    for k in range(a * TILE, (a + 1) * TILE):
        for e in range(b * TILE, (b + 1) * TILE):
            out[k, e] /= most
    return base + math.log(most)
