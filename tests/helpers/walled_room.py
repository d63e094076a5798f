"""A room with a thin wall across it, and a goal before the wall."""

from __future__ import annotations

from functools import cache

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene


@cache
def room() -> FreeSpace:
    """A wall at x = 2 that is 2 cm thick and reaches from border to border, and a goal before it."""
    wall = Obstacle(
        name="wall", kind=Kind.BOX, size=np.array([0.01, 2.0, 0.5]), position=np.array([2.0, 2.0, 0.5]),
        rotation=np.eye(3),
    )  # fmt: skip
    return FreeSpace.of(
        Scene(
            name="room", lower=np.zeros(2), upper=np.array([4.0, 4.0]), obstacles=(wall,), robot_radius=0.05,
            goal=Goal(center=np.array([0.6, 3.2]), radius=0.2), start=np.array([0.5, 0.5, 0.0]),
        )
    )  # fmt: skip
