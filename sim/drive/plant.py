"""Plants: a robot that is driven for one control period at a time, here by its stochastic equation alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, inf, sqrt
from numbers import Real

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision, touches
from pirrht.geometry.scene import Scene
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from pirrht.problem import Problem

Control = Callable[[Array, float], Array]  # state (n,), time since the start of the period [s] -> control (m,)
Clearance = Callable[[Array], Array]  # centres (k, 2) -> free distance (k,) [m], 0 or less in a collision


class ClearanceChecker:
    """Clearance of a robot among static and moving obstacles.

    Clearance is 1-Lipschitz: around a place that has some there is a disc that is free. FCL is queried only where the
    last disc does not bound it well enough.

    Args:
        clearance: of static obstacles; None: by FCL objects of its own, since these move when they are queried.
    """

    def __init__(self, scene: Scene, clearance: Clearance | None = None) -> None:
        self._clearance = clearance or Collision(scene.world, scene.footprint).clearance
        self.crowd = MovingObstacles(scene.movers, scene.footprint) if scene.movers else None
        self._disc = -inf, 0.0, 0.0  # the last static clearance [m], and where: x, y [m]

    def at(self, x: Array, now: float, enough: float = inf) -> float:
        """Return the clearance at a state x (n,) and a time [s], 0 or less in a collision [m].

        Args:
            enough: from this clearance on a lower bound that is no less will do [m].
        """
        free = self._static(x, enough)
        if self.crowd is None:
            return free
        moving = self.crowd.surely(x, now)
        return min(free, moving if moving >= enough else self.crowd.clearance(x[:2], now))

    def blocked(self, before: Array, x: Array, begin: float = 0.0, now: float = 0.0) -> bool:
        """Check for anything between two states 2 x (n,), a free one at `begin` and the next one `now` [s]."""
        way = x - before
        length = hypot(way[0], way[1])
        if not self._static(x, length) > length and touches(
            lambda s: self._static(before + s * way), lambda a, b: (b - a) * length, undecided=False
        ):
            return True
        return self.met(before, x, begin, now)

    def met(self, before: Array, x: Array, begin: float, now: float) -> bool:
        """Check for a moving obstacle that touches a footprint between two states 2 x (n,) and times [s]."""
        return self.crowd is not None and self.crowd.meets(before[:2], begin, x[:2], now)

    def _static(self, x: Array, enough: float = inf) -> float:
        free, at_x, at_y = self._disc
        free -= hypot(x[0] - at_x, x[1] - at_y)
        if free < enough:
            free = float(self._clearance(x[None, :2])[0])
            self._disc = free, float(x[0]), float(x[1])
        return free


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advance:
    """Result of one control period: k physics steps, fewer than a period holds if the run ended.

    Step i goes from the state before it under `controls[i]` and `noise[i]` to `states[i]`.
    """

    outcome: Outcome | None  # GOAL or COLLISION; None while the run goes on
    time: float  # until the exit or the end of the period [s]
    cost: float  # integral of q + u'Ru/2
    length: float  # of the path [m]
    clearance: float  # the least after any step [m]; 0 after a collision
    states: Array  # (k, n) after each step
    controls: Array  # (k, m)
    noise: Array  # (k, m) Brownian increments [sqrt(s)]

    def __repr__(self) -> str:
        end = "" if self.outcome is None else f", {self.outcome.name.lower()}"
        return f"Advance({len(self.states)} steps in {self.time:.4g} s, cost {self.cost:.4g}{end})"


class Plant(ABC):
    """A robot that can be driven on, in physics steps; here alone a run is judged and paid for.

    Args:
        clearance: of static obstacles; None: the planner's.
        period: control period [s], a whole number of physics steps.
        physics_step: its length [s].
    """

    def __init__(self, problem: Problem, clearance: Clearance | None, period: float, physics_step: float) -> None:
        count = round(period / physics_step) if np.isfinite(period) and physics_step > 0 else 0
        if count < 1 or abs(period - count * physics_step) > 1e-6 * physics_step:
            raise OptionError(
                f"the period {period:g} s must be a whole multiple of the physics step {physics_step:g} s"
            )
        self.period, self.physics_step, self._count = period, physics_step, count
        self._begun, self._steps = 0.0, 0  # time of the last reset [s], and steps since; one that is made counts
        self._problem, self._checker = problem, ClearanceChecker(problem.scene, clearance)

    @property
    def state(self) -> Array:
        """State (n,): x, y [m], the unwrapped heading [rad] if the dynamics have one, and velocities [m/s]."""
        return self._state.copy()

    @property
    def time(self) -> float:
        """Time of the run, also while a control is queried: moving obstacles go by it [s]."""
        return self._begun + self._steps * self.physics_step

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start from the first n entries of `state`, at a time [s] of the run.

        Raises:
            OptionError: that is no time of a run.
        """
        begun: object = time  # of whatever kind, by a caller who is not checked
        if not (isinstance(begun, Real) and 0.0 <= time < inf):
            raise OptionError(f"the time is {time!r}; a run's clock begins at 0, or at a later number of seconds")
        self._begun, self._steps = time, 0
        self._state = np.array(state, dtype=float)[: self._problem.dynamics.n]

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision if that comes first.

        Args:
            control_at: queried at every physics step, so that it may react to the state between plans.
            rng: gives the period's increments, in the order of the steps.
        """
        h, problem, checker, x = self.physics_step, self._problem, self._checker, self.state
        noise = sqrt(h) * rng.standard_normal((self._count, problem.dynamics.m))
        controls, states = np.empty_like(noise), np.empty((self._count, len(x)))
        outcome, cost, length, clearance, k = None, 0.0, 0.0, inf, 0
        while k < self._count and outcome is None:
            u = controls[k]
            u[:] = control_at(x, k * h)
            cost += (problem.rate(x) + 0.5 * float(u.dot(problem.control_cost(x)).dot(u))) * h
            before = x
            self._steps += 1
            x = self._state = states[k] = self._move(x, u, noise[k], h)
            length += hypot(x[0] - before[0], x[1] - before[1])
            clearance = min(clearance, checker.at(x, self.time, clearance))
            outcome = self._judge(before, x)
            k += 1
        if not np.isfinite(cost):
            raise OptionError(f"not finite: control {u.tolist()} or its cost at {before.tolist()}; fix them")
        return Advance(
            outcome=outcome, time=k * h, cost=cost, length=length, states=states[:k], controls=controls[:k],
            noise=noise[:k], clearance=0.0 if outcome is Outcome.COLLISION else clearance,
        )  # fmt: skip

    def _judge(self, before: Array, x: Array) -> Outcome | None:
        scene, px, py = self._problem.scene, x[0], x[1]
        (left, low), (right, high), (gx, gy) = scene.lower, scene.upper, scene.goal.center
        if not (left < px < right and low < py < high) or self._touching(before, x):
            return Outcome.COLLISION
        return Outcome.GOAL if hypot(px - gx, py - gy) <= scene.goal.radius else None

    @abstractmethod
    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """Make one physics step from x (n,)."""

    @abstractmethod
    def _touching(self, before: Array, x: Array) -> bool:
        """Check for a collision on the step between two states, 2 x (n,)."""


class Analytic(Plant):
    """The stochastic equation itself, with the planner's geometry in place of contacts."""

    def __init__(
        self, problem: Problem, clearance: Clearance, *, period: float, physics_step: float = 0.002
    ) -> None:  # fmt: skip
        super().__init__(problem, clearance, period, physics_step)
        self.reset(problem.dynamics.state_of(problem.scene.start))

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        return self._problem.dynamics.step(x, u, dw, step)

    def _touching(self, before: Array, x: Array) -> bool:
        return self._checker.blocked(before, x, self.time - self.physics_step, self.time)
