"""Scenes of standing cylinders and boxes, with a task, for tests that know the answer in closed form."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene

Row = Sequence[float]


def disc(name: str, x: float, y: float, radius: float) -> Obstacle:
    """A standing cylinder."""
    return _standing(name, Kind.CYLINDER, (radius, 0.5, 0.0), x, y, 0.0)


def block(name: str, x: float, y: float, half: Row, yaw: float = 0.0) -> Obstacle:
    """A standing box of half sizes (2,) [m]."""
    return _standing(name, Kind.BOX, (*half, 0.5), x, y, yaw)


def scene_of(
    obstacles: Sequence[Obstacle] = (), *, start: Row, goal: Row, side: float | Row = 6.0, lower: Row = (0.0, 0.0),
    radius: float = 0.1, name: str = "test", **more: Any,
) -> Scene:  # fmt: skip
    """A workspace up to `side` [m] in x and y for a robot of some radius [m]; the goal's disc has 0.1 m, or goal[2]."""
    return Scene(
        name=name, lower=np.array(lower, dtype=float), upper=np.broadcast_to(np.asarray(side, dtype=float), 2).copy(),
        obstacles=tuple(obstacles), goal=Goal(center=np.array(goal[:2], dtype=float), radius=(*goal, 0.1)[2]),
        start=np.array([*start, 0.0][:3], dtype=float), robot_radius=radius, **more,
    )  # fmt: skip


def scattered(seed: int, count: int = 6) -> Scene:
    """Discs that neither touch nor come near a start at the left and a goal at the right."""
    rng, placed = np.random.default_rng([seed, 5]), []
    while len(placed) < count:
        x, y, r = *rng.uniform(0.6, 5.4, 2), rng.uniform(0.1, 0.7)
        ends = min(np.hypot(x - 0.4, y - 3.0), np.hypot(x - 5.6, y - 3.0)) - r > 0.3
        if ends and all(np.hypot(x - a, y - b) > r + s + 0.26 for a, b, s in placed):
            placed.append((x, y, r))
    return scene_of([disc(f"disc{i}", *row) for i, row in enumerate(placed)], start=(0.4, 3.0), goal=(5.6, 3.0))


def _standing(name: str, kind: Kind, size: Row, x: float, y: float, yaw: float) -> Obstacle:
    c, s = np.cos(yaw), np.sin(yaw)
    place, turn = np.array([x, y, 0.5]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Obstacle(name=name, kind=kind, size=np.array(size, dtype=float), position=place, rotation=turn)
