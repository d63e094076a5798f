"""Moving bodies in MuJoCo: their mocap poses follow their motions, about the vertical through where they stand."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.collision import SHORTEST, touches
from pirrht.geometry.obstacle import Mover
from sim.mjcf.obstacles import Mask

_ABOUT_VERTICAL = np.array([-1.0, -1.0, 1.0, 1.0])  # k (w, x, y, z) = (-z, -y, x, w)


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


class Sweep:
    """The robot's own geoms against those of moving bodies between two steps, by MuJoCo's distances."""

    def __init__(self, model: mujoco.MjModel, robot: Mask, bodies: Mask, mocap: Mocap) -> None:
        self._model, self._data, self._mocap = model, mujoco.MjData(model), mocap
        offered, accepted = model.geom_contype, model.geom_conaffinity
        match = (offered[:, None] & accepted) | (offered & accepted[:, None])
        self._pairs = np.argwhere((match != 0) & robot[:, None] & bodies)
        self._round = model.geom_rbound[self._pairs].sum(axis=1)  # of the balls around both geoms of a pair [m]

    def meets(
        self,
        before: Array,
        after: Array,
        times: tuple[float, float],
        own: float,
        travel: Callable[[float, float], float],
    ) -> bool:
        """Whether they touch between joint positions, 2 x (nq,), at two times [s].

        Args:
            own: how far any point of the robot moves at most [m].
            travel: how far any point of the bodies moves at most between two times [s].
        """
        begin, end = times
        far = own + travel(begin, end) + SHORTEST

        def time(share: float) -> float:
            return begin + share * (end - begin)

        def free(share: float) -> float:
            self._data.qpos[:] = before + share * (after - before)
            self._mocap.place(self._data, time(share))
            mujoco.mj_kinematics(self._model, self._data)
            mine, other = self._data.geom_xpos[self._pairs.T]
            near = np.sum((mine - other) ** 2, axis=1) < (self._round + far) ** 2
            distances = (
                float(mujoco.mj_geomDistance(self._model, self._data, one, another, far, None))
                for one, another in self._pairs[near].tolist()
            )
            return min(distances, default=far)

        return bool(len(self._pairs)) and touches(
            free, lambda a, b: (b - a) * own + travel(time(a), time(b)), undecided=False
        )
