"""The robot in MuJoCo, driven for one control period at a time.

Noise enters with the control. Every physics step of length h draws one increment dw ~ N(0, h I), whatever the method
and the noise level, and commands `ctrl = M @ twist(x, f_c + G u + B dw/h)`, or where noise enters through the inputs
`ctrl = M @ twist(x, u + s dw/h)`. With deadbeat servos a step of MuJoCo is then the Euler-Maruyama step of the
equation, and the displacement has covariance B B' t. Motors take accelerations instead: the velocity's step is then
that of the equation, and the position moves on with the velocity of the step's end (semi-implicit Euler) where the
equation alone takes that of its start. Wheels with slow servos follow it up to their lag (models/robots/diffdrive.xml).
A step of white noise may be longer than a wall is thick: what is between two steps counts as well as their ends.
Moving obstacles are where their motions say at the end of each step, by the plant's own clock.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.scene import ROUNDING
from pirrht.problem import Problem
from pirrht.systems.dynamics import Dynamics
from sim.drive.plant import ClearanceChecker, Plant
from sim.mjcf import Loaded
from sim.mjcf.coordinates import stance_of
from sim.mjcf.mocap import Mocap, Sweep
from sim.mjcf.robot import check_motion
from sim.systems import named

FOOTPRINT = "robot/footprint"  # geom of every robot


class Executor(Plant):
    """The robot in MuJoCo.

    Attributes:
        data: MuJoCo's state, for pictures; positions and contacts belong to `state`.
    """

    def __init__(self, loaded: Loaded, problem: Problem, *, period: float) -> None:
        model = self._model = loaded.model
        called, n = named(loaded.dynamics_name).called, problem.dynamics.n
        if n != len(loaded.states):
            raise OptionError(
                f'robot "{loaded.robot}" moves as a {called} with {len(loaded.states)} states; '
                f"{type(problem.dynamics).__name__} has {n}"
            )
        check_motion(model, called, problem.dynamics, loaded.command)
        super().__init__(problem, None, period, float(model.opt.timestep))
        self._rate = commanded_rate(problem.dynamics, self.physics_step)
        self.data, self._stance = mujoco.MjData(model), stance_of(model, loaded.states)
        self._command, self._obstacles = loaded.command, loaded.obstacle_geoms
        self._mocap = Mocap(model, loaded.scene.movers) if loaded.scene.movers else None
        # Where the footprint is what collides, white noise may carry it through a wall within a step; others are slow.
        self._sweeps = bool(model.geom(FOOTPRINT).contype[0] | model.geom(FOOTPRINT).conaffinity[0])
        self._sweep: Sweep | None = None
        self._joints = np.empty(model.nq)  # before the step
        if self._mocap is not None and not self._sweeps:
            bodies = loaded.moving_geoms & loaded.obstacle_geoms
            self._sweep = Sweep(model, loaded.robot_geoms, bodies, self._mocap)
        self.reset(problem.dynamics.state_of(problem.scene.start))

    def enter(self, problem: Problem) -> None:
        """Continue in this problem, of the same robot: among its obstacles, to its goal, under its noise.

        Bodies in MuJoCo stay where they are.
        """
        self._problem, self._checker = problem, ClearanceChecker(problem.scene)
        self._rate = commanded_rate(problem.dynamics, self.physics_step)

    def reset(self, state: Array, time: float = 0.0) -> None:
        """Start from the first n entries of `state` at a time [s]; wheels roll as they do without control."""
        super().reset(state, time)
        dynamics = self._problem.dynamics
        twist = dynamics.twist(self._state, dynamics.idle(self._state))
        mujoco.mj_resetDataKeyframe(self._model, self.data, 0)
        self._stance.place(self.data, self._state, twist, self._command.dot(twist))
        if self._mocap is not None:
            self._mocap.place(self.data, time)
        mujoco.mj_step1(self._model, self.data)

    def _move(self, x: Array, u: Array, dw: Array, step: float) -> Array:
        """Make one step, cut after its position stage, so that the contacts are those of the new state."""
        self.data.ctrl[:] = self._command.dot(self._problem.dynamics.twist(x, self._rate(x, u, dw)))
        if self._sweep is not None:
            self._joints[:] = self.data.qpos
        mujoco.mj_step2(self._model, self.data)
        if self._mocap is not None:
            self._mocap.place(self.data, self.time)
        mujoco.mj_step1(self._model, self.data)
        return self._stance.read(self.data, x)

    def _touching(self, before: Array, x: Array) -> bool:
        # Nothing but the robot has joints, and MuJoCo lets bodies without touch no others: what touches is the robot.
        contact, now = self.data.contact, self.time
        begin = now - self.physics_step
        if self.data.ncon > 0 and self._obstacles[contact.geom[contact.dist < -ROUNDING]].any():
            return True
        crowd = self._checker.crowd
        if self._sweep is None or crowd is None:
            return self._sweeps and self._checker.blocked(before, x, begin, now)
        if not self._checker.met(before, x, begin, now):
            return False
        turned = self._problem.scene.robot_radius * float(np.abs(x[2:3] - before[2:3]).sum())
        own = hypot(x[0] - before[0], x[1] - before[1]) + turned
        return self._sweep.meets(self._joints, self.data.qpos, (begin, now), own, crowd.travel)


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
