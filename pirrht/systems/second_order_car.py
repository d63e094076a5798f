"""A car with inertia: it turns and accelerates, so heading and speed are state and both are noisy."""

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import jitable
from pirrht.systems.dynamics import HOMING, IsotropicNoise, ahead, beyond_disc

CRUISE = 1.0  # speed at which a meter costs least [m/s]


@jitable
def rolling(x, p, out):  # type: ignore[no-untyped-def]
    """f = [v cos theta, v sin theta, 0, 0] at x (4,), written to out (4,) [m/s, m/s, rad/s, m/s^2]."""
    out[0] = x[3] * math.cos(x[2])
    out[1] = x[3] * math.sin(x[2])
    out[2] = 0.0
    out[3] = 0.0


@jitable
def cruising(x, p):  # type: ignore[no-untyped-def]
    """q = 1 + (v / CRUISE)^2 [cost/s] at x (4,), for parameters p (0,): the cost of a puck of q = 1, R = 2I at v."""
    return 1.0 + (x[3] / CRUISE) ** 2


@jitable
def towards_goal(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Turn until the goal's disc lies ahead, and drive there at CRUISE, forwards or as it already goes; out (2,)."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    way = -1.0 if x[3] < 0.0 and dx * math.cos(x[2]) + dy * math.sin(x[2]) < 0.0 else 1.0
    beyond = beyond_disc(way * dx, way * dy, x[2], radius)
    out[0] = HOMING.gain * beyond / B[0, 0]
    out[1] = HOMING.gain * (way * CRUISE * max(HOMING.slowest, math.cos(beyond)) - x[3]) / B[1, 1]


@dataclass(frozen=True, eq=False)
class SecondOrderCar(IsotropicNoise):
    """A car that turns and accelerates: dtheta = u_1 dt + b dw_1, dv = u_2 dt + b dw_2, and it moves along theta at v.

    The state is x, y [m], heading theta [rad] and speed v [m/s], (4,), negative where it reverses; u (2,) is the turn
    rate [rad/s] and the acceleration [m/s^2]. OptionError: b is not a positive number.
    """

    b: float = 0.1  # noise [rad/sqrt(s)] and [m/s/sqrt(s)]

    n = 4
    m = 2
    states = ("x", "y", "heading", "speed")
    drift = staticmethod(rolling)
    homing = staticmethod(towards_goal)

    def twist(self, x: Array, rate: Array) -> Array:
        """Acceleration ahead and to the left [m/s^2] and turn rate [rad/s], (3,)."""
        return np.array([rate[1], x[3] * rate[0], rate[0]])

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """Critically damped along the heading, to where a place (2,) [m] is abreast; no turn; (2,)."""
        return np.array([0.0, (ahead(x, place) / within - 2.0 * x[3]) / within])
