"""Moving bodies in MuJoCo: their mocap poses follow their motions, about the vertical through where they stand."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Mover

_ABOUT_VERTICAL = np.array([-1.0, -1.0, 1.0, 1.0])  # k (w, x, y, z) = (-z, -y, x, w)


class Mocap:
    """Places the J moving bodies of a model: x, y and yaw by the motion, height and tilt as the file has them."""

    def __init__(self, model: mujoco.MjModel, movers: Sequence[Mover]) -> None:
        bodies = [int(model.body(mover.name).id) for mover in movers]
        self._motions = [mover.motion for mover in movers]
        self._rows = model.body_mocapid[bodies]
        self._heights = model.body_pos[bodies, 2]
        yaws = np.array([motion.rows[0, 3] for motion in self._motions])
        self._upright = _turned(model.body_quat[bodies], -yaws)  # at yaw 0

    def place(self, data: mujoco.MjData, time: float) -> None:
        """Place the bodies as they are at a time [s]."""
        poses = np.array([motion.pose_at(time) for motion in self._motions])
        data.mocap_quat[self._rows] = _turned(self._upright, poses[:, 2])
        poses[:, 2] = self._heights
        data.mocap_pos[self._rows] = poses

    def poses(self, times: Array) -> tuple[Array, Array]:
        """Places (k, J, 3) [m] and quaternions (k, J, 4), w first, at times (k,) [s]."""
        found = np.stack([motion.pose(times) for motion in self._motions], axis=1)
        heights = np.broadcast_to(self._heights, found.shape[:2])
        return np.dstack([found[..., :2], heights]), _turned(self._upright, found[..., 2])


def _turned(quaternions: Array, yaws: Array) -> Array:
    """Quaternions (..., 4), w first, turned about the vertical by yaws (...) [rad]."""
    half = 0.5 * yaws[..., None]
    return np.asarray(np.cos(half) * quaternions + np.sin(half) * (_ABOUT_VERTICAL * quaternions[..., ::-1]))
