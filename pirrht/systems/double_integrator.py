"""A point with mass that is pushed by forces: velocity is state, acceleration is control."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import jitable
from pirrht.systems.dynamics import Dynamics, _check_noise


@jitable
def coasting(x, p, out):  # type: ignore[no-untyped-def]
    """f = [vx, vy, 0, 0] at x (4,), written to out (4,) [m/s, m/s, m/s^2, m/s^2]."""
    out[0], out[1], out[2], out[3] = x[2], x[3], 0.0, 0.0


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
