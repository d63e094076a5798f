"""The bodies of the robot: where each is at a state, and how far its wheels have turned.

The root follows the state. Wheels are bodies whose names end with "wheel", or that turn by a hinge of their own about
a level axis; they roll without slipping by what their centres have moved ahead, physics step by physics step, with
the radius that takes them to the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from pirrht.arrays import Array
from sim.mjcf import Loaded
from sim.mjcf.coordinates import stance_of

ROOT = "robot/robot"
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A body of the robot other than its root, as it sits in the root."""

    name: str  # in the model
    place: Array  # (3,) [m]
    turn: Array  # (4,) quaternion, w first
    radius: float  # of a wheel [m]; 0 of what does not roll
    axis: Array  # (3,) of a wheel, in its own frame


class Bodies:
    """Poses of the robot's bodies along a drive."""

    def __init__(self, loaded: Loaded) -> None:
        self._model, self._data = loaded.model, mujoco.MjData(loaded.model)
        self._stance = stance_of(loaded.model, loaded.states)
        self._root = int(loaded.model.body(ROOT).id)
        mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        mujoco.mj_kinematics(self._model, self._data)
        inside = np.flatnonzero(self._model.body_rootid == self._root)
        self.parts = tuple(self._part(int(body)) for body in inside if body != self._root)
        self.wheels = tuple(part for part in self.parts if part.radius > 0.0)
        self._rolled = np.zeros(len(self.wheels))
        self._before: Array | None = None

    def _part(self, body: int) -> Part:
        model, data, back = self._model, self._data, np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[self._root])
        place, turn = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(place, data.xpos[body] - data.xpos[self._root], back)
        mujoco.mju_mulQuat(turn, back, data.xquat[body])
        joint = int(model.body_jntadr[body])
        hinged = joint >= 0 and int(model.jnt_type[joint]) == HINGE
        axis = np.array(model.jnt_axis[joint]) if hinged else np.array([0.0, 1.0, 0.0])
        level = abs(data.xmat[body].reshape(3, 3)[2] @ axis) < 0.1
        rolls = level and (hinged or model.body(body).name.endswith("wheel"))
        radius = float(data.xpos[body, 2]) if rolls else 0.0
        return Part(name=model.body(body).name, place=place, turn=turn, radius=max(radius, 0.0), axis=axis)

    def root(self, states: Array) -> Array:
        """Poses (k, 7) of the root at states (k, n): x, y, z [m] and a quaternion, w last."""
        poses = np.empty((len(states), 7))
        still, rest = np.zeros(2), np.zeros(self._model.nu)
        for pose, state in zip(poses, states, strict=True):
            self._stance.place(self._data, state, still, rest)
            mujoco.mj_kinematics(self._model, self._data)
            pose[:3], pose[3:] = self._data.xpos[self._root], np.roll(self._data.xquat[self._root], -1)
        return poses

    def roll(self, states: Array, headings: Array) -> None:
        """Turn the wheels along states (k, n) with headings (k,) [rad], which follow those of the last call."""
        here = np.column_stack([states[:, :2], headings])
        whole = here if self._before is None else np.vstack([self._before, here])
        self._before = here[-1:]
        for i, wheel in enumerate(self.wheels):
            self._rolled[i] += _ahead(whole, wheel.place) / wheel.radius

    def turned(self) -> Array:
        """Quaternions (w, 4) of the wheels in the root, w last."""
        found, spin = np.empty((len(self.wheels), 4)), np.empty(4)
        for row, wheel, angle in zip(found, self.wheels, self._rolled, strict=True):
            mujoco.mju_axisAngle2Quat(spin, wheel.axis, float(angle))
            mujoco.mju_mulQuat(row, wheel.turn, spin)
        return np.roll(found, -1, axis=1)


def _ahead(poses: Array, place: Array) -> float:
    """How far a point of the robot moves along its heading over poses x, y, heading (k, 3) [m]."""
    x, y, heading = poses.T
    c, s = np.cos(heading), np.sin(heading)
    points = np.column_stack([x + c * place[0] - s * place[1], y + s * place[0] + c * place[1]])
    steps, middle = np.diff(points, axis=0), 0.5 * (heading[1:] + heading[:-1])
    return float(np.sum(steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)))
