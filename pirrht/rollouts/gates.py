"""Bend log psi by gates: its rise towards the free side of a wall that a point has yet to pass."""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import inlined

GATES = 2  # of a row of a law
GATE = 5  # numbers of one: direction (x, y) of its free side, z on the guide, its change per meter [1/m], weight


FAR_IN, FAR_OUT, PER_UNIT = -6.0, 6.0, 16  # where its table begins and ends, and rows of that per unit of z
_AT = np.linspace(FAR_IN, FAR_OUT, int((FAR_OUT - FAR_IN) * PER_UNIT) + 1)
MILLS = np.exp(-0.5 * _AT**2) * math.sqrt(2.0 / math.pi) / np.array([math.erfc(-z / math.sqrt(2.0)) for z in _AT])


@inlined
def mills(z):  # type: ignore[no-untyped-def]
    """phi(z) / Phi(z), by which log Phi grows with z, within 1e-4 of itself between FAR_IN and FAR_OUT.

    It is h with h' = -h (z + h), so a cubic between two rows of a table has both slopes at no more than their h.
    """
    if z <= FAR_IN:
        return -z + 1.0 / -z  # to z^-3
    if z >= FAR_OUT:
        return 0.0
    at = (z - FAR_IN) * PER_UNIT
    k = int(at)
    u, left, right, width = at - k, MILLS[k], MILLS[k + 1], 1.0 / PER_UNIT
    begin = FAR_IN + width * k
    rise, fall = -width * left * (begin + left), -width * right * (begin + width + right)
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * left + u * rise) + u * u * ((1.0 + 2.0 * v) * right - v * fall)


@inlined
def gate_slope(law, g, s, at, dx, dy):  # type: ignore[no-untyped-def]
    """Slope (x, y) of log psi that gates add [1/m], (dx, dy) [m] off the guide; row s of a law has them from `at`."""
    sx, sy = 0.0, 0.0
    for k in range(GATES):
        first = at + GATE * k
        per = law[g, s, first + 3]
        if per > 0.0:
            nx, ny = law[g, s, first], law[g, s, first + 1]
            push = law[g, s, first + 4] * per * mills(law[g, s, first + 2] + per * (nx * dx + ny * dy))
            sx, sy = sx + push * nx, sy + push * ny
    return sx, sy
