"""Describe solids: static obstacles, and parts of a moving obstacle in its own frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from pirrht import formatting
from pirrht.arrays import Array


class Kind(Enum):
    """Shapes an obstacle can have; sizes are MuJoCo's (half sizes, radius and half length, half axes)."""

    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    CAPSULE = "capsule"
    ELLIPSOID = "ellipsoid"
    MESH = "mesh"


def about_vertical(yaw: float) -> Array:
    """Return the rotation (3, 3) by a yaw [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
    """One convex solid, fixed in the world.

    Attributes:
        name: what messages call it.
        kind: its shape.
        size: MuJoCo's sizes of the kind, (3,) [m]; unused for a mesh.
        position: its centre, (3,) [m].
        rotation: its axes in world coordinates, as columns, (3, 3).
        vertices: corners of a mesh's convex hull in its own frame, (k, 3) [m].
        faces: triangles of that hull, (l, 3) indices of corners.
    """

    name: str
    kind: Kind
    size: Array
    position: Array
    rotation: Array
    vertices: Array | None = None
    faces: NDArray[np.int64] | None = None

    def __repr__(self) -> str:
        return f"Obstacle({self.name!r}, {self.kind.value} at {formatting.vector(self.position)})"
