"""Tell what of a robot's way its lidar has never shown, since it looks elsewhere, and note where the robot looked."""

from dataclasses import dataclass, field

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.footprint import Footprint, placed
from pirrht.geometry.polyline import even, lengths
from pirrht.mapping.occupancy import OccupancyMap
from pirrht.mapping.scan import Scan


@dataclass(slots=True, kw_only=True, eq=False)
class BlindSide:
    """The directions in which a lidar has no rays, and which of the cells there none has reached before.

    Attributes:
        grid: what scans have shown.
        footprint: of the robot.
        scan: the last one; None: nothing is hidden.
        heading: until which the robot turns to look [rad]; None: it does not.
        side: to which it does, 1 to the left and -1 to the right.
        looked: where it did last, (2,) [m].
        time: of the last decision about it, on the run's clock [s]; decisions on what was earlier change nothing.
    """

    grid: OccupancyMap
    footprint: Footprint
    scan: Scan | None = None
    heading: float | None = None
    side: float = 1.0
    looked: Array | None = None
    time: float = -np.inf
    _edge: Array = field(init=False, repr=False)  # points of the outline, a cell apart, (n, 2) [m]

    def __post_init__(self) -> None:
        corners = self.footprint.outline
        corners = np.vstack([corners, corners[:1]])
        self._edge = even(corners, 1 + int(np.ceil(lengths(corners)[-1] / self.grid.cell)))

    def hides(self, poses: Array) -> bool:
        """Return whether a robot that moves along poses x, y, yaw (k, 3) [m, m, rad] enters cells that none has seen.

        Those of its leading edge count that lie on the blind side, seen from where the last scan was taken.
        """
        if self.scan is None:
            return False
        points = placed(self._edge, poses[1:])
        moves = np.diff(poses[:, :2], axis=0)[:, None]
        leading = np.sum((points - poses[1:, None, :2]) * moves, axis=-1) > 0.0
        points = points[leading]
        _, angles = self.scan.polar(points)
        return bool(np.any((angles > self.scan.angles[-1]) & self.grid.unseen(points)))
