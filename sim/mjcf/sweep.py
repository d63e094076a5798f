"""Whether a body passes over a robot between two steps, where what collides is smaller than the footprint."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.collision import SHORTEST, touches
from sim.mjcf.mocap import Mocap
from sim.mjcf.obstacles import Mask


class Sweep:
    """The robot's own geoms against those of moving bodies, by MuJoCo's distances on a model of its own."""

    def __init__(self, model: mujoco.MjModel, robot: Mask, bodies: Mask, mocap: Mocap) -> None:
        self._model, self._data, self._mocap = model, mujoco.MjData(model), mocap
        offered, accepted = model.geom_contype, model.geom_conaffinity
        pairs = [
            (int(mine), int(other))
            for mine in np.flatnonzero(robot)
            for other in np.flatnonzero(bodies)
            if (offered[mine] & accepted[other]) | (offered[other] & accepted[mine])
        ]
        self._pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        self._round = model.geom_rbound[self._pairs].sum(axis=1)  # of the balls around both geoms of a pair [m]

    def meets(
        self, before: Array, after: Array, begin: float, end: float, own: float, way: Callable[[float, float], float]
    ) -> bool:
        """Whether they touch on the way between joint positions, 2 x (nq,), from `begin` to `end` [s].

        Args:
            own: how far any point of the robot moves at most [m].
            way: tells the same of bodies between two times [s].
        """
        far = own + way(begin, end) + SHORTEST

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
            free, lambda a, b: (b - a) * own + way(time(a), time(b)), undecided=False
        )
