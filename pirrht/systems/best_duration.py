"""How long a mass takes best, between two states or into a goal that it may cross at any velocity.

The cost of an optimal motion that takes T seconds is J(T) = q T + A / T^3 + B / T^2 + C / T (Webb and van den Berg
2013; `steering.two_point` has the coefficients). It may have two minima.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import inlined, kernel

NEWTON = 60  # iterations at most; from above, where the quartic is convex, a few do
PRECISE = 1e-13  # relative change of T that ends them


@inlined
def _quartic(T, a, b, c):  # type: ignore[no-untyped-def]
    return ((T * T - c) * T - b) * T - a


@kernel
def _from_above(low, a, b, c):  # type: ignore[no-untyped-def]
    """The root of T^4 - c T^2 - b T - a beyond `low`, from where on it is convex; a, c >= 0."""
    T = max(max((3.0 * a) ** 0.25, np.cbrt(max(3.0 * b, 0.0))), math.sqrt(3.0 * c))
    T = max(T, 1.001 * low)
    for _ in range(NEWTON):
        slope = (4.0 * T * T - 2.0 * c) * T - b
        if slope <= 0.0:
            break
        step = _quartic(T, a, b, c) / slope
        T -= step
        if step <= PRECISE * T:
            break
    return T


@kernel
def _within(low, high, a, b, c):  # type: ignore[no-untyped-def]
    """The root between `low`, where the quartic is negative, and `high`, where it is positive."""
    for _ in range(100):
        T = 0.5 * (low + high)
        if _quartic(T, a, b, c) > 0.0:
            high = T
        else:
            low = T
        if high - low <= PRECISE * high:
            break
    return 0.5 * (low + high)


@kernel
def best_duration(q, A, B, C):  # type: ignore[no-untyped-def]
    """The duration T > 0 [s] of least J(T) = q T + A / T^3 + B / T^2 + C / T, and that J [cost]; A, C >= 0."""
    a, b, c = 3.0 * A / q, 2.0 * B / q, C / q
    b = -b if b == 0.0 else b
    # Extrema of the quartic: 4 T^3 - 2 c T - b = 0, three if the discriminant is positive.
    if c * c * c > 3.375 * b * b:
        radius = 2.0 * math.sqrt(c / 6.0)
        angle = math.acos(max(-1.0, min(1.0, 0.5 * b / (c * math.sqrt(c / 6.0) * (2.0 / 3.0))))) / 3.0
        last = radius * math.cos(angle)
        middle = radius * math.cos(angle - 4.0 * math.pi / 3.0)
        first = radius * math.cos(angle - 2.0 * math.pi / 3.0)
        middle, first = max(middle, first), min(middle, first)
    else:
        half = 0.125 * b
        root = math.sqrt(max(half * half - c * c * c / 216.0, 0.0))
        last = np.cbrt(half + root) + np.cbrt(half - root)
        middle, first = -1.0, -1.0
    best, T = np.inf, 0.0
    if middle > 0.0 and _quartic(middle, a, b, c) > 0.0:
        T = _within(max(first, 0.0), middle, a, b, c)
        best = q * T + ((A / T + B) / T + C) / T
    if not (middle > 0.0 and last > 0.0 and _quartic(last, a, b, c) > 0.0):
        bend = math.sqrt(c / 6.0)  # from here on the quartic is convex
        steep = bend > last and _quartic(bend, a, b, c) > 0.0
        other = _within(max(last, 0.0), bend, a, b, c) if steep else _from_above(max(last, bend), a, b, c)
        cost = q * other + ((A / other + B) / other + C) / other
        if cost < best:
            best, T = cost, other
    return T, best
