"""Steer towards the goal's disc past the end of a law, inside compiled rollouts."""

from __future__ import annotations

import math

from pirrht.compiled.jit import inlined, jitable
from pirrht.systems.heading import TURN_GAIN, beyond_disc

STEEP = 6.0  # |u| of a guide stays below this


@inlined
def homing(x, y, theta, gx, gy, radius, bound):  # type: ignore[no-untyped-def]
    """Turn rate that brings the goal's disc ahead of (x, y) [m], at most `bound`; none where it lies ahead [rad/s]."""
    return max(-bound, min(bound, TURN_GAIN * beyond_disc(gx - x, gy - y, theta, radius)))


@jitable
def straight_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Head straight for the goal from x (2,) at the best speed: `Dynamics.homing` of a point among moving obstacles."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    det = B[0, 0] * B[1, 1] - B[0, 1] * B[1, 0]
    a, b = (B[1, 1] * dx - B[0, 1] * dy) / det, (B[0, 0] * dy - B[1, 0] * dx) / det
    size = math.sqrt(a * a + b * b) + 1e-12
    scale = math.sqrt(2.0 * rate) / size
    out[0], out[1] = scale * a, scale * b


@jitable
def car_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Turn a car at x (3,) towards the goal: its `Dynamics.homing` among moving obstacles."""
    bound = STEEP * math.sqrt(rate) * B[0, 0]
    out[0] = homing(x[0], x[1], x[2], aim[0], aim[1], radius, bound) / B[0, 0]
