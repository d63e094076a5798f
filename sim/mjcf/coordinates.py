"""Where the state sits in MuJoCo's coordinates: in sliding joints, or in the pose of a body on wheels.

A robot that slides has one joint per state that is its place; states "vx" and "vy" are the speeds of its slides, and
"speed" is that of its body ahead, with which it is placed as it stands. One that rolls has a free joint and wheels; its
state is x, y and the unwrapped heading of its body, and it is placed at rest on its wheels, yet already at its speed:
the stochastic equation knows no start from standstill.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, remainder, sin, tau
from typing import Protocol

import mujoco
import numpy as np

from pirrht.arrays import Array
from sim.systems import POSE, SPEED, VELOCITIES

GROUND = "ground"  # the plane a rolling robot brings along, in its worldbody
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


class Stance(Protocol):
    """Translates between the state and MuJoCo's coordinates, for one model."""

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Stand at `state` (n,); wheels roll with `twist` (2,) under the commands `ctrl` (nu,)."""

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """The state now, (n,), given the one of the step before."""


def stance_of(model: mujoco.MjModel, states: Sequence[str] = POSE) -> Stance:
    """The stance of the robot in a joined model, whose keyframe 0 holds it at rest, for states of these names (n,)."""
    return Rolling(model) if rolls(model) else Sliding(states)


def unread(model: mujoco.MjModel, states: Sequence[str]) -> list[str]:
    """Those of the states (n,) that a model's robot does not have."""
    has = POSE if rolls(model) else (*POSE[: model.nq], *VELOCITIES, *(SPEED if model.nq > 2 else ()))
    return [name for name in states if name not in has]


def standing(pose: Array, states: Sequence[str]) -> Array:
    """The state (n,) at a pose x, y [m] and heading [rad] (3,); whatever else it has is zero."""
    return np.array([pose[POSE.index(name)] if name in POSE else 0.0 for name in states])


def rolls(model: mujoco.MjModel) -> bool:
    """Whether the robot moves by a free joint."""
    return bool(model.njnt > 0 and model.jnt_type[0] == _FREE)


class Sliding:
    """Joint positions are the state, and joint speeds where it has velocities."""

    def __init__(self, states: Sequence[str]) -> None:
        pairs = list(enumerate(states))
        self._places = [i for i, name in pairs if name in POSE]
        self._speeds = [i for i, name in pairs if name in VELOCITIES]
        self._dofs = [VELOCITIES.index(name) for _, name in pairs if name in VELOCITIES]
        self._ahead = [i for i, name in pairs if name in SPEED]

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Stand, at the state's velocities if it has some; see `Stance.place`."""
        data.qpos[:] = state[self._places[: data.qpos.size]]
        data.qvel[:] = 0
        data.qvel[self._dofs] = state[self._speeds]
        for i in self._ahead:
            heading = data.qpos[2]
            data.qvel[:2] = state[i] * cos(heading), state[i] * sin(heading)

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Joint positions and speeds as the state has them, (n,)."""
        if not self._speeds and not self._ahead:
            return data.qpos.copy()  # type: ignore[no-any-return]
        state = before.copy()
        state[self._places] = data.qpos
        state[self._speeds] = data.qvel[self._dofs]
        for i in self._ahead:
            heading = data.qpos[2]
            state[i] = data.qvel[0] * cos(heading) + data.qvel[1] * sin(heading)
        return state


class Rolling:
    """The pose of a free joint is the state, and wheels carry it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._rest = model.key_qpos[0].copy()
        self._wheels = model.jnt_dofadr[model.actuator_trnid[:, 0]]

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Stand on the wheels as at rest, rolling; see `Stance.place`."""
        x, y, heading = state[:3]
        data.qpos[:] = self._rest
        turn_to(data.qpos, heading)
        data.qpos[:2] = x, y
        data.qvel[:] = 0
        data.qvel[:2] = twist[0] * cos(heading), twist[0] * sin(heading)
        data.qvel[5] = twist[1]
        data.qvel[self._wheels] = ctrl

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """Position and heading of the body; the heading goes on from the one before, (3,)."""
        x, y, _, *quaternion = data.qpos[:7].tolist()
        return np.array([x, y, before[2] + remainder(heading_of(quaternion) - before[2], tau)])


def settled(model: mujoco.MjModel, seconds: float = 2.0) -> Array:
    """Joint positions of a rolling robot that has come to rest at the origin, heading along x, (nq,)."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=max(1, round(seconds / model.opt.timestep)))
    rest = model.qpos0.copy()
    rest[2:7] = data.qpos[2:7]
    turn_to(rest, 0.0)
    return rest  # type: ignore[no-any-return]


def turn_to(qpos: Array, heading: float) -> None:
    """Turn a free joint about the vertical to a heading [rad], in place, keeping its tilt."""
    half = 0.5 * (heading - heading_of(qpos[3:7]))
    turned = np.empty(4)
    mujoco.mju_mulQuat(turned, np.array([cos(half), 0.0, 0.0, sin(half)]), qpos[3:7])
    qpos[3:7] = turned


def heading_of(quaternion: Array | list[float]) -> float:
    """Direction of the body's x-axis seen from above, in (-pi, pi] [rad]."""
    w, x, y, z = quaternion
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
