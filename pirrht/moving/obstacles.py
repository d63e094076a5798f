"""Gather J moving obstacles as arrays that kernels read, on a clock on which 0 is now."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover, Obstacle
from pirrht.geometry.scene import Scene, Workspace
from pirrht.geometry.shapes import Solids
from pirrht.geometry.world import WALL, MovingKernels
from pirrht.jit.records import Held
from pirrht.moving.certify import certify, note_unsure
from pirrht.moving.collision import MovingObstacles, jumps, radius_of, speed_bound
from pirrht.moving.distances import FASTEST, moving_clearance
from pirrht.moving.exits import begin, bridge, sweep, walls, walls_at, watch
from pirrht.moving.tuning import BODY, PARTS, ROW, TUNING

KERNELS = MovingKernels(watch, begin, walls, bridge, sweep, moving_clearance, certify)


class ObstacleNumbers(NamedTuple):
    """J moving obstacles, as numbers and addresses that kernels can take cheaply."""

    J: int  # number of bodies
    body: int  # address of float64 (J, BODY)
    parts: int  # address of int64 (J, PARTS)
    rows: int  # address of float64 (k, ROW), of all bodies
    solid: int  # address of float64 (K, SOLID)
    form: int  # address of int64 (K, TABLE)
    corner: int  # address of float64 (K, 2): where the lattice of a solid without a closed form begins [m]
    table: int  # address of float64: distances on these lattices, one after the other [m]
    pitch: float  # spacing of all lattices [m]
    height: float  # of the robot's centre [m]
    robot: float  # radius [m]
    speed: float  # the greatest of any point of any body, jumps aside [m/s]
    cutoff: float  # clearances are reported up to this [m]


class MovingObstacleArrays(Held, ObstacleNumbers):
    """J moving obstacles together with the arrays that the addresses point to: `geometry.world.Moving`."""

    collision: MovingObstacles  # the same obstacles as FCL has them
    kernels = KERNELS

    @classmethod
    def of(cls, scene: Scene) -> "MovingObstacleArrays":
        """Gather the moving obstacles of a scene; J may be 0."""
        cutoff = max(TUNING.cutoff_radii * scene.footprint.radius, TUNING.min_cutoff)
        return cls.around(scene.footprint, scene.movers, cutoff)

    @classmethod
    def around(cls, footprint: Footprint, movers: Sequence[Mover], cutoff: float) -> "MovingObstacleArrays":
        """Gather obstacles around a robot, distances from whose solids are right up to a cutoff [m]."""
        shapes, pitch = _shapes([solid for mover in movers for solid in mover.solids], footprint, cutoff)
        sizes = pitch, float(footprint.height), float(footprint.radius)
        return cls._holding(movers, shapes, sizes, cutoff, MovingObstacles(movers, footprint))

    def with_motions(self, movers: Sequence[Mover]) -> "MovingObstacleArrays":
        """Return these obstacles on other motions; shapes, FCL's included, are shared: one thread at a time asks."""
        shapes = [self.held[name] for name in ("solid", "form", "corner", "table")]
        sizes = (self.pitch, self.height, self.robot)

        return self._holding(movers, shapes, sizes, self.cutoff, self.collision.with_motions(movers))

    @classmethod
    def _holding(
        cls, movers: Sequence[Mover], shapes: Sequence[Array | IntArray], sizes: tuple[float, float, float],
        cutoff: float, collision: MovingObstacles,
    ) -> "MovingObstacleArrays":  # fmt: skip
        motions = _motions(movers, sizes[2])
        arrays: Sequence[Any] = [np.ascontiguousarray(one) for one in (*motions, *shapes)]
        numbers: Sequence[float] = *sizes, float(motions[0][:, FASTEST].max(initial=0.0)), cutoff
        made = cls.holding(len(movers), *arrays, *numbers)
        made.collision = collision
        return made

    def clearance(self, x: float, y: float, t: float) -> float:
        """Return the clearance of the robot's centre (x, y) [m] from the nearest at t [s], up to the cutoff [m]."""
        return float(moving_clearance(self, x, y, t))

    def walls(self, x: float, y: float, t: float, within: float) -> Array:
        """Return clearance [m], unit vector (x, y) away and velocity (x, y) [m/s] of those `within` [m], (k, 5)."""
        out = np.empty((self.J, WALL))
        return out[: walls_at(self, x, y, t, within, out)]

    def certify(self, ax: float, ay: float, bx: float, by: float, s: float, t: float) -> int:
        """Return FREE, UNSURE or BLOCKED for a straight step from (ax, ay) [m] at s [s] to (bx, by) at t."""
        return int(certify(self, (ax, ay, s, bx, by, t)))

    def distance(self, place: Array, t: float) -> float:
        """Return FCL's clearance of the robot's centre at a place (2,) [m] at t [s]."""
        return self.collision.clearance(place, t)

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """Return whether a straight step from a (2,) [m] at s [s] to b (2,) at t meets one, by FCL where in doubt."""
        unsure = np.zeros(self.J, dtype=np.bool_)
        note_unsure(self, (float(a[0]), float(a[1]), s, float(b[0]), float(b[1]), t), unsure)
        return bool(unsure.any()) and self.collision.meets(a, s, b, t, unsure)


