"""Warehouses of any size: rows of shelves with aisles between, some of which are gone or pillars."""

from __future__ import annotations

import numpy as np

from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene

SHELF = np.array([0.5, 4.0, 1.0])  # half sizes [m]
RIM = 3.0  # along the walls of the hall, without shelves [m]
ROBOT = 0.2  # radius of the robot [m]


def shelves(size: float, seed: int) -> list[Obstacle]:
    """Those of a square hall of some size [m]."""
    rng = np.random.default_rng(seed)
    columns, rows = [RIM], [RIM]
    while columns[-1] + 4.0 < size - RIM:
        columns.append(columns[-1] + 1.0 + rng.uniform(2.0, 3.0))
    while rows[-1] + 11.0 < size - RIM:
        rows.append(rows[-1] + 8.0 + rng.uniform(2.0, 3.0))
    found = []
    for k, (x, y) in enumerate((x, y) for x in columns for y in rows):
        kind = rng.choice([Kind.BOX, Kind.CYLINDER, None], p=[0.9, 0.06, 0.04])
        if kind is not None:
            half = SHELF if kind is Kind.BOX else np.array([0.3, 1.0, 0.0])
            spot = np.array([x + 0.5, y + 4.0, 1.0])
            found.append(Obstacle(name=f"shelf{k}", kind=kind, size=half, position=spot, rotation=np.eye(3)))
    return found


def warehouse(size: float, seed: int = 0, radius: float = ROBOT) -> Scene:
    """A hall whose start and goal lie in opposite corners."""
    return Scene(
        name="warehouse", lower=np.zeros(2), upper=np.full(2, size), obstacles=tuple(shelves(size, seed)),
        goal=Goal(center=np.full(2, size - 1.5), radius=0.4), start=np.array([1.5, 1.5, 0.0]), robot_radius=radius,
    )  # fmt: skip
