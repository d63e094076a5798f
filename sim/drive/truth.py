"""Exact value and optimal control at the states of a run, by a solved grid, next to those of its plans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.estimate import Estimate
from pirrht.exact.desirability import Desirability


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """Exact solution at one state."""

    value: float  # v
    control: Array  # u*, (m,)

    @classmethod
    def at(cls, grid: Desirability, x: Array, time: float = 0.0) -> Truth:
        """Value and control at state x (n,), and a time [s] that counts where bodies move."""
        return cls(value=float(grid.value(x, time)), control=grid.control(x, time))

    def errors(self, e: Estimate) -> tuple[float, float]:
        """Subtract the exact value, and compute |u - u*|, for an estimate."""
        return e.value - self.value, self.distance(e.control)

    def distance(self, control: Array) -> float:
        """|u - u*| of a control u (m,)."""
        return float(np.linalg.norm(control - self.control))


class Witness:
    """Holds every plan of a drive against the grid."""

    def __init__(self, grid: Desirability) -> None:
        self._grid = grid
        self._first: Truth | None = None
        self._distances: list[float] = []

    def add(self, plan: Plan) -> Truth:
        """Take a plan into account; the truth where it was made."""
        truth = Truth.at(self._grid, plan.state, plan.time)
        self._first = self._first or truth
        self._distances.append(truth.distance(plan.control))
        return truth

    def result(self) -> dict[str, Any]:
        """The exact value at the start, and |u - u*| over the control steps, as the public JSON has them."""
        assert self._first is not None, "a drive has at least one plan"
        return {
            "value": self._first.value,
            "mean_control_error": float(np.mean(self._distances)),
            "max_control_error": float(np.max(self._distances)),
        }
