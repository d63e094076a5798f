"""Rooms of boxes, each given by its extent (x, y, x, y) seen from above."""

from functools import cache

import numpy as np
from discs import block, scene_of

from pirrht import FreeSpace

# Half a metre wide, into a room whose walls all join
DOORWAY = (
    (3.1, 2.75, 3.7, 3.9), (3.1, 1.1, 3.7, 2.25), (3.2, 3.8, 5.6, 4.0), (3.2, 1.0, 5.6, 1.2), (5.5, 1.0, 5.7, 4.0),
)  # fmt: skip


def room(*extents: tuple[float, ...], radius: float = 0.1) -> FreeSpace:
    """Boxes in a workspace of 6 m x 5 m with free corners, for a robot of a radius [m]."""
    corners = enumerate(np.reshape(extents, (-1, 2, 2)))
    boxes = [block(f"box{i}", *(0.5 * (low + high)), 0.5 * (high - low)) for i, (low, high) in corners]
    return FreeSpace.of(scene_of(boxes, start=(0.3, 0.3), goal=(5.8, 4.8), side=(6.0, 5.0), radius=radius))


@cache
def walled() -> FreeSpace:
    """A wall at x = 2 that is 2 cm thick and reaches from border to border, and a goal before it."""
    return FreeSpace.of(
        scene_of([block("wall", 2.0, 2.0, (0.01, 2.0))], start=(0.5, 0.5), goal=(0.6, 3.2, 0.2), side=4.0, radius=0.05)
    )
