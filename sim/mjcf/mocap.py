"""Moving bodies in MuJoCo: their mocap poses follow their motions, about the vertical through where they stand."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Mover

AT_ONCE = 64  # steps whose poses are found together


class Mocap:
    """Places the J moving bodies of a model.

    Height and tilt stay as the file has them; x, y and yaw are those of the motion.
    """

    def __init__(self, model: mujoco.MjModel, movers: Sequence[Mover]) -> None:
        bodies = [int(model.body(mover.name).id) for mover in movers]
        self._motions = [mover.motion for mover in movers]
        self._rows = model.body_mocapid[bodies]
        self._heights = model.body_pos[bodies, 2]
        yaws = np.array([motion.rows[0, 3] for motion in self._motions])
        self._upright = _turned(model.body_quat[bodies], -yaws)  # at yaw 0
        self._begun = self._step = 0.0
        self._first, self._places, self._turns = 0, np.empty((0, len(bodies), 3)), np.empty((0, len(bodies), 4))

    def start(self, time: float, step: float) -> None:
        """Count steps of a length from a time on [s]."""
        self._begun, self._step = time, step
        self._places = self._places[:0]

    def step(self, data: mujoco.MjData, number: int) -> None:
        """Place the bodies as they are at the end of a step; 0 is where it started."""
        k = number - self._first
        if not 0 <= k < len(self._places):
            self._first, k = number, 0
            self._places, self._turns = self.poses(self._times(number))
        data.mocap_pos[self._rows], data.mocap_quat[self._rows] = self._places[k], self._turns[k]

    def _times(self, first: int) -> Array:
        return self._begun + np.arange(first, first + AT_ONCE, dtype=float) * self._step

    def place(self, data: mujoco.MjData, time: float) -> None:
        """Place the bodies as they are at a time [s]."""
        poses = np.array([motion.pose_at(time) for motion in self._motions])
        data.mocap_pos[self._rows] = np.column_stack([poses[:, :2], self._heights])
        data.mocap_quat[self._rows] = _turned(self._upright, poses[:, 2])

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Places (k, J, 3) [m] and quaternions (k, J, 4), w first, at times (k,) [s]."""
        found = np.stack([motion.pose(times) for motion in self._motions], axis=1)
        heights = np.broadcast_to(self._heights, found.shape[:2])
        return np.dstack([found[..., :2], heights]), _turned(self._upright, found[..., 2])


def _turned(quaternions: Array, yaws: Array) -> Array:
    """Quaternions (..., 4), w first, turned about the vertical by yaws (...) [rad]."""
    c, s = np.cos(0.5 * yaws), np.sin(0.5 * yaws)
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return np.stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)