def _motions(movers: Sequence[Mover], radius: float) -> tuple[Array, IntArray, Array]:
    """Return the first of the arrays, bodies, parts and rows, of obstacles about a robot of a radius [m]."""
    body = np.zeros((len(movers), BODY))
    parts = np.zeros((len(movers), PARTS), dtype=np.int64)
    rows = []

    row = solid = 0
    for j, mover in enumerate(movers):
        motion, far = mover.motion, radius_of(mover.solids)
        body[j] = (
            motion.offset, motion.rows[-1, 0] if motion.repeat else 0.0, jumps(motion), far + radius,
            speed_bound(motion, far),
        )  # fmt: skip
        parts[j] = row, row + len(motion.rows), solid, solid + len(mover.solids)
        row, solid = parts[j, [1, 3]]
        rates = np.diff(motion.rows[:, 1:], axis=0) * (1.0 / np.diff(motion.rows[:, :1], axis=0))
        rows.append(np.hstack([motion.rows, np.vstack([rates, np.zeros(3)])]))  # it stays at the last
    return body, parts, np.vstack([np.zeros((0, ROW)), *rows])


def _shapes(
    obstacles: list[Obstacle], footprint: Footprint, cutoff: float
) -> tuple[tuple[Array | IntArray, ...], float]:
    """Return the last of the arrays, of solids in the frames of their obstacles, and the spacing of lattices [m].

    Boxes, cylinders, spheres and capsules have closed forms; others have FCL's distances on a lattice around each, less
    the excess of interpolation, since next to large solids lattices are coarse for a small robot.
    """
    solids = Solids.of(obstacles)

    K = len(obstacles)
    tables = np.flatnonzero(solids.form < 0)
    fine = TUNING.table_pitch * footprint.radius

    margin = cutoff + footprint.radius + 2.0 * fine
    area = float(np.prod(solids.high[tables] - solids.low[tables] + 2.0 * margin, axis=1).sum())
    pitch = max(fine, math.sqrt(area / TUNING.table_points))

    first = np.zeros(K, dtype=np.int64)
    shape = np.zeros((K, 2), dtype=np.int64)
    corner = np.zeros((K, 2))

    parts: list[Array] = [np.zeros(0)]
    plane = np.full(2, 1e3)  # beyond any solid [m]
    for k in tables:
        corner[k] = solids.low[k] - cutoff - footprint.radius - pitch
        shape[k] = np.ceil((solids.high[k] + cutoff + footprint.radius - corner[k]) / pitch).astype(int) + 2
        first[k] = sum(map(len, parts))
        alone = Collision(Workspace(-plane, plane, (obstacles[k],)), footprint)
        index = np.stack(np.meshgrid(*map(np.arange, shape[k]), indexing="ij"), axis=-1).reshape(-1, 2)
        distance = alone.distance(corner[k] + pitch * index)
        parts.append(distance if pitch == fine else np.maximum(distance - _excess(distance, pitch), 0.0))
    numbers = np.hstack([solids.size, solids.position, solids.rotation.reshape(-1, 9)])
    return (numbers, np.column_stack([solids.form, first, shape]), corner, np.concatenate(parts)), pitch


def _excess(distance: Array, pitch: float) -> Array:
    """Bound how much too high bilinear interpolation next to a point may be, from the distance there [m]."""
    nearest = np.maximum(distance - math.sqrt(2.0) * pitch, 1e-9 * pitch)
    return np.asarray(np.minimum(pitch / math.sqrt(2.0), pitch**2 / (8.0 * nearest)))
