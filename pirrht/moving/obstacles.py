"""Gather J moving obstacles as arrays that kernels read, on a clock on which 0 is now."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.motion import Mover
from pirrht.geometry.scene import Scene
from pirrht.moving.bodies import gathered
from pirrht.moving.certify import certify_leg
from pirrht.moving.collision import jumps, radius_of, speed_bound
from pirrht.moving.distances import FASTEST, LEAD, RADIUS, moving_clearance, moving_walls
from pirrht.moving.spans import boxes_of
from pirrht.moving.tuning import BODY, BOX, PARTS, ROW, TUNING, WALL

MOTIONS = 4  # of the arrays change with the motions: of bodies, parts, rows and boxes, the first


class ObstacleNumbers(NamedTuple):
    """J moving obstacles, as numbers and addresses that kernels can take cheaply."""

    J: int  # number of bodies
    body: int  # address of float64 (J, BODY)
    parts: int  # address of int64 (J, PARTS)
    rows: int  # address of float64 (k, ROW), of all bodies
    boxes: int  # address of float64 (l, BOX), of all bodies: where each is within spans of time (`spans`)
    solid: int  # address of float64 (K, SOLID)
    form: int  # address of int64 (K, TABLE)
    corner: int  # address of float64 (K, 2): where the lattice of a solid without a closed form begins [m]
    table: int  # address of float64: distances on these lattices, one after the other [m]
    pitch: float  # spacing of all lattices [m]
    height: float  # of the robot's centre [m]
    robot: float  # radius [m]
    speed: float  # the greatest of any point of any body, jumps aside [m/s]
    cutoff: float  # clearances are reported up to this [m]


class MovingObstacleArrays(ObstacleNumbers):
    """J moving obstacles together with the arrays that the addresses point to."""

    arrays: Sequence[Array | IntArray]
    radius: Array  # (J,) of the disc around a body's origin outside of which the robot's centre is free [m]
    fastest: Array  # (J,) speed of any point of a body at most, jumps aside [m/s]

    @classmethod
    def of(cls, scene: Scene) -> MovingObstacleArrays:
        """Gather the moving obstacles of a scene; J may be 0."""
        movers, footprint = scene.movers, scene.footprint
        cutoff = max(TUNING.cutoff_radii * footprint.radius, TUNING.min_cutoff)
        bodies = gathered([(), *(mover.solids for mover in movers)], footprint, cutoff)
        solids = bodies.solids
        shapes = np.hstack([solids.size, solids.position, solids.rotation.reshape(-1, 9)])
        form = np.column_stack([solids.form, bodies.first, bodies.shape])
        motions = _motions(movers, footprint.radius)
        arrays = *motions, shapes, form, bodies.corner, bodies.table
        return cls._holding(arrays, (bodies.pitch, bodies.height, bodies.radius, _fastest(motions[0]), cutoff))

    def with_motions(self, movers: Sequence[Mover]) -> MovingObstacleArrays:
        """Return these obstacles on other motions."""
        motions, shapes = _motions(movers, self.robot), self.arrays[MOTIONS:]
        numbers = self.pitch, self.height, self.robot, _fastest(motions[0]), self.cutoff
        return self._holding((*motions, *shapes), numbers)

    @classmethod
    def _holding(cls, arrays: Sequence[Array | IntArray], numbers: Sequence[float]) -> MovingObstacleArrays:
        arrays = tuple(map(np.ascontiguousarray, arrays))
        body = np.asarray(arrays[0], dtype=float)
        made = cls(len(body), *(array.ctypes.data for array in arrays), *numbers)
        made.arrays, made.radius, made.fastest = arrays, body[:, RADIUS], body[:, FASTEST]
        return made

    def after(self, time: float) -> MovingObstacleArrays:
        """Return the obstacles on a clock that starts at a time [s] of this one's."""
        later = self.arrays[0].copy()
        later[:, LEAD] += time
        return self._holding((later, *self.arrays[1:]), (self.pitch, self.height, self.robot, self.speed, self.cutoff))

    def clearance(self, x: float, y: float, t: float) -> float:
        """Return the clearance of the robot's centre (x, y) [m] from the nearest at t [s], up to the cutoff [m]."""
        return float(moving_clearance(self, x, y, t))

    def walls(self, x: float, y: float, t: float, within: float) -> Array:
        """Return clearance [m], unit vector (x, y) away and velocity (x, y) [m/s] of those `within` [m], (k, 5)."""
        out = np.empty((self.J, WALL))
        return out[: moving_walls(self, x, y, t, within, out)]

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float, t: float) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) [m] at s [s] to (bx, by) at t."""
        return int(certify_leg(self, ax, ay, s, bx, by, t))


def _motions(movers: Sequence[Mover], radius: float) -> tuple[Array, IntArray, Array, Array]:
    """Return the first MOTIONS of the arrays, of obstacles about a robot of a radius [m]."""
    body, parts, rows = np.zeros((len(movers), BODY)), np.zeros((len(movers), PARTS), dtype=np.int64), []
    boxes = [boxes_of(mover.motion.rows, repeat=mover.motion.repeat) for mover in movers]
    row = solid = box = 0
    for j, mover in enumerate(movers):
        motion, far = mover.motion, radius_of(mover)
        body[j] = (
            motion.offset, motion.rows[-1, 0] if motion.repeat else 0.0, jumps(motion), far + radius,
            speed_bound(motion, far),
        )  # fmt: skip
        many = len(motion.rows), len(mover.solids), len(boxes[j])
        parts[j] = row, row + many[0], solid, solid + many[1], box, box + many[2]
        row, solid, box = row + many[0], solid + many[1], box + many[2]
        rows.append(_with_rates(motion.rows))
    return body, parts, np.vstack([np.zeros((0, ROW)), *rows]), np.vstack([np.zeros((0, BOX)), *boxes])


def _fastest(body: Array) -> float:
    """Return the greatest speed of any point of bodies (J, BODY) [m/s]."""
    return float(body[:, FASTEST].max(initial=0.0))


def _with_rates(rows: Array) -> Array:
    """Return rows (k, 4) of a motion with the rates at which it leaves each, (k, ROW); it stays at the last."""
    out, steps = np.zeros((len(rows), ROW)), rows[1:] - rows[:-1]
    out[:, :4] = rows
    out[:-1, 4:] = steps[:, 1:] * (1.0 / steps[:, :1])
    return out
