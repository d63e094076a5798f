"""Rooms of boxes, each given by its extent (x, y, x, y) seen from above."""

from functools import cache

import numpy as np
from discs import block, scene_of

from pirrht import FreeSpace, Obstacle

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
    return block(name, *(0.5 * (low + high)), 0.5 * (high - low))


def room(*extents: Extent, radius: float = 0.1) -> FreeSpace:
    """Boxes in a workspace of 6 m x 5 m with free corners, for a robot of a radius [m]."""
    boxes = [box(f"box{i}", extent) for i, extent in enumerate(extents)]
    return FreeSpace.of(scene_of(boxes, start=(0.3, 0.3), goal=(5.8, 4.8), side=(6.0, 5.0), radius=radius))


@cache
def walled() -> FreeSpace:
    """A wall at x = 2 that is 2 cm thick and reaches from border to border, and a goal before it."""
    wall = block("wall", 2.0, 2.0, (0.01, 2.0))
    return FreeSpace.of(scene_of([wall], start=(0.5, 0.5), goal=(0.6, 3.2, 0.2), side=4.0, radius=0.05))
