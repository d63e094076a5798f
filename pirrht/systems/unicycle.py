"""A car of constant speed that is steered (paper, second example)."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import jitable
from pirrht.systems.dynamics import HOMING, Dynamics, beyond_disc, check_positive


@jitable
def unicycle_drift(x, p, out):  # type: ignore[no-untyped-def]
    """f = [V cos theta, V sin theta, 0] at x (3,), written to out (3,) [m/s, m/s, rad/s], with p = [V], (1,)."""
    out[0] = p[0] * np.cos(x[2])
    out[1] = p[0] * np.sin(x[2])
    out[2] = 0.0


@jitable
def turn_home(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Turn from x (3,) until the goal's disc lies ahead: `Dynamics.homing` of a car at constant speed."""
    bound = HOMING.steepest * math.sqrt(rate) * B[0, 0]
    turn = HOMING.gain * beyond_disc(aim[0] - x[0], aim[1] - x[1], x[2], radius)
    out[0] = max(-bound, min(bound, turn)) / B[0, 0]


@dataclass(frozen=True, eq=False)
class Unicycle(Dynamics):
    """A car of constant speed V steered by its turn rate: dtheta = u/rho dt + b dw (paper, second example).

    The state is x, y [m] and heading [rad], (3,). OptionError: V, rho or b is not a positive number.
    """

    V: float = 1.0  # speed [m/s]
    rho: float = 1.0  # turning radius at |u| = 1 and V = 1 [m]
    b: float = 0.03  # noise [rad/sqrt(s)]

    n = 3
    m = 1
    states = ("x", "y", "heading")
    drift = staticmethod(unicycle_drift)
    control_kind = "turn rate"
    homing = staticmethod(turn_home)

    def __post_init__(self) -> None:
        check_positive(self, "V", "rho", "b")

    @cached_property
    def parameters(self) -> Array:  # type: ignore[override]
        """p = [V], (1,) [m/s]."""
        return np.array([self.V])

    @cached_property
    def control_block(self) -> Array:  # type: ignore[override]
        """G_c = 1/rho, (1, 1) [1/m]."""
        return np.array([[1.0 / self.rho]])

    @cached_property
    def diffusion_block(self) -> Array:  # type: ignore[override]
        """B_c = b, (1, 1) [rad/sqrt(s)]."""
        return np.array([[self.b]])

    def twist(self, x: Array, rate: Array) -> Array:
        """Forward speed [m/s] and turn rate [rad/s], (2,)."""
        return np.array([self.V, rate[0]])
