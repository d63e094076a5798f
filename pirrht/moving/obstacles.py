"""Gather J moving obstacles as arrays that kernels read, on a clock on which 0 is now."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint, cover
from pirrht.geometry.obstacle import Mover, Obstacle
from pirrht.geometry.polygon import grouped
from pirrht.geometry.scene import Scene, Workspace
from pirrht.geometry.shapes import Solids
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.geometry.world import WALL, MovingKernels, Pose
from pirrht.jit.records import Held
from pirrht.moving.certify import certify, certify_turn, note_unsure
from pirrht.moving.collision import MovingObstacles, jumps, radius_of, speed_bound
from pirrht.moving.distances import FASTEST, moving_clearance
from pirrht.moving.exits import begin, bridge, sweep, walls, walls_at, watch
from pirrht.moving.tuning import BODY, PARTS, ROW, TUNING

KERNELS = MovingKernels(watch, begin, walls, bridge, sweep, moving_clearance, certify, certify_turn)


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
    robot: float  # radius of the least of its discs [m]
    discs: int  # address of float64 (size, DISC): groups, then the discs that cover the robot (`geometry.polygon`)
    groups: int  # number of groups
    near: float  # up to this clearance of a group its discs count [m]
    reach: float  # by how much a turn moves any point of the robot at most per radian [m/rad]; 0 for a disc
    excess: float  # by which a disc reaches beyond the robot at most [m]
    speed: float  # the greatest of any point of any body, jumps aside [m/s]
    cutoff: float  # clearances are reported up to this [m]


class MovingObstacleArrays(Held, ObstacleNumbers):
    """J moving obstacles together with the arrays that the addresses point to: `geometry.world.Moving`."""

    collision: MovingObstacles  # the same obstacles as FCL has them
    kernels = KERNELS

    @classmethod
    def of(cls, scene: Scene) -> "MovingObstacleArrays":
        """Gather the moving obstacles of a scene; J may be 0."""
        radius = scene.footprint.radius if scene.footprint.is_disc else 0.0  # lattices are finer for a polygon's discs
        return cls.around(scene.footprint, scene.movers, max(TUNING.cutoff_radii * radius, TUNING.min_cutoff))

    @classmethod
    def around(cls, footprint: Footprint, movers: Sequence[Mover], cutoff: float) -> "MovingObstacleArrays":
        """Gather obstacles around a robot, distances from whose solids are right up to a cutoff [m]."""
        excess = 0.0 if footprint.is_disc else TUNING.cover_share * GEOMETRY.excess
        discs = cover(footprint, excess)
        least = float(discs[:, 2].min())
        most = float(discs[:, 2].max())
        table, groups = grouped(footprint, discs, GEOMETRY.group_excess * excess)
        solids = [solid for mover in movers for solid in mover.solids]
        shapes, pitch = _shapes(solids, footprint.height, least, cutoff + most)
        reach = 0.0 if footprint.is_disc else footprint.reach
        robot = least, table, groups, GEOMETRY.tight * excess, reach, excess
        rest = (*shapes, pitch, float(footprint.height), *robot)
        return cls._holding(movers, rest, cutoff, MovingObstacles(movers, footprint))

    def with_motions(self, movers: Sequence[Mover]) -> "MovingObstacleArrays":
        """Return these obstacles on other motions; shapes, FCL's included, are shared: one thread at a time asks."""
        rest = [*self.contents.values()][ObstacleNumbers._fields.index("solid") : -2]
        return self._holding(movers, rest, self.cutoff, self.collision.with_motions(movers))

    @classmethod
    def _holding(
        cls, movers: Sequence[Mover], rest: Sequence[Any], cutoff: float, collision: MovingObstacles
    ) -> "MovingObstacleArrays":  # fmt: skip
        """Make it of motions, and the fields from `solid` to `excess`."""
        motions = _motions(movers, collision.footprint.reach)
        whole = [np.ascontiguousarray(one) if isinstance(one, np.ndarray) else one for one in (*motions, *rest)]
        made = cls.holding(len(movers), *whole, float(motions[0][:, FASTEST].max(initial=0.0)), cutoff)
        made.collision = collision
        return made

    def clearance(self, pose: Pose, t: float) -> float:
        """Return the clearance of a pose from the nearest at t [s], up to the cutoff [m]."""
        return float(moving_clearance(self, pose, t))

    def walls(self, pose: Pose, t: float, within: float) -> Array:
        """Return clearance [m], direction away and velocity (x, y) [m/s] of those `within` [m] of a pose, (k, 6)."""
        out = np.empty((self.J, WALL))
        return out[: walls_at(self, pose, t, within, out), :-1]

    def distance(self, pose: Array, t: float) -> float:
        """Return the exact clearance of a pose (2,) or (3,) [m, m, rad] at t [s], [m]."""
        return self.collision.clearance(pose, t)

    def meets(self, a: Array, s: float, b: Array, t: float) -> bool:
        """Return whether a straight step between poses, a at s [s] and b at t, meets one, exactly where in doubt."""
        unsure = np.ones(self.J, dtype=np.bool_)
        if a[-1] == b[-1] or len(a) == 2:  # else it turns
            note_unsure(self, (float(a[0]), float(a[1]), s, float(b[0]), float(b[1]), t), float(a[-1]), unsure)
        return bool(unsure.any()) and self.collision.meets(a, s, b, t, unsure, undecided=True)


