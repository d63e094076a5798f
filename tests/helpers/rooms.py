"""Rooms of boxes, each given by its extent (x, y, x, y) seen from above."""

from __future__ import annotations

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene

Extent = tuple[float, float, float, float]  # least x and y, greatest x and y [m]

DOORWAY: tuple[Extent, ...] = (  # half a metre wide, into a room whose walls all join
    (3.1, 2.75, 3.7, 3.9),
    (3.1, 1.1, 3.7, 2.25),
    (3.2, 3.8, 5.6, 4.0),
    (3.2, 1.0, 5.6, 1.2),
    (5.5, 1.0, 5.7, 4.0),
)


def box(name: str, extent: Extent) -> Obstacle:
    """A box of a metre's height on the ground."""
    low, high = np.array(extent[:2]), np.array(extent[2:])
    return Obstacle(
        name=name, kind=Kind.BOX, size=np.array([*(0.5 * (high - low)), 0.5]),
        position=np.array([*(0.5 * (low + high)), 0.5]), rotation=np.eye(3),
    )  # fmt: skip


def room(*extents: Extent, radius: float = 0.1) -> FreeSpace:
    """Boxes in a workspace of 6 m x 5 m with free corners, for a robot of a radius [m]."""
    return FreeSpace.of(
        Scene(
            name="room", lower=np.zeros(2), upper=np.array([6.0, 5.0]), robot_radius=radius,
            obstacles=tuple(box(f"box{i}", extent) for i, extent in enumerate(extents)),
            start=np.array([0.3, 0.3, 0.0]), goal=Goal(center=np.array([5.8, 4.8]), radius=0.1),
        )
    )  # fmt: skip
