"""A point with mass that is pushed by forces: velocity is state, acceleration is control."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import jitable
from pirrht.systems.best_duration import best_duration
from pirrht.systems.dynamics import Dynamics, _check_noise

AIM = 0.9  # share of the goal's radius that is aimed at


@jitable
def coasting(x, p, out):  # type: ignore[no-untyped-def]
    """f = [vx, vy, 0, 0] at x (4,), written to out (4,) [m/s, m/s, m/s^2, m/s^2]."""
    out[0], out[1], out[2], out[3] = x[2], x[3], 0.0, 0.0


@jitable
def into_goal(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """What the best motion from x (4,) into the goal's disc, at any velocity there, begins with; written to out (2,).

    With D = p1 - p0 and lambda R^-1 = b^2 it is a = 3 (D - v T) / T^2, here in units of the noise b [1/sqrt(s)].
    p1 is where coasting enters the disc; if it misses that, a point as far off the middle as AIM of the radius.
    """
    dx, dy, b = aim[0] - x[0], aim[1] - x[1], B[0, 0]
    speed = x[2] * x[2] + x[3] * x[3]
    way = math.sqrt(speed) + 1e-9
    ahead = (dx * x[2] + dy * x[3]) / way
    off_x, off_y = dx - ahead * x[2] / way, dy - ahead * x[3] / way
    off = math.sqrt(off_x * off_x + off_y * off_y) + 1e-9
    beside = min(off, AIM * radius)
    depth = math.sqrt(radius * radius - beside * beside)
    depth = depth if ahead > depth else 0.0
    dx, dy = dx - beside * off_x / off - depth * x[2] / way, dy - beside * off_y / off - depth * x[3] / way
    r = 1.0 / (b * b * rate)  # of the control, for q = 1
    T, _ = best_duration(1.0, 1.5 * r * (dx * dx + dy * dy), -3.0 * r * (dx * x[2] + dy * x[3]), 1.5 * r * speed)
    scale = 3.0 / max(T * T * b, 1e-9)
    out[0], out[1] = scale * (dx - x[2] * T), scale * (dy - x[3] * T)


@dataclass(frozen=True, eq=False)
class DoubleIntegrator(Dynamics):
    """A mass of 1 kg pushed around: dp = v dt, dv = u dt + b dw; x = (p, v) (4,) [m, m/s], u (2,) [m/s^2].

    Raises:
        OptionError: b is not a positive number.
    """

    b: float = 0.1  # noise [m/s/sqrt(s)]

    n = 4
    m = 2
    states = ("x", "y", "vx", "vy")
    parameters = np.zeros(0)
    drift = staticmethod(coasting)
    homing = staticmethod(into_goal)

    def __post_init__(self) -> None:
        _check_noise(self.b)

    @cached_property
    def control_block(self) -> Array:  # type: ignore[override]
        """G_c = I, (2, 2); controls are accelerations [m/s^2]."""
        return np.eye(2)

    @cached_property
    def diffusion_block(self) -> Array:  # type: ignore[override]
        """B_c = b I, (2, 2) [m/s/sqrt(s)]."""
        return self.b * np.eye(2)

    def twist(self, x: Array, rate: Array) -> Array:
        """Accelerations along world x and y, (2,) [m/s^2]: forces on a mass of 1 kg [N]."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """Critically damped: the acceleration (2,) [m/s^2] of a spring and a damper at a place (2,) [m]."""
        return ((place - x[:2]) / within - 2.0 * x[2:]) / within