def _motions(movers: Sequence[Mover], reach: float) -> tuple[Array, IntArray, Array]:
    """Return the first of the arrays, bodies, parts and rows, of obstacles about a robot that reaches so far [m]."""
    body = np.zeros((len(movers), BODY))
    parts = np.zeros((len(movers), PARTS), dtype=np.int64)
    rows = []

    row = solid = 0
    for j, mover in enumerate(movers):
        motion = mover.motion
        far = radius_of(mover.solids)
        body[j] = (
            motion.offset, motion.rows[-1, 0] if motion.repeat else 0.0, jumps(motion), far + reach,
            speed_bound(motion, far),
        )  # fmt: skip
        parts[j] = row, row + len(motion.rows), solid, solid + len(mover.solids)
        row, solid = parts[j, [1, 3]]
        rates = np.diff(motion.rows[:, 1:], axis=0) * (1.0 / np.diff(motion.rows[:, :1], axis=0))
        rows.append(np.hstack([motion.rows, np.vstack([rates, np.zeros(3)])]))  # it stays at the last
    return body, parts, np.vstack([np.zeros((0, ROW)), *rows])


def _shapes(
    obstacles: list[Obstacle], height: float, radius: float, margin: float
) -> tuple[tuple[Array | IntArray, ...], float]:
    """Return the last of the arrays, of solids in the frames of their obstacles, and the spacing of lattices [m].

    Boxes, cylinders, spheres and capsules have closed forms; others have FCL's distances on a lattice up to a margin
    [m] around each, less the excess of interpolation, since next to large solids lattices are coarse for a small disc.
    """
    solids = Solids.of(obstacles)
    low = solids.low[:, :2]
    high = solids.high[:, :2]

    K = len(obstacles)
    tables = np.flatnonzero(solids.form < 0)
    fine = TUNING.table_pitch * radius

    area = float(np.prod(high[tables] - low[tables] + 2.0 * (margin + 2.0 * fine), axis=1).sum())
    pitch = max(fine, math.sqrt(area / TUNING.table_points))

    first = np.zeros(K, dtype=np.int64)
    shape = np.zeros((K, 2), dtype=np.int64)
    corner = np.zeros((K, 2))

    parts: list[Array] = [np.zeros(0)]
    plane = np.full(2, 1e3)  # beyond any solid [m]
    for k in tables:
        corner[k] = low[k] - margin - pitch
        shape[k] = np.ceil((high[k] + margin - corner[k]) / pitch).astype(int) + 2
        first[k] = sum(map(len, parts))
        disc = Footprint.disc(radius, height=height)
        distance = Collision(Workspace(-plane, plane, (obstacles[k],)), disc).distance(
            corner[k] + pitch * np.stack(np.meshgrid(*map(np.arange, shape[k]), indexing="ij"), axis=-1).reshape(-1, 2)
        )
        parts.append(distance if pitch == fine else np.maximum(distance - _excess(distance, pitch), 0.0))
    numbers = np.hstack([solids.size, solids.position, solids.rotation.reshape(-1, 9)])
    return (numbers, np.column_stack([solids.form, first, shape]), corner, np.concatenate(parts)), pitch


def _excess(distance: Array, pitch: float) -> Array:
    """Bound how much too high bilinear interpolation next to a point may be, from the distance there [m]."""
    nearest = np.maximum(distance - math.sqrt(2.0) * pitch, 1e-9 * pitch)
    return np.asarray(np.minimum(pitch / math.sqrt(2.0), pitch**2 / (8.0 * nearest)))
