"""A robot on two driven wheels: speed and turn rate are its controls, and noise enters through both."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import jitable
from pirrht.systems.dynamics import HOMING, Dynamics, ahead, beyond_disc, check_positive, no_drift


@jitable
def by_speed_and_turn(x, p, out):  # type: ignore[no-untyped-def]
    """G of speed and turn rate at x (3,), written to out (3, 2): along the heading, and about the vertical."""
    out[0, 0], out[0, 1] = np.cos(x[2]), 0.0
    out[1, 0], out[1, 1] = np.sin(x[2]), 0.0
    out[2, 0], out[2, 1] = 0.0, 1.0


@jitable
def towards_goal(x, p, B, aim, radius, rate, out):  # type: ignore[no-untyped-def]
    """Drive at the best speed where the goal's disc lies ahead of x (3,) or behind, else turn to it; a to out (2,)."""
    dx, dy = aim[0] - x[0], aim[1] - x[1]
    way = 1.0 if dx * math.cos(x[2]) + dy * math.sin(x[2]) >= 0.0 else -1.0
    beyond = beyond_disc(way * dx, way * dy, x[2], radius)
    asked = math.sqrt(2.0 * rate)  # |a| under which control costs what time does
    out[0] = way * asked * math.cos(min(HOMING.narrow * abs(beyond), 0.5 * math.pi))
    out[1] = max(-HOMING.rover_turn * asked, min(HOMING.rover_turn * asked, HOMING.gain * beyond / B[2, 1]))


@dataclass(frozen=True, eq=False)
class Rover(Dynamics):
    """A robot that drives along its heading and turns, both under noise: dx = G(x) (u dt + s dw), f = 0.

    The state is x, y [m] and heading [rad], (3,); the control is speed [m/s] and turn rate [rad/s], (2,). Noise along
    the heading does not change the heading, so that Ito's and Stratonovich's sense are one; steps take its middle.
    OptionError: a number is not positive.
    """

    b: float = 0.1  # noise of the speed [m/sqrt(s)]
    turning: float = 2.0  # noise of the turn rate is so many times that of the speed [rad/m]

    n = 3
    m = 2
    states = ("x", "y", "heading")
    parameters = np.zeros(0)
    drift = staticmethod(no_drift)
    input_matrix = staticmethod(by_speed_and_turn)
    stratonovich = True
    homing = staticmethod(towards_goal)

    def __post_init__(self) -> None:
        check_positive(self, "b", "turning")

    @cached_property
    def input_noise(self) -> Array:  # type: ignore[override]
        """s = diag(b, turning b), (2, 2) [m/sqrt(s), rad/sqrt(s)]."""
        return self.b * np.diag([1.0, self.turning])

    def twist(self, x: Array, rate: Array) -> Array:
        """Forward speed [m/s] and turn rate [rad/s], (2,)."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """Forwards or backwards to where a place (2,) [m] is abreast, within a time constant [s]; (2,)."""
        return np.array([ahead(x, place) / within, 0.0])
