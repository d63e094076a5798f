"""The physics steps of a drive: its clock, its noise, what it costs and how it ends, for whatever plant it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, inf, sqrt
from numbers import Real

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.crowd import Crowd
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from sim.drive.room import Room, RoomAmong

Control = Callable[[Array, float], Array]  # state (n,), time since the start of the period [s] -> control (m,)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Advance:
    """What happened in one control period: k physics steps, fewer than a period holds if the drive ended.

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
        """What the clock says [s]."""
        return self._begun + self.steps * self.step

    def room(self, clearance: Callable[[Array], Array]) -> Room | RoomAmong:
        """The room along the drive, given the free distance among what stands."""
        scene, standing = self.problem.scene, Room(clearance)
        if not scene.movers:
            return standing
        return RoomAmong(standing, Crowd(scene.movers, scene.footprint), lambda: self.time, self.step)

    def drive(
        self,
        x: Array,
        move: Callable[[Array, Array, Array, float], Array],
        touching: Callable[[Array, Array], bool],
        room: Room | RoomAmong,
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
            raise OptionError(f"not finite: control {u.tolist()} or its cost at {before.tolist()}; mend them")
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


def _whole_multiple(period: float, step: float) -> int:
    count = round(period / step) if np.isfinite(period) and step > 0 else 0
    if count < 1 or abs(period - count * step) > 1e-6 * step:
        raise OptionError(f"the period {period:g} s must be a whole multiple of the physics step {step:g} s")
    return count
