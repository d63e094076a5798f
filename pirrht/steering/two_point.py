"""The exact two-point optimum of a double integrator with free duration (Webb and van den Berg 2013).

Among motions from (p0, v0) to (p1, v1) that take T seconds the one of least integral of q + (r/2) |a|^2 has an
acceleration linear in time. With D = p1 - p0 its cost is J(T) = q T + A / T^3 + B / T^2 + C / T, where

    fixed v1  A = 6 r |D|^2      B = -6 r D.(v0 + v1)   C = 2 r (|v0|^2 + v0.v1 + |v1|^2)
    free v1   A = (3/2) r |D|^2  B = -3 r D.v0          C = (3/2) r |v0|^2

A minimum is where q T^4 - C T^2 - 2 B T - 3 A goes from negative to positive, which it may do twice: either of two may
be the better one, and the wrong one can cost many times the optimum. A free v1 is written as not a number.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import kernel
from pirrht.systems.double_integrator import best_duration


@kernel
def optimum(tail, head, q, r):  # type: ignore[no-untyped-def]
    """Duration [s] and cost of the optimum between states (4,), as tuples of numbers; infinite from a free velocity."""
    if math.isnan(tail[2]):
        return np.inf, np.inf
    dx, dy, ux, uy = head[0] - tail[0], head[1] - tail[1], tail[2], tail[3]
    square, before = dx * dx + dy * dy, ux * ux + uy * uy
    if math.isnan(head[2]):
        if square == 0.0:
            return 0.0, 0.0
        return best_duration(q, 1.5 * r * square, -3.0 * r * (dx * ux + dy * uy), 1.5 * r * before)
    wx, wy = head[2], head[3]
    if square == 0.0 and ux == wx and uy == wy:
        return 0.0, 0.0
    along = dx * (ux + wx) + dy * (uy + wy)
    return best_duration(
        q, 6.0 * r * square, -6.0 * r * along, 2.0 * r * (before + ux * wx + uy * wy + wx * wx + wy * wy)
    )


@kernel
def accelerations(tail, head, T):  # type: ignore[no-untyped-def]
    """(c0x, c0y, c1x, c1y) of the optimal acceleration c0 + c1 s between states (4,) that takes T [s]."""
    dx, dy, ux, uy = head[0] - tail[0], head[1] - tail[1], tail[2], tail[3]
    if T <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    if math.isnan(head[2]):
        x, y = 3.0 * (dx - ux * T) / (T * T), 3.0 * (dy - uy * T) / (T * T)
        return x, y, -x / T, -y / T
    wx, wy = head[2], head[3]
    return (
        6.0 * dx / (T * T) - (4.0 * ux + 2.0 * wx) / T,
        6.0 * dy / (T * T) - (4.0 * uy + 2.0 * wy) / T,
        -12.0 * dx / (T * T * T) + 6.0 * (ux + wx) / (T * T),
        -12.0 * dy / (T * T * T) + 6.0 * (uy + wy) / (T * T),
    )
