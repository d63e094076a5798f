"""Poses of frames in each other, as /tf tells them, in the plane."""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.ros.messages import Pose, Quaternion, TFMessage, Transform
from sim.states.planar_joints import heading_of

UNIT = 0.1  # by which the norm of a rotation may be off


class Unconnected(OptionError):
    """No chain of transforms leads from one frame to another."""


def yaw_of(rotation: Quaternion) -> float:
    """Return the turn about the vertical [rad]; OptionError: it is no rotation."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    if not abs(np.sqrt(x * x + y * y + z * z + w * w) - 1.0) < UNIT:
        raise OptionError(f"the quaternion {x:g}, {y:g}, {z:g}, {w:g} is no rotation; its norm must be 1")
    return heading_of([w, x, y, z])


def quaternion_of(yaw: float) -> Quaternion:
    """Return the rotation by an angle about the vertical [rad]."""
    return Quaternion(z=sin(0.5 * yaw), w=cos(0.5 * yaw))


def planar(pose: Pose | Transform, what: str) -> Array:
    """Return x, y [m] and yaw [rad] of a pose, (3,); OptionError, with `what` it is of: it is none."""
    place, rotation = (pose.position, pose.orientation) if isinstance(pose, Pose) else (pose.translation, pose.rotation)
    if not np.isfinite([place.x, place.y]).all():
        raise OptionError(f"{what} is at {place.x:g}, {place.y:g}; a pose must be finite numbers")
    try:
        return np.array([place.x, place.y, yaw_of(rotation)])
    except OptionError as error:
        raise OptionError(f"{what}: {error}") from None


def composed(first: Array, second: Array) -> Array:
    """Return the pose (3,) in the outer frame of one that is `second` in the frame at `first`."""
    c = cos(first[2])
    s = sin(first[2])
    x, y, yaw = second
    return np.array([first[0] + c * x - s * y, first[1] + s * x + c * y, first[2] + yaw])


def inverse(pose: Array) -> Array:
    """Return the pose (3,) of the outer frame in the frame at a pose (3,)."""
    c = cos(pose[2])
    s = sin(pose[2])
    return np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]])


@dataclass(frozen=True, slots=True)
class Edge:
    """A frame in its parent."""

    parent: str
    pose: Array  # (3,)
    time: float  # when it came [s]; inf if it is static


class Frames:
    """A tree of frames, each with its last pose."""

    def __init__(self) -> None:
        self._edges = dict[str, Edge]()

    def hear(self, message: TFMessage, time: float) -> None:
        """Take over transforms that came at a time [s]; OptionError: one is no pose, and none is taken over."""
        found = {}
        for one in message.transforms:
            child = one.child_frame_id.lstrip("/")
            pose = planar(one.transform, f"the transform of {child}")
            found[child] = Edge(one.header.frame_id.lstrip("/"), pose, time)
        self._edges |= found

    def forget(self) -> None:
        """Forget all frames that are not static."""
        self._edges = {child: edge for child, edge in self._edges.items() if edge.time == np.inf}

    def pose(self, target: str, source: str) -> tuple[Array, float]:
        """Return the pose (3,) of a frame in another, and when the oldest part of it came [s].

        Unconnected: no transforms join them.
        """
        up = self._chain(source.lstrip("/"))
        down = self._chain(target.lstrip("/"))
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            known = ", ".join(sorted(self._edges)) or "none"
            raise Unconnected(f"no transforms join {source} to {target}; frames known: {known}")
        (at, one), (seen, other) = up[common], down[common]
        return composed(inverse(seen), at), min(one, other)

    def _chain(self, frame: str) -> dict[str, tuple[Array, float]]:
        """Return the pose of a frame in each frame above it, and the age of that."""
        pose = np.zeros(3)
        time = np.inf
        found = {frame: (pose, time)}
        while (edge := self._edges.get(frame)) is not None and edge.parent not in found:
            pose = composed(edge.pose, pose)
            time = min(time, edge.time)
            frame = edge.parent
            found[frame] = pose, time
        return found
