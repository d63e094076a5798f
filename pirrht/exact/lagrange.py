"""Cubic Lagrange interpolation between four neighbouring points of a grid."""

from __future__ import annotations

from pirrht.compiled.jit import inlined


@inlined
def polynomial(t, c):  # type: ignore[no-untyped-def]
    """Value at t [spacings] of the cubic polynomial that is 1 at point c of -1, 0, 1, 2 and 0 at the others."""
    if c == -1:
        return -t * (t - 1.0) * (t - 2.0) / 6.0
    if c == 0:
        return (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    if c == 1:
        return -(t + 1.0) * t * (t - 2.0) / 2.0
    return (t + 1.0) * t * (t - 1.0) / 6.0


@inlined
def derivative(t, c):  # type: ignore[no-untyped-def]
    """Its derivative at t [1/spacing]."""
    if c == -1:
        return -(3.0 * t * t - 6.0 * t + 2.0) / 6.0
    if c == 0:
        return (3.0 * t * t - 4.0 * t - 1.0) / 2.0
    if c == 1:
        return -(3.0 * t * t - 2.0 * t - 2.0) / 2.0
    return (3.0 * t * t - 1.0) / 6.0
