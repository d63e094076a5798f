"""Exact value and optimal control at a state, by a solved grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.exact.desirability import Desirability


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """Exact solution at one state."""

    value: float  # v
    control: Array  # u*, (m,)

    @classmethod
    def at(cls, grid: Desirability, x: Array, time: float = 0.0) -> Truth:
        """Return value and control at state x (n,), and a time [s] that counts among moving obstacles."""
        return cls(value=float(grid.value(x, time)), control=grid.control(x, time))

    def errors(self, e: Estimate) -> tuple[float, float]:
        """Subtract the exact value, and compute |u - u*|, for an estimate."""
        return e.value - self.value, self.distance(e.control)

    def distance(self, control: Array) -> float:
        """|u - u*| of a control u (m,)."""
        return float(np.linalg.norm(control - self.control))
