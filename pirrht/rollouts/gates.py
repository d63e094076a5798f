"""Gates in compiled rollouts: how log psi rises towards the free side of a wall that a point has yet to pass."""

from __future__ import annotations

import math

from pirrht.compiled.jit import inlined

GATES = 2  # of a row of a law
GATE = 5  # numbers of one: direction (x, y) of its free side, z on the guide, its change per meter [1/m], weight


@inlined
def mills(z):  # type: ignore[no-untyped-def]
    """phi(z) / Phi(z), by which log Phi grows with z."""
    if z > -6.0:
        return math.exp(-0.5 * z * z) * 0.7978845608028654 / math.erfc(-0.7071067811865476 * z)
    return -z + 1.0 / -z  # to z^-3


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
