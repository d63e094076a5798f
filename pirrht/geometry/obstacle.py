"""Solids: what stands, or in a moving body's own frame what it is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

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
    """The rotation (3, 3) by a yaw [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
    """One convex solid, fixed in the world."""

    name: str
    kind: Kind
    size: Array  # (3,) MuJoCo's sizes of the kind [m]; unused for a mesh
    position: Array  # (3,) centre [m]
    rotation: Array  # (3, 3) body axes in world coordinates, as columns
    vertices: Array | None = None  # (k, 3) corners of a mesh's convex hull in its own frame [m]
    faces: NDArray[np.int64] | None = None  # (l, 3) triangles of that hull, indices of corners
