"""A point that is pushed around (paper, first example)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.systems.dynamics import Dynamics, _check_noise, no_drift


@dataclass(frozen=True, eq=False)
class SingleIntegrator(Dynamics):
    """A point that is pushed around: dx = u dt + b dw, x (2,) [m], u (2,) [m/s] (paper, first example).

    Raises:
        OptionError: b is not a positive number.
    """

    b: float = 0.1  # noise [m/sqrt(s)]

    n = 2
    m = 2
    parameters = np.zeros(0)
    drift = staticmethod(no_drift)

    def __post_init__(self) -> None:
        _check_noise(self.b)

    @cached_property
    def control_block(self) -> Array:  # type: ignore[override]
        """G_c = I, (2, 2); controls are velocities [m/s]."""
        return np.eye(2)

    @cached_property
    def diffusion_block(self) -> Array:  # type: ignore[override]
        """B_c = b I, (2, 2) [m/sqrt(s)]."""
        return self.b * np.eye(2)

    def twist(self, x: Array, rate: Array) -> Array:
        """World velocities (vx, vy), (2,) [m/s]."""
        return rate

    def brake(self, x: Array, place: Array, within: float) -> Array:
        """The velocity (2,) [m/s] that shrinks the distance to a place (2,) [m] within a time constant [s]."""
        return (place - x) / within
