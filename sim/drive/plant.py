"""Plants: what every robot that is run has in common, its physics steps, and the stochastic equation alone.

Clearance is 1-Lipschitz: around a place that has some there is a disc that is free. FCL is asked only where the last
disc does not tell enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, inf, sqrt
from numbers import Real
from typing import Protocol

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from pirrht.problem import Problem

SHORTEST = 1e-4  # an obstacle of which a step cuts off less than this is only grazed [m]
Control = Callable[[Array, float], Array]  # state (n,), time since the start of the period [s] -> control (m,)


class Room:
    """Clearance along a run, computed as rarely as can be.

    Args:
        clearance: maps centres (k, 2) to the free distance (k,) [m] among what stands, 0 or less in a collision.
        crowd: moving obstacles; None: there are none.
        now: time of the run at the end of the step that is judged [s].
        step: length of that step [s].
    """

    def __init__(
        self,
        clearance: Callable[[Array], Array],
        crowd: MovingObstacles | None = None,
        now: Callable[[], float] = lambda: 0.0,
        step: float = 0.0,
    ) -> None:
        self._clearance, self._crowd, self._now, self._step = clearance, crowd, now, step
        self._x = self._y = 0.0
        self._known = -inf  # free distance at (x, y) among what stands [m]
        self.begin()

    def begin(self) -> None:
        """Forget the least distance."""
        self._standing = self._moving = inf

    @property
    def least(self) -> float:
        """The least free distance since `begin` [m]."""
        return min(self._standing, self._moving)

    def at(self, x: Array) -> float:
        """Compute the free distance at a state x (n,), now [m]."""
        if self._crowd is None:
            return self._measured(x)
        free = self._crowd.clearance(x[:2], self._now())
        self._moving = min(self._moving, free)
        return min(free, self._measured(x))

    def note(self, x: Array) -> None:
        """Take a state x (n,) into account, now."""
        if self._surely(x) < self._standing:
            self._measured(x)
        if self._crowd is not None and self._crowd.surely(x, self._now()) < self._moving:
            self._moving = min(self._moving, self._crowd.clearance(x[:2], self._now()))

    def blocked(self, before: Array, x: Array) -> bool:
        """Tell whether something is in the way from a free state straight to another, 2 x (n,), or gets there."""
        return self._cut(before, x) or self.met(before, x)

    def met(self, before: Array, x: Array) -> bool:
        """Tell whether a moving obstacle touches a footprint that goes straight from a state to another, 2 x (n,)."""
        now = self._now()
        return self._crowd is not None and self._crowd.meets(before[:2], now - self._step, x[:2], now)

    def way(self, begin: float, end: float) -> float:
        """Return how far any obstacle moves between two times [s] at most [m]."""
        return 0.0 if self._crowd is None else self._crowd.travel(begin, end)

    def _measured(self, x: Array) -> float:
        self._x, self._y = float(x[0]), float(x[1])
        self._known = float(self._clearance(x[None, :2])[0])
        self._standing = min(self._standing, self._known)
        return self._known

    def _surely(self, x: Array) -> float:
        """Bound the free distance at x from below by the last disc [m]."""
        return self._known - hypot(x[0] - self._x, x[1] - self._y)

    def _cut(self, before: Array, x: Array) -> bool:
        if min(self._surely(before), self._surely(x)) > 0.0:
            return False
        length, end = hypot(x[0] - before[0], x[1] - before[1]), self._measured(x)
        if end > length:
            return False
        return end <= 0.0 or self._between(before, self._measured(before), x, end, length)

    def _between(self, a: Array, free_a: float, b: Array, free_b: float, length: float) -> bool:
        if free_a + free_b > length or length < SHORTEST:
            return False
        middle = 0.5 * (a + b)
        free = self._measured(middle)
        if free <= 0.0:
            return True
        half = 0.5 * length
        return self._between(a, free_a, middle, free, half) or self._between(middle, free, b, free_b, half)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advance:
    """Result of one control period: k physics steps, fewer than a period holds if the run ended.

    Step i goes from the state before it under `controls[i]` and `noise[i]` to `states[i]`.
    """

    outcome: Outcome | None  # GOAL or COLLISION; None while the drive goes on
    time: float  # until the exit or the end of the period [s]
    cost: float  # integral of q + u'Ru/2
    length: float  # of the path [m]
    clearance: float  # least room around the robot after any step [m]; 0 after a collision
    states: Array  # (k, n) after each step
    controls: Array  # (k, m)
    noise: Array  # (k, m) Brownian increments [sqrt(s)]

    def __repr__(self) -> str:
        end = "" if self.outcome is None else f", {self.outcome.name.lower()}"
        return f"Advance({len(self.states)} steps in {self.time:.4g} s, cost {self.cost:.4g}{end})"


class Plant(Protocol):
    """A robot that stands somewhere and can be driven on."""

    @property
    def physics_step(self) -> float:
        """Length of a physics step [s]."""

    @property
    def state(self) -> Array:
        """State (n,): x, y [m], the unwrapped heading [rad] if the dynamics have one, and velocities [m/s]."""

    @property
    def time(self) -> float:
        """Time of the run, also while a control is queried: moving obstacles go by it [s]."""

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Stand at the first n entries of `state`, at a time [s] of the drive."""

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision if that comes first.

        Args:
            control_at: asked at every physics step, so that it may react to the state between plans.
            rng: gives the period's increments, in the order of the steps.
        """


class Loop:
    """The physics steps of a period, and the one place where a drive is judged and paid for."""

    def __init__(self, problem: Problem, period: float, step: float) -> None:
        self.step = step
        self.start(0.0)
        self.count = _whole_multiple(period, step)
        self.deviation = sqrt(step)
        self.enter(problem)

    def enter(self, problem: Problem) -> None:
        """Judge and pay by this problem from now on."""
        self.problem, scene = problem, problem.scene
        self.bounds = (*scene.lower.tolist(), *scene.upper.tolist())
        self.goal = (*scene.goal.center.tolist(), scene.goal.radius)

    def start(self, time: float) -> None:
        """Set the clock [s].

        Raises:
            OptionError: that is no time of a drive.
        """
        begun: object = time  # of whatever kind, by a caller who is not checked
        if not (isinstance(begun, Real) and 0.0 <= time < inf):
            raise OptionError(f"the time is {time!r}; a drive's clock begins at 0, or at a later number of seconds")
        self._begun, self.steps = time, 0  # steps since then; while one is made and judged it counts

    @property
    def time(self) -> float:
        """Time on the clock [s]."""
        return self._begun + self.steps * self.step

    def room(self, clearance: Callable[[Array], Array]) -> Room:
        """Return the clearance along the run, given the free distance among what stands."""
        scene = self.problem.scene
        crowd = MovingObstacles(scene.movers, scene.footprint) if scene.movers else None
        return Room(clearance, crowd, lambda: self.time, self.step)

    def drive(
        self,
        x: Array,
        move: Callable[[Array, Array, Array, float], Array],
        touching: Callable[[Array, Array], bool],
        room: Room,
        control_at: Control,
        rng: np.random.Generator,
    ) -> Advance:
        """Up to one period from x; `move` makes a step, `touching` tells a collision on it, `room` takes note."""
        h, problem = self.step, self.problem
        m = problem.dynamics.m
        noise = self.deviation * rng.standard_normal((self.count, m))
        controls = np.empty((self.count, m))
        states = np.empty((self.count, len(x)))
        outcome, cost, length, k = None, 0.0, 0.0, 0
        room.begin()
        while k < self.count and outcome is None:
            u = controls[k]
            u[:] = control_at(x, k * h)
            cost += (problem.rate(x) + 0.5 * float(u.dot(problem.control_cost(x)).dot(u))) * h
            before = x
            self.steps += 1
            x = states[k] = move(x, u, noise[k], h)
            length += hypot(x[0] - before[0], x[1] - before[1])
            room.note(x)
            outcome = self._judge(before, x, touching)
            k += 1
        if not np.isfinite(cost):
            raise OptionError(f"not finite: control {u.tolist()} or its cost at {before.tolist()}; fix them")
        return Advance(
            outcome=outcome,
            time=k * h,
            cost=cost,
            length=length,
            clearance=0.0 if outcome is Outcome.COLLISION else room.least,
            states=states[:k],
            controls=controls[:k],
            noise=noise[:k],
        )

    def _judge(self, before: Array, x: Array, touching: Callable[[Array, Array], bool]) -> Outcome | None:
        px, py = float(x[0]), float(x[1])
        left, low, right, high = self.bounds
        if not (left < px < right and low < py < high) or touching(before, x):
            return Outcome.COLLISION
        gx, gy, radius = self.goal
        return Outcome.GOAL if hypot(px - gx, py - gy) <= radius else None


class LoopPlant:
    """Clock and state of a plant that a `Loop` advances."""

    _loop: Loop
    _state: Array
    _n: int

    @property
    def physics_step(self) -> float:
        """Length of a physics step [s]."""
        return self._loop.step

    @property
    def state(self) -> Array:
        """State of the dynamics (n,): x, y [m], the unwrapped heading [rad] if there is one, and velocities [m/s]."""
        return self._state.copy()

    @property
    def time(self) -> float:
        """Time of the run [s]; see `Plant.time`."""
        return self._loop.time

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start from the first n entries of `state` at a time [s]."""
        self._loop.start(time)
        self._state = np.array(state, dtype=float)[: self._n]


class Analytic(LoopPlant):
    """The stochastic equation itself, with the planner's geometry in place of contacts.

    `clearance` maps centres (k, 2) to the free distance (k,) [m] of the robot, 0 or less in a collision.
    """

    def __init__(
        self, problem: Problem, clearance: Callable[[Array], Array], *, period: float, physics_step: float = 0.002
    ) -> None:
        self._loop = Loop(problem, period, physics_step)
        self._room = self._loop.room(clearance)
        self._step = problem.dynamics.step
        self._n = problem.dynamics.n
        self.reset(problem.dynamics.state_of(problem.scene.start))

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period; see `Plant.advance`."""
        return self._loop.drive(self.state, self._move, self._touching, self._room, control_at, rng)

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        self._state = self._step(x, u, dw, step)
        return self._state

    def _touching(self, before: Array, x: Array) -> bool:
        return not self._room.at(x) > 0 or self._room.blocked(before, x)


def _whole_multiple(period: float, step: float) -> int:
    count = round(period / step) if np.isfinite(period) and step > 0 else 0
    if count < 1 or abs(period - count * step) > 1e-6 * step:
        raise OptionError(f"the period {period:g} s must be a whole multiple of the physics step {step:g} s")
    return count
