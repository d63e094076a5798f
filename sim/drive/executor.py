"""The plant: a robot driven for one control period at a time, in MuJoCo or by its stochastic equation alone.

Noise enters with the control. Every physics step of length h draws one increment dw ~ N(0, h I), whatever
the method and the noise level, and commands `ctrl = M @ twist(x, f_c + G u + B dw/h)`, or where noise enters through
the inputs `ctrl = M @ twist(x, u + s dw/h)`. With deadbeat servos a
step of MuJoCo is then the Euler-Maruyama step of the equation, and the displacement has covariance B B' t. Motors
take accelerations instead: the velocity's step is then that of the equation, and the position moves on with the
velocity of the step's end (semi-implicit Euler) where the equation alone takes that of its start.
Wheels with slow servos follow it up to their lag; models/robots/diffdrive.xml says how far.
A step of white noise may be longer than a wall is thick: the way between two steps is judged as well as their ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Protocol

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.systems.dynamics import Dynamics
from sim.drive.room import Room
from sim.mjcf import Loaded
from sim.mjcf.coordinates import stance_of
from sim.mjcf.forces import check_motion

FOOTPRINT = "robot/footprint"  # geom of every robot

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


class Plant(Protocol):
    """A robot that stands somewhere and can be driven on."""

    @property
    def physics_step(self) -> float:
        """Length of a physics step [s]."""

    @property
    def state(self) -> Array:
        """x, y [m], the unwrapped heading [rad] if the dynamics have one, and velocities likewise [m/s]; (n,)."""

    def reset(self, state: Array) -> None:
        """Stand at the first n entries of `state`."""

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period, or to the goal or a collision if that comes first.

        Args:
            control_at: asked at every physics step, so that it may react to the state between plans.
            rng: gives the period's increments, in the order of the steps.
        """


class Executor:
    """The robot in MuJoCo."""

    def __init__(self, loaded: Loaded, problem: Problem, *, period: float) -> None:
        self._model = loaded.model
        if problem.dynamics.n != len(loaded.states):
            raise OptionError(
                f'robot "{loaded.robot}" moves as a {loaded.dynamics_name} with '
                f"{len(loaded.states)} states; "
                f"{type(problem.dynamics).__name__} has {problem.dynamics.n}"
            )
        check_motion(self._model, loaded.dynamics_name, problem.dynamics, loaded.command)
        self._loop = _Loop(problem, period, float(self._model.opt.timestep))
        self._data = mujoco.MjData(self._model)
        self._ctrl, self._stance = self._data.ctrl, stance_of(self._model, loaded.states)
        self._dynamics = problem.dynamics
        self._command, self._twist = loaded.command, problem.dynamics.twist
        self._rate = commanded_rate(problem.dynamics, self._loop.step)
        self._obstacles = loaded.obstacle_geoms
        # FCL moves its objects when it is asked, and in real time the planner asks its own meanwhile.
        self._room = Room(Collision(loaded.scene.world, loaded.scene.footprint).clearance)
        # Where the footprint is what collides, white noise may carry it through a wall within a step; others are slow.
        self._sweeps = bool(self._model.geom(FOOTPRINT).contype[0] | self._model.geom(FOOTPRINT).conaffinity[0])
        self.reset(problem.dynamics.state_of(problem.scene.start))

    @property
    def physics_step(self) -> float:
        """The timestep of the MJCF [s]."""
        return self._loop.step

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state, for pictures; positions and contacts belong to `state`."""
        return self._data

    @property
    def state(self) -> Array:
        """x, y [m], the unwrapped heading [rad] if the dynamics have one, and velocities likewise [m/s]; (n,)."""
        return self._state.copy()

    def reset(self, state: Array) -> None:
        """Stand at the first n entries of `state`; a robot on wheels rolls as it does without control."""
        self._state = np.array(state, dtype=float)[: self._dynamics.n]
        twist = self._twist(self._state, self._dynamics.idle(self._state))
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        self._stance.place(self._data, self._state, twist, self._command.dot(twist))
        mujoco.mj_step1(self._model, self._data)

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period; see `Plant.advance`."""
        return self._loop.drive(self.state, self._move, self._touching, self._room, control_at, rng)

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """One step, cut after its position stage, so that the contacts are those of the new state."""
        self._ctrl[:] = self._command.dot(self._twist(x, self._rate(x, u, dw)))
        mujoco.mj_step2(self._model, self._data)
        mujoco.mj_step1(self._model, self._data)
        self._state = self._stance.read(self._data, x)
        return self._state

    def _touching(self, before: Array, x: Array) -> bool:
        # Nothing but the robot moves, so whatever touches an obstacle is the robot.
        if self._data.ncon > 0 and self._obstacles[self._data.contact.geom].any():
            return True
        return self._sweeps and self._room.blocked(before, x)


class Analytic:
    """The stochastic equation itself, with the planner's geometry in place of contacts.

    `clearance` maps centres (k, 2) to the free distance (k,) [m] of the robot, 0 or less in a collision.
    """

    def __init__(
        self,
        problem: Problem,
        clearance: Callable[[Array], Array],
        *,
        period: float,
        physics_step: float = 0.002,
    ) -> None:
        self._loop = _Loop(problem, period, physics_step)
        self._room = Room(clearance)
        self._step = problem.dynamics.step
        self._n = problem.dynamics.n
        self.reset(problem.dynamics.state_of(problem.scene.start))

    @property
    def physics_step(self) -> float:
        """Length of an Euler-Maruyama step [s]."""
        return self._loop.step

    @property
    def state(self) -> Array:
        """The state of the equation, (n,)."""
        return self._state.copy()

    def reset(self, state: Array) -> None:
        """Stand at the first n entries of `state`."""
        self._state = np.array(state, dtype=float)[: self._n]

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period; see `Plant.advance`."""
        return self._loop.drive(self.state, self._move, self._touching, self._room, control_at, rng)

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        self._state = self._step(x, u, dw, step)
        return self._state

    def _touching(self, before: Array, x: Array) -> bool:
        return not self._room.at(x) > 0 or self._room.blocked(before, x)


def commanded_rate(dynamics: Dynamics, step: float) -> Callable[[Array, Array, Array], Array]:
    """`dynamics.rate` at a fixed step [s], (x, u, dw) -> (m,), with constant blocks looked up only once."""
    if dynamics.input_noise is not None:
        s_per_step = dynamics.input_noise / step
        return lambda x, u, dw: u + s_per_step.dot(dw)
    if not dynamics.constant:
        return lambda x, u, dw: dynamics.rate(x, u, dw, step)
    anywhere = np.zeros(dynamics.n)
    G, B_per_step = dynamics.G_c(anywhere), dynamics.B_c(anywhere) / step
    first = dynamics.n - dynamics.m
    return lambda x, u, dw: dynamics.f(x)[first:] + G.dot(u) + B_per_step.dot(dw)


class _Loop:
    """The physics steps of a period, and the one place where a drive is judged and paid for."""

    def __init__(self, problem: Problem, period: float, step: float) -> None:
        self.problem = problem
        self.step = step
        self.count = _whole_multiple(period, step)
        self.deviation = sqrt(step)
        scene = problem.scene
        self.bounds = (*scene.lower.tolist(), *scene.upper.tolist())
        self.goal = (*scene.goal.center.tolist(), scene.goal.radius)

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
