"""Note what a robot knew when it decided, as plain values."""

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array, BoolArray
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Believed:
    """Note what the robot knew when a plan was made."""

    scan: Scan | None  # the last one
    occupied: BoolArray  # cells, (rows, columns), the lowest row first
    unknown: BoolArray  # cells that no ray has passed, (rows, columns)
    lower: Array  # corner of the first cell, (2,) [m]
    cell: float  # side of a cell [m]
    error: Array  # of the pose that the robot believes, x, y [m] and yaw [rad], (3,)
    seconds: float = 0.0  # that scans, map and what follows from it took before the plan [s]

    @classmethod
    def of(cls, grid: OccupancyMap, scan: Scan | None, error: Array) -> "Believed":
        """Note a map, the last scan in it, and the error of the pose (3,)."""
        return cls(
            scan=scan, occupied=grid.occupied, unknown=grid.unknown, lower=grid.lower, cell=grid.cell,
            error=error.copy(),
        )  # fmt: skip

    @property
    def upper(self) -> Array:
        """Upper corner of the last cell, (2,) [m]."""
        return np.asarray(self.lower + self.cell * np.array(self.unknown.shape[::-1]))
