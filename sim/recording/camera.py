"""Eyes of the views: one follows the robot, one is far above the map."""

from __future__ import annotations

from math import atan2, cos, exp, hypot, sin

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.scene import Scene

FOLLOWING, ABOVE = "/world/eyes/following", "/world/eyes/above"
HEIGHT, MARGIN = 300.0, 1.06  # of the eye above, in sizes of the workspace; what it sees, over the workspace
SETTLE = 1.2  # after which it has turned by most of a bend [s]
DELAY = 0.35  # with which it follows the robot [s]
DEPTH = 1e-4  # of the frames that the viewer draws for cameras [m]
COLUMNS = (4.0, 6.0, 2.0)  # shares of the robot, the map and the key in the tab Drive
MAP = np.array([1280.0 * COLUMNS[1] / sum(COLUMNS), 362.0])  # size of the map in a window of 1280 x 720 [px]
NARROW = 1.4  # width over height of the narrowest map that is not cut
WIDE = 0.9  # opening of the eye that follows, upwards [rad]


def above(scene: Scene) -> list[rr.AsComponents]:
    """An eye over the middle of the workspace, north being up."""
    center, extent = 0.5 * (scene.lower + scene.upper), seen(scene)
    height = HEIGHT * float(extent.max())
    down = np.diag([1.0, -1.0, -1.0])
    size = extent * 100.0
    return [
        rr.Transform3D(translation=(*center, height), mat3x3=down),
        rr.Pinhole(focal_length=100.0 * height, width=size[0], height=size[1], image_plane_distance=DEPTH),
    ]


def pixels_per_metre(scene: Scene) -> float:
    """Return the scale of the map in a window of 1280 x 720 pixels."""
    return float(np.min(MAP / seen(scene)))


def seen(scene: Scene) -> Array:
    """Return width and height of the ground that the eye above sees [m]: Rerun fits the height, whatever the width."""
    wide, high = MARGIN * (scene.upper - scene.lower)
    return np.array([wide, max(high, wide / NARROW)])


def opening() -> rr.AsComponents:
    """The lens of the eye that follows."""
    return rr.Pinhole(fov_y=WIDE, aspect_ratio=1.5, image_plane_distance=DEPTH)


class Following:
    """An eye behind the robot that turns after it slowly, whatever the noise does."""

    def __init__(self, scene: Scene) -> None:
        extent = float((scene.upper - scene.lower).max())
        self.back = min(max(0.3 * extent, 6.0 * scene.robot_radius), 12.0 * scene.robot_radius)
        self.up = 0.9 * self.back
        towards = scene.goal.center - scene.start[:2]
        self._course = atan2(towards[1], towards[0])
        self._place = np.array(scene.start[:2], dtype=float)

    def poses(self, points: Array, durations: Array) -> tuple[Array, Array]:
        """Places (k, 3) [m] and quaternions (k, 4), w last, as the robot is at points (k, 2) [m] for durations [s]."""
        places, turns = np.empty((len(points), 3)), np.empty((len(points), 4))
        for k, (point, dt) in enumerate(zip(points, durations, strict=True)):
            off, seconds = point - self._place, float(dt)
            distance = hypot(*off)
            if distance > 0.02 * self.back:
                turn = (atan2(off[1], off[0]) - self._course + np.pi) % (2.0 * np.pi) - np.pi
                eager = min(1.0, distance / (0.25 * self.back))
                self._course += eager * (1.0 - exp(-seconds / SETTLE)) * float(turn)
            self._place = self._place + (1.0 - exp(-seconds / DELAY)) * off
            behind = self.back * np.array([cos(self._course), sin(self._course)])
            places[k] = *(self._place - behind), self.up
            turns[k] = _looking(self._course, atan2(self.up, self.back) - 0.1)
        return places, turns


def _looking(course: float, down: float) -> Array:
    """Quaternion, w last, of a camera (x right, y down, z ahead) that looks along a course, downwards by an angle."""
    ahead = np.array([cos(course) * cos(down), sin(course) * cos(down), -sin(down)])
    right = np.array([sin(course), -cos(course), 0.0])
    matrix = np.column_stack([right, np.cross(ahead, right), ahead])
    quaternion: Array = Rotation.from_matrix(matrix).as_quat()
    return quaternion
