"""Eyes of the views: one follows the robot, one is far above the map."""

from __future__ import annotations

from math import exp

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene

FOLLOWING, ABOVE = "/world/eyes/following", "/world/eyes/above"
HEIGHT, MARGIN = 300.0, 1.06  # of the eye above, in sizes of the workspace; what it sees, over the workspace
DELAY = 0.35  # with which the other one follows the robot, whatever the noise does [s]
DEPTH = 1e-4  # of the frames that the viewer draws for cameras [m]
COLUMNS = (4.0, 6.0, 2.0)  # shares of the robot, the map and the key in the tab Drive
MAP = np.array([1280.0 * COLUMNS[1] / sum(COLUMNS), 362.0])  # size of the map in a window of 1280 x 720 [px]
NARROW = 1.4  # width over height of the narrowest map that is not cut
WIDE = rr.Pinhole(fov_y=0.9, aspect_ratio=1.5, image_plane_distance=DEPTH)  # lens of the eye that follows


def above(scene: Scene) -> list[rr.AsComponents]:
    """An eye over the middle of the workspace, north being up."""
    center, extent = 0.5 * (scene.lower + scene.upper), seen(scene)
    height, size = HEIGHT * float(extent.max()), 100.0 * extent
    return [
        rr.Transform3D(translation=(*center, height), mat3x3=np.diag([1.0, -1.0, -1.0])),
        rr.Pinhole(focal_length=100.0 * height, width=size[0], height=size[1], image_plane_distance=DEPTH),
    ]


def pixels_per_metre(scene: Scene) -> float:
    """Return the scale of the map in a window of 1280 x 720 pixels."""
    return float(np.min(MAP / seen(scene)))


def seen(scene: Scene) -> Array:
    """Return width and height of the ground that the eye above sees [m]: Rerun fits the height, whatever the width."""
    wide, high = MARGIN * (scene.upper - scene.lower)
    return np.array([wide, max(high, wide / NARROW)])


class Following:
    """An eye that the robot pulls behind itself on a rope, so that it turns slowly."""

    def __init__(self, scene: Scene) -> None:
        extent = float((scene.upper - scene.lower).max())
        self._back = min(max(0.3 * extent, 6.0 * scene.robot_radius), 12.0 * scene.robot_radius)
        self._place = np.array(scene.start[:2], dtype=float)
        towards = scene.goal.center - self._place
        self._eye = self._place - self._back * towards / max(float(np.hypot(*towards)), 1e-9)

    def poses(self, points: Array, durations: Array) -> Array:
        """Places [m] and quaternions, w last, (k, 7), as the robot is at points (k, 2) [m] for durations [s]."""
        eyes, ahead = np.empty((len(points), 2)), np.empty((len(points), 2))
        for k, (point, dt) in enumerate(zip(points, durations, strict=True)):
            self._place = self._place + (1.0 - exp(-float(dt) / DELAY)) * (point - self._place)
            rope = self._place - self._eye
            self._eye = self._eye + max(0.0, 1.0 - self._back / max(float(np.hypot(*rope)), 1e-9)) * rope
            eyes[k], ahead[k] = self._eye, self._place - self._eye
        # A camera's axes are x right, y down, z ahead: turned to its course, then down to the robot.
        course, down = np.arctan2(ahead[:, 1], ahead[:, 0]), np.arctan(0.9) - 0.1
        turns = Rotation.from_euler(
            "ZX", np.column_stack([course - np.pi / 2, np.full(len(points), -np.pi / 2 - down)])
        )
        return np.column_stack([eyes, np.full(len(points), 0.9 * self._back), turns.as_quat()])
