"""Describe one scan of a lidar as plain values."""

from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scan:
    """Ranges along rays from one pose, which are kept in the order of their angles.

    Attributes:
        pose: x, y [m] and yaw [rad] of the sensor, (3,), as it is believed to be.
        angles: of the rays from its x-axis, (k,) [rad].
        ranges: to what they hit, (k,) [m]; inf where that is nothing, -inf where it is too near to be measured.
        most: greatest range [m].
        time: of the scan [s].

    Examples:
        >>> import numpy as np
        >>> from pirrht.mapping.scan import Scan
        >>> pose = np.array([1.0, 2.0, np.pi / 2])
        >>> scan = Scan(pose=pose, angles=np.array([0.0, 1.0]), ranges=np.array([3.0, np.inf]), most=30.0)
        >>> scan, scan.points.round(6).tolist()
        (Scan(1 of 2 rays hit, from (1, 2, 1.571) at 0 s), [[1.0, 5.0]])
    """

    pose: Array
    angles: Array
    ranges: Array
    most: float
    time: float = 0.0

    def __post_init__(self) -> None:
        if np.any(np.diff(self.angles) < 0.0):
            order = np.argsort(self.angles, kind="stable")
            object.__setattr__(self, "angles", self.angles[order])
            object.__setattr__(self, "ranges", self.ranges[order])

    def __repr__(self) -> str:
        place = ", ".join(f"{v:.4g}" for v in self.pose)
        hits = np.count_nonzero(np.isfinite(self.ranges))
        return f"Scan({hits} of {len(self.ranges)} rays hit, from ({place}) at {self.time:.4g} s)"

    def polar(self, points: Array) -> tuple[Array, Array]:
        """Return distances (k,) [m] of places (k, 2) [m] and their angles (k,) [rad], from the least of a ray on."""
        x, y = (points - self.pose[:2]).T
        least = self.angles[0]
        return np.hypot(x, y), np.mod(np.arctan2(y, x) - self.pose[2] - least, 2.0 * np.pi) + least

    @property
    def points(self) -> Array:
        """Return the places that were hit, (h, 2) [m]."""
        hit = np.isfinite(self.ranges)
        along = self.angles[hit] + self.pose[2]
        return np.asarray(self.pose[:2] + self.ranges[hit, None] * np.column_stack([np.cos(along), np.sin(along)]))
