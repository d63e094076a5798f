"""Occupancy grids of ROS and scenes of each other."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.errors import OptionError
from pirrht.geometry.collision import Collision
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.scene import Scene, Workspace
from sim.importing.ros_map import OCCUPIED
from sim.mjcf.library import MOST_PIXELS
from sim.ros.frames import planar, quaternion_of
from sim.ros.messages import Header, MapMetaData, OccupancyGrid, Point, Pose

TURNED = 1e-3  # of a map, which is no longer along the axes of its frame [rad]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Cells of a map."""

    walls: BoolArray  # occupied or unknown, (rows, columns), the lowest row first
    lower: Array  # corner of the first, (2,) [m]
    cell: float  # side of each [m]

    @property
    def upper(self) -> Array:
        """Upper corner of the last, (2,) [m]."""
        return np.asarray(self.lower + self.cell * np.array(self.walls.shape[::-1]))

    @classmethod
    def of(cls, message: OccupancyGrid) -> "Grid":
        """Read a message, unknown cells as walls; OptionError: it holds no map that can be used."""
        info = message.info
        count = info.width * info.height
        for wrong, why in (
            (count > MOST_PIXELS, f"it has {info.width} x {info.height} cells, and at most {MOST_PIXELS:,} are taken"),
            (count < 1 or count != len(message.data),
             f"it has {len(message.data)} cells, and says {info.width} x {info.height}"),
            (not 0.0 < info.resolution < inf, f"the side of a cell is {info.resolution:g} m"),
        ):  # fmt: skip
            if wrong:
                raise OptionError(f"the map is refused: {why}")
        x, y, yaw = planar(info.origin, "the origin of the map")
        if abs(yaw) > TURNED:
            raise OptionError(f"the map is refused: it is turned by {yaw:.3g} rad, and must lie along its frame")
        chance = np.array(message.data, np.int8).reshape(info.height, info.width)
        return cls(walls=(chance < 0) | (chance >= OCCUPIED), lower=np.array([x, y]), cell=float(info.resolution))

    def same_cells(self, other: "Grid") -> bool:
        """Whether another map has its cells in the same places."""
        same = self.cell == other.cell and self.walls.shape == other.walls.shape
        return same and np.array_equal(self.lower, other.lower)

    def moved(self, pose: Array) -> "Grid":
        """Return it in a frame where its own is at a pose (3,); OptionError: it is turned there."""
        if not pose.any():
            return self
        if abs(pose[2]) > TURNED:
            raise OptionError(f"the map is refused: its frame is turned by {pose[2]:.3g} rad; name it with --map-frame")
        return replace(self, lower=self.lower + pose[:2])


def grid_of(scene: Scene, cell: float, header: Header) -> OccupancyGrid:
    """Return the map of what stands in a scene, of cells of a side [m]: occupied where something is near the middle."""
    columns, rows = np.ceil((scene.upper - scene.lower) / cell - 1e-6).astype(int).tolist()
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    middles = scene.lower + cell * (np.column_stack([x.ravel(), y.ravel()]) + 0.5)
    low = scene.lower - cell  # the border is no wall
    static = Workspace(low, scene.upper + 2.0 * cell, scene.obstacles)
    away = Collision(static, Footprint.disc(0.5 * cell, height=scene.body.height)).clearance(middles)
    origin = Pose(position=Point(*scene.lower.tolist(), 0.0), orientation=quaternion_of(0.0))
    info = MapMetaData(header.stamp, cell, columns, rows, origin)
    return OccupancyGrid(header, info, np.where(away > 0.0, 0, 100).tolist())
