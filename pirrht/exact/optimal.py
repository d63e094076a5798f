"""Optimal feedback control by the solved grid, without tree and samples: the upper bound of any controller."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.steering.in_time import homology_of

DRAWN = 0.5  # a recording draws the control now over this time [s]


class Optimal(Policy):
    """Feedback control by a solved grid.

    Args:
        desirability: of the problem in continuous time.
        sampling: of the sampler that a recording draws with; drives do not use it.
    """

    def __init__(self, desirability: Desirability, sampling: Sampling) -> None:
        self.desirability, self._sampling = desirability, sampling
        self.homology = homology_of(self.problem, self.space)
        start = self.problem.dynamics.state_of(self.problem.scene.start)
        desirability.control(start)  # compiles, so that the first plan takes no longer than the others
        self.begin(start)

    def __repr__(self) -> str:
        return f"Optimal({self.desirability!r})"

    @property
    def problem(self) -> Problem:
        """Problem that the grid solves."""
        return self.desirability.problem

    @property
    def space(self) -> FreeSpace:
        """Free space of its scene."""
        return self.desirability.space

    @cached_property
    def path_integral(self) -> PathIntegral:  # type: ignore[override]
        """Sampler that a recording reads problem and temperature from."""
        return path_integral(self.problem, self.space, self._sampling)

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Return the law from state x (n,) on, and v there [cost]; static scenes have one law for all times."""
        now = self.run.time

        def law(state: Array, since: float = 0.0) -> Array:
            return self.desirability.control(state, now + since)

        value = self.desirability.value(x, now)
        return Plan(
            state=x, times=np.array([0.0, DRAWN]), references=(), ids=(), estimate=None, fallback=None,
            instead=law(x)[None, :], law=law, time=now, exact=float(value), space=self.space, movers=self.run.movers,
        )  # fmt: skip
