"""A mass in space that is pushed by forces: what a multicopter is to its planner."""

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import jitable
from pirrht.systems.double_integrator import best_duration
from pirrht.systems.dynamics import HOMING, IsotropicNoise


@jitable
def coasting(x, p, out):  # type: ignore[no-untyped-def]
    """f = [v, 0] at x = (p, v) (6,), written to out (6,) [m/s, m/s^2]."""
    d = out.shape[0] // 2
    for k in range(d):
        out[k] = x[d + k]
        out[d + k] = 0.0


@jitable
def into_ball(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Begin the best motion from x (6,) into the goal's ball, at any velocity there; written to out (3,) [1/sqrt(s)].

    As `double_integrator.into_goal`: it aims at where coasting enters the ball, or if it misses that, at a point as far
    off the middle as a share of the radius.
    """
    b = B[0, 0]
    speed = 0.0
    ahead = 0.0
    for k in range(3):
        speed += x[3 + k] * x[3 + k]
        ahead += (aim[k] - x[k]) * x[3 + k]
    way = speed**0.5 + 1e-9
    ahead /= way

    off = 0.0
    for k in range(3):
        out[k] = aim[k] - x[k] - ahead * x[3 + k] / way  # across the way
        off += out[k] * out[k]
    off = off**0.5 + 1e-9
    aside = min(off, HOMING.aim * radius)
    depth = (radius * radius - aside * aside) ** 0.5
    depth = depth if ahead > depth else 0.0

    square = 0.0
    along = 0.0
    for k in range(3):
        out[k] = aim[k] - x[k] - aside * out[k] / off - depth * x[3 + k] / way
        square += out[k] * out[k]
        along += out[k] * x[3 + k]
    r = 1.0 / (b * b * rate)  # of the control, for q = 1
    T, _ = best_duration(1.0, 1.5 * r * square, -3.0 * r * along, 1.5 * r * speed)
    scale = 3.0 / max(T * T * b, 1e-9)
    for k in range(3):
        out[k] = scale * (out[k] - x[3 + k] * T)


@dataclass(frozen=True, eq=False)
class Drone(IsotropicNoise):
    """A mass of 1 kg in space: dp = v dt, dv = u dt + b dw; x = (p, v) (6,) [m, m/s], u (3,) [m/s^2], b > 0."""

    b: float = 0.1  # noise [m/s/sqrt(s)]

    n = 6
    m = 3
    states = ("x", "y", "z", "vx", "vy", "vz")
    position = (0, 1, 2)
    drift = staticmethod(coasting)
    homing = staticmethod(into_ball)

    def twist(self, x: Array, rate: Array) -> Array:
        """Accelerations along world axes, (3,) [m/s^2]: forces on a mass of 1 kg [N]."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """Critically damped: the acceleration (3,) [m/s^2] of a spring and a damper at a place (3,) [m]."""
        return np.asarray(((place - x[:3]) / within - 2.0 * x[3:]) / within)
