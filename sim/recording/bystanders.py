"""Which of the bodies that move a robot touches, at a place and a time."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, sin

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.collision import Collision
from pirrht.geometry.crowd import NOWHERE, reach_of
from pirrht.geometry.motion import Mover
from pirrht.geometry.scene import Footprint, World

ASKED = 3  # bodies that are asked how near they are


class Bystanders:
    """The shapes of bodies that move; how they move is told when they are asked about."""

    def __init__(self, movers: Sequence[Mover], footprint: Footprint) -> None:
        self._shapes = [Collision(World(-NOWHERE, NOWHERE, mover.solids), footprint) for mover in movers]
        self._reach = np.array([reach_of(mover) for mover in movers])
        self._radius = footprint.radius

    def nearest(self, movers: Sequence[Mover], places: Array, times: Array) -> list[tuple[float, str]]:
        """Free distance of a robot at places (k, 2) [m] and times (k,) [s] to the nearest body, and its name.

        Args:
            movers: the same bodies, as they are taken to move.
        """
        if not movers:
            return [(inf, "")] * len(places)
        poses = np.stack([mover.motion.pose(times) for mover in movers], axis=1)
        off = places[:, None] - poses[..., :2]
        near = np.argsort(np.linalg.norm(off, axis=2) - self._reach, axis=1, kind="stable")[:, :ASKED]
        return [
            min((self._free(j, away[j], float(yaws[j])), movers[j].name) for j in asked)
            for asked, away, yaws in zip(near.tolist(), off, poses[..., 2], strict=True)
        ]

    def _free(self, j: int, off: Array, yaw: float) -> float:
        c, s = cos(yaw), sin(yaw)
        own = np.array([[c * off[0] + s * off[1], c * off[1] - s * off[0]]])
        return float(self._shapes[j].distance(own)[0]) - self._radius
