"""Where the state sits in MuJoCo's coordinates: in sliding joints, or in the pose of a body on wheels.

A robot that slides has one joint per state. One that rolls has a free joint and wheels; its state is x, y and
the unwrapped heading of its body, and it is placed at rest on its wheels, yet already at its speed: the
stochastic equation knows no start from standstill.
"""

from __future__ import annotations

from math import atan2, cos, remainder, sin, tau
from typing import Protocol

import mujoco
import numpy as np

from pirrht.arrays import Array

GROUND = "ground"  # the plane a rolling robot brings along, in its worldbody
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


class Stance(Protocol):
    """Translates between the state and MuJoCo's coordinates, for one model."""

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Stand at `state` (n,); wheels roll with `twist` (2,) under the commands `ctrl` (nu,)."""

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """The state now, (n,), given the one of the step before."""


def stance_of(model: mujoco.MjModel) -> Stance:
    """The stance of the robot in a joined model, whose keyframe 0 holds it at rest."""
    return Rolling(model) if rolls(model) else Sliding()


def rolls(model: mujoco.MjModel) -> bool:
    """Whether the robot moves by a free joint."""
    return bool(model.njnt > 0 and model.jnt_type[0] == _FREE)


class Sliding:
    """Joint positions are the state."""

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Stand still; see `Stance.place`."""
        data.qpos[:] = state[: data.qpos.size]

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """The joint positions, (n,)."""
        return data.qpos.copy()  # type: ignore[no-any-return]


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
