"""Where the state sits in MuJoCo's coordinates: in sliding joints, or in the pose of a body on wheels.

A robot that slides has one joint per state that is its place; states "vx" and "vy" are the speeds of its slides, and
"speed" is that of its body ahead. One that rolls has a free joint and wheels; its state is x, y and the unwrapped
heading of its body. It is placed at rest on its wheels, yet at its speed: the equation knows no start from standstill.
"""

from collections.abc import Sequence
from math import atan2, cos, remainder, sin, tau

import mujoco
import numpy as np

from pirrht.arrays import Array
from sim.systems import POSE, VELOCITIES

GROUND = "ground"  # the plane a rolling robot brings along, in its worldbody


class Stance:
    """How states (n,) of these names translate for the robot of a joined model, whose keyframe 0 holds it at rest."""

    def __init__(self, model: mujoco.MjModel, states: Sequence[str] = POSE) -> None:
        self._rest = model.key_qpos[0].copy()
        self._rolls = rolls(model)
        self._wheels = model.jnt_dofadr[model.actuator_trnid[:, 0]] if self._rolls else []
        self._places = [states.index(name) for name in POSE if name in states]
        self._dofs = [i for i, name in enumerate(VELOCITIES) if name in states]
        self._speeds = [states.index(VELOCITIES[i]) for i in self._dofs]
        self._ahead = states.index("speed") if "speed" in states else None

    def place(self, data: mujoco.MjData, state: Array, twist: Array, ctrl: Array) -> None:
        """Place the robot at `state` (n,); wheels roll with `twist` (2,) under the commands `ctrl` (nu,)."""
        data.qvel[:] = 0
        x, y, heading = [*state[self._places], 0.0][:3]
        if self._rolls:
            data.qpos[:] = self._rest
            turn_to(data.qpos, heading)
            data.qpos[:2] = x, y
            data.qvel[:2] = twist[0] * cos(heading), twist[0] * sin(heading)
            data.qvel[5] = twist[1]
            data.qvel[self._wheels] = ctrl
            return
        data.qpos[:] = (x, y, heading)[: data.qpos.size]
        data.qvel[self._dofs] = state[self._speeds]
        if self._ahead is not None:
            data.qvel[:2] = state[self._ahead] * cos(heading), state[self._ahead] * sin(heading)

    def read(self, data: mujoco.MjData, before: Array) -> Array:
        """The state now, (n,), given the one of the step before, from which the heading of a body on wheels goes on."""
        if self._rolls:
            x, y, _, *quaternion = data.qpos[:7].tolist()
            return np.array([x, y, before[2] + remainder(heading_of(quaternion) - before[2], tau)])
        if not self._speeds and self._ahead is None:
            return data.qpos.copy()  # type: ignore[no-any-return]
        state = before.copy()
        state[self._places] = data.qpos
        state[self._speeds] = data.qvel[self._dofs]
        if self._ahead is not None:
            state[self._ahead] = data.qvel[0] * cos(data.qpos[2]) + data.qvel[1] * sin(data.qpos[2])
        return state


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
