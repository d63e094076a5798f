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
        """Return value and control at state x (n,), and a time [s] that counts among moving obstacles."""
        return cls(value=float(grid.value(x, time)), control=grid.control(x, time))

    def errors(self, e: Estimate) -> tuple[float, float]:
        """Subtract the exact value, and compute |u - u*|, for an estimate."""
        return e.value - self.value, self.distance(e.control)

    def distance(self, control: Array) -> float:
        """|u - u*| of a control u (m,)."""
        return float(np.linalg.norm(control - self.control))


class ExactReference:
    """The exact solution next to every plan of a run."""

    def __init__(self, grid: Desirability) -> None:
        self._grid, self._values, self._distances = grid, list[float](), list[float]()

    def add(self, plan: Plan) -> Truth:
        """Take a plan into account; the truth where it was made."""
        truth = Truth.at(self._grid, plan.state, plan.time)
        self._values.append(truth.value)
        self._distances.append(truth.distance(plan.control))
        return truth

    def result(self) -> dict[str, Any]:
        """The exact value at the start, and |u - u*| over the control steps, as the public JSON has them."""
        mean, most = float(np.mean(self._distances)), float(np.max(self._distances))
        return {"value": self._values[0], "mean_control_error": mean, "max_control_error": most}
