"""The plant: a robot driven for one control period at a time, in MuJoCo or by its stochastic equation alone.

Noise enters with the control. Every physics step of length h draws one increment dw ~ N(0, h I), whatever
the method and the noise level, and commands `ctrl = M @ twist(x, f_c + G u + B dw/h)`, or where noise enters through
the inputs `ctrl = M @ twist(x, u + s dw/h)`. With deadbeat servos a
step of MuJoCo is then the Euler-Maruyama step of the equation, and the displacement has covariance B B' t. Motors
take accelerations instead: the velocity's step is then that of the equation, and the position moves on with the
velocity of the step's end (semi-implicit Euler) where the equation alone takes that of its start.
Wheels with slow servos follow it up to their lag; models/robots/diffdrive.xml says how far.
A step of white noise may be longer than a wall is thick: the way between two steps is judged as well as their ends.
Bodies that move are where their motions say at the end of each step, by the plant's own clock.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision
from pirrht.geometry.scene import ROUNDING
from pirrht.problem import Problem
from pirrht.systems.dynamics import Dynamics
from sim.drive.plant import Advance, Control, Loop, LoopPlant
from sim.mjcf import Loaded
from sim.mjcf.coordinates import stance_of
from sim.mjcf.forces import check_motion
from sim.mjcf.mocap import Mocap, Sweep
from sim.systems import named

FOOTPRINT = "robot/footprint"  # geom of every robot


class Executor(LoopPlant):
    """The robot in MuJoCo."""

    def __init__(self, loaded: Loaded, problem: Problem, *, period: float) -> None:
        self._model = loaded.model
        called = named(loaded.dynamics_name).called
        if problem.dynamics.n != len(loaded.states):
            raise OptionError(
                f'robot "{loaded.robot}" moves as a {called} with '
                f"{len(loaded.states)} states; "
                f"{type(problem.dynamics).__name__} has {problem.dynamics.n}"
            )
        check_motion(self._model, called, problem.dynamics, loaded.command)
        self._loop = Loop(problem, period, float(self._model.opt.timestep))
        self._data = mujoco.MjData(self._model)
        self._ctrl, self._stance = self._data.ctrl, stance_of(self._model, loaded.states)
        self._command, self._obstacles = loaded.command, loaded.obstacle_geoms
        scene = loaded.scene
        self.enter(problem)
        self._mocap = Mocap(self._model, scene.movers) if scene.movers else None
        self._radius, self._joints = scene.robot_radius, np.empty(self._model.nq)
        # Where the footprint is what collides, white noise may carry it through a wall within a step; others are slow.
        self._sweeps = bool(self._model.geom(FOOTPRINT).contype[0] | self._model.geom(FOOTPRINT).conaffinity[0])
        self._sweep: Sweep | None = None
        if self._mocap is not None and not self._sweeps:
            bodies = loaded.moving_geoms & loaded.obstacle_geoms
            self._sweep = Sweep(self._model, loaded.robot_geoms, bodies, self._mocap)
        self.reset(problem.dynamics.state_of(problem.scene.start))

    def enter(self, problem: Problem) -> None:
        """Go on in this problem, of the same robot: among its obstacles, to its goal, under its noise.

        What stands in MuJoCo is up to who moved it there.
        """
        self._loop.enter(problem)
        self._dynamics, self._twist, self._n = problem.dynamics, problem.dynamics.twist, problem.dynamics.n
        self._rate = commanded_rate(problem.dynamics, self._loop.step)
        # FCL moves its objects when it is asked, and in real time the planner asks its own meanwhile.
        self._room = self._loop.room(Collision(problem.scene.world, problem.scene.footprint).clearance)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state, for pictures; positions and contacts belong to `state`."""
        return self._data

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Stand at the first n entries of `state` at a time [s]; a robot on wheels rolls as it does without control."""
        super().reset(state, time)
        twist = self._twist(self._state, self._dynamics.idle(self._state))
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        self._stance.place(self._data, self._state, twist, self._command.dot(twist))
        if self._mocap is not None:
            self._mocap.place(self._data, time)
        mujoco.mj_step1(self._model, self._data)

    def advance(self, control_at: Control, rng: np.random.Generator) -> Advance:
        """Drive for one period; see `Plant.advance`."""
        return self._loop.drive(self.state, self._move, self._touching, self._room, control_at, rng)

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """One step, cut after its position stage, so that the contacts are those of the new state."""
        self._ctrl[:] = self._command.dot(self._twist(x, self._rate(x, u, dw)))
        if self._sweep is not None:
            self._joints[:] = self._data.qpos
        mujoco.mj_step2(self._model, self._data)
        if self._mocap is not None:
            self._mocap.place(self._data, self.time)
        mujoco.mj_step1(self._model, self._data)
        self._state = self._stance.read(self._data, x)
        return self._state

    def _touching(self, before: Array, x: Array) -> bool:
        # Nothing but the robot has joints, and MuJoCo lets bodies without touch no others: what touches is the robot.
        contact = self._data.contact
        if self._data.ncon > 0 and self._obstacles[contact.geom[contact.dist < -ROUNDING]].any():
            return True
        if self._sweep is not None:
            return self._run_over(self._sweep, before, x)
        return self._sweeps and self._room.blocked(before, x)

    def _run_over(self, sweep: Sweep, before: Array, x: Array) -> bool:
        """Tell whether a body passes over the robot within the step; its own shape counts if the footprint is met."""
        if not self._room.met(before, x):
            return False
        own = hypot(x[0] - before[0], x[1] - before[1]) + self._radius * float(np.abs(x[2:3] - before[2:3]).sum())
        now = self.time
        return sweep.meets(self._joints, self._data.qpos, now - self._loop.step, now, own, self._room.way)


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
