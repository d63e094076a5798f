"""Interface of all policies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.control.budget import TimeBudget
from pirrht.control.plan import Plan
from pirrht.control.prediction import Predictor
from pirrht.control.run_state import RunState
from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.topology.homology import Homology


class Policy(ABC):
    """A feedback law that replans during a run: `Controller`, `Mppi` or `Optimal`."""

    path_integral: PathIntegral  # sampler of the problem
    homology: Homology  # classes of references and runs
    tree: HomologyTree | None = None  # None: it needs none
    predict: Predictor | None = None  # None: motions are known
    run: RunState  # of the run under way

    @property
    def problem(self) -> Problem:
        """Problem that the samples are of."""
        return self.path_integral.problem

    @property
    def space(self) -> FreeSpace:
        """Free space of the scene, with its moving obstacles."""
        return self.path_integral.space

    @abstractmethod
    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); `left` returns the time left for sampling [s], where that is limited."""

    def step(self, x: Array, dt: float) -> Array:
        """Observe the last step, plan at x (n,) and return the control (m,) for the next dt [s].

        Args:
            dt: how long the control will be held, until the next step [s].

        Raises:
            OptionError: dt is not positive.
            NoReference: no class reaches the goal from where the run begins.

        Examples:
            A loop of your own; `begin(x)` starts another run:

            >>> while not arrived:  # doctest: +SKIP
            ...     u = controller.step(robot.state, 0.02)
            ...     robot.drive(u, 0.02)
        """
        if not (np.isfinite(dt) and dt > 0):
            raise OptionError(f"dt is {dt:g}; a control is held for a positive number of seconds")
        x = np.asarray(x, dtype=float)
        if self.run.held is not None:
            self.observe(x[None], self.run.held)
        plan = self.plan(x)
        self.run.held = dt
        return plan.control

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the run so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        self.run = RunState(self.homology, x, time, self.space.scene.movers)
        if self.predict is not None:
            self.predict.begin()

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        """Record the states (k, n) just driven through and the time it took [s].

        Args:
            until: when the last of them was reached [s], if that is over; None: now.
        """
        run = self.run
        run.passed(duration)
        run.known = run.time if until is None else until
        run.path.observe(states, run.known - run.since)

    def expect(self, states: Array, duration: float) -> None:
        """Plan for the end of states (k, n) to be driven through next, `duration` [s] after the last plan.

        Observations, of no duration, replace them.
        """
        self.run.passed(duration)
        self.run.path.expect(states, self.run.now)

    def driven_class(self) -> tuple[int, ...]:
        """Return the class (M,) of the driven path, completed by a straight line to the goal point [turns]."""
        return self.run.path.winding()

    def _update_prediction(self, x: Array, budget: TimeBudget) -> None:
        """Update the prediction of moving obstacles at x (n,), for the run, the samples and the tree."""
        if self.predict is None:
            return
        prediction = self.predict.at(x, self.run.known, budget.enough)
        if prediction is not self.run.prediction:
            self.run.set_prediction(prediction, x)
            self.path_integral.set_prediction(prediction.space.moving, prediction.homology)
            self.tree = self.tree and prediction.tree


def state_of(problem: Problem, x: Array) -> Array:
    """Return a state (n,) as an array of numbers.

    Raises:
        OptionError: it has another shape.
    """
    x, d = np.asarray(x, dtype=float), problem.dynamics
    if x.shape != (d.n,):
        moves = f"{type(d).__name__} ({', '.join(d.states)})"
        raise OptionError(f"the state has the shape {x.shape}; {moves} has {d.n} numbers")
    return x
