"""Where the state sits in MuJoCo's coordinates: in sliding joints, or in the pose of a body on wheels.

A robot that slides has one joint per state that is its place; states "vx" and "vy" are the speeds of its slides, and
"speed" is that of its body ahead. One that rolls has a free joint and wheels; its state is x, y and the unwrapped
heading of its body. It is placed at rest on its wheels, yet at its speed: the equation knows no start from standstill.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, remainder, sin, tau

import mujoco
import numpy as np

from pirrht.arrays import Array
from sim.systems import POSE, VELOCITIES

GROUND = "ground"  # the plane a rolling robot brings along, in its worldbody


class Sliding:
    """Joint positions are the state, and joint speeds where it has velocities."""

    def __init__(self, states: Sequence[str]) -> None:
        index = {name: i for i, name in enumerate(states)}
        self._places = [i for name, i in index.items() if name in POSE]
        self._speeds = [i for name, i in index.items() if name in VELOCITIES]
        self._dofs = [VELOCITIES.index(states[i]) for i in self._speeds]
        self._ahead = index.get("speed")

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,), with its velocities if it has some."""
        data.qpos[:] = state[self._places[: data.qpos.size]]
        data.qvel[:] = 0
        data.qvel[self._dofs] = state[self._speeds]
        if self._ahead is not None:
            data.qvel[:2] = state[self._ahead] * cos(data.qpos[2]), state[self._ahead] * sin(data.qpos[2])

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """The state now, (n,), given the one of the step before."""
        if not self._speeds and self._ahead is None:
            return data.qpos.copy()  # type: ignore[no-any-return]
        state = before.copy()
        state[self._places] = data.qpos
        state[self._speeds] = data.qvel[self._dofs]
        if self._ahead is not None:
            state[self._ahead] = data.qvel[0] * cos(data.qpos[2]) + data.qvel[1] * sin(data.qpos[2])
        return state


class Rolling:
    """The pose of a free joint is the state, and wheels carry it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._rest = model.key_qpos[0].copy()
        self._wheels = model.jnt_dofadr[model.actuator_trnid[:, 0]]

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (3,) at rest; wheels roll with `twist` (2,) under the commands `ctrl` (nu,)."""
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


def stance_of(model: mujoco.MjModel, states: Sequence[str] = POSE) -> Sliding | Rolling:
    """How states of these names (n,) translate for the robot of a joined model, whose keyframe 0 holds it at rest."""
    return Rolling(model) if rolls(model) else Sliding(states)


def rolls(model: mujoco.MjModel) -> bool:
    """Whether the robot moves by a free joint."""
    return bool(model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE)


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
