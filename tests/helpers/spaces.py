"""Scenes in space: boxes and other solids, walls with holes, pillars, frames and bodies that float."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pirrht.arrays import Array
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene

Row = Sequence[float]


def box(name: str, lower: Row, upper: Row) -> Obstacle:
    """A box along the axes between two corners."""
    low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
    return solid(name, Kind.BOX, 0.5 * (high - low), 0.5 * (low + high))


def solid(name: str, kind: Kind, size: Row, place: Row, turn: Array | None = None) -> Obstacle:
    """A solid of MuJoCo's sizes at a place; a mesh is an octahedron of half axes `size`."""
    vertices = np.array([sign * np.eye(3)[k] * size[k] for k in range(3) for sign in (1.0, -1.0)])
    faces = np.array([(i, j, k) for i in (0, 1) for j in (2, 3) for k in (4, 5)])
    mesh = {"vertices": vertices, "faces": faces} if kind is Kind.MESH else {}
    turn = np.eye(3) if turn is None else turn
    return Obstacle(name=name, kind=kind, size=np.array(size), position=np.array(place), rotation=turn, **mesh)


def in_space(
    obstacles: Sequence[Obstacle] = (), *, start: Row = (0.8, 2.0, 1.0), goal: Row = (5.2, 2.0, 1.0, 0.3),
    upper: Row = (6.0, 4.0, 3.0), radius: float = 0.2, **more: Any,
) -> Scene:  # fmt: skip
    """A workspace from the origin to a corner for a ball of a radius [m]; the goal is x, y, z and a radius."""
    return Scene(
        name="space", lower=np.zeros(3), upper=np.array(upper, dtype=float), obstacles=tuple(obstacles),
        goal=Goal(center=np.array(goal[:3], dtype=float), radius=goal[3]), start=np.array(start, dtype=float),
        robot_radius=radius, **more,
    )  # fmt: skip


def flying(name: str, rows: Sequence[Row], *solids: Obstacle, repeat: bool = False) -> Mover:
    """A body whose rows are t [s], x, y, z [m] and perhaps a quaternion, w first, of solids in its own frame."""
    whole = np.array([[*row, 1.0, 0.0, 0.0, 0.0][:8] for row in rows], dtype=float)
    return Mover(name=name, solids=solids, motion=Motion(rows=whole, repeat=repeat))


def framed(name: str, x: float, width: Row, outer: Row, hole: Row) -> list[Obstacle]:
    """Four boxes around a hole; outer and hole are y0, z0, y1, z1, width the least and greatest x around x."""
    low, high = x + width[0], x + width[1]
    return [
        box(f"{name} left", (low, outer[0], outer[1]), (high, hole[0], outer[3])),
        box(f"{name} right", (low, hole[2], outer[1]), (high, outer[2], outer[3])),
        box(f"{name} sill", (low, hole[0], outer[1]), (high, hole[2], hole[1])),
        box(f"{name} lintel", (low, hole[0], hole[3]), (high, hole[2], outer[3])),
    ]


def window(closed: bool = False) -> Scene:
    """A wall over all y that leaves room above it, with a hole unless it is closed."""
    wall = [box("wall", (2.9, 0.0, 0.0), (3.1, 4.0, 2.2))]
    return in_space(
        wall if closed else framed("wall", 3.0, (-0.1, 0.1), (0.0, 0.0, 4.0, 2.2), (1.65, 0.65, 2.35, 1.35))
    )


def pillars() -> Scene:
    """Four pillars from floor to ceiling, and a box that floats."""
    places = [(2.0, 1.0), (2.0, 3.0), (4.0, 1.0), (4.0, 3.0)]
    rows = [box(f"pillar {i}", (x - 0.1, y - 0.1, 0.0), (x + 0.1, y + 0.1, 3.0)) for i, (x, y) in enumerate(places)]
    return in_space([*rows, box("body", (2.8, 1.8, 1.3), (3.2, 2.2, 1.7))])


def bar() -> Scene:
    """A bar from wall to wall."""
    return in_space([box("bar", (2.9, 0.0, 1.4), (3.1, 4.0, 1.6))])


def any_solid(name: str, rng: np.random.Generator, lower: Row, upper: Row) -> Obstacle:
    """A solid of any kind, size and orientation at a place in a box."""
    kind = list(Kind)[rng.integers(len(Kind))]
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return solid(name, kind, rng.uniform(0.15, 0.5, 3), rng.uniform(lower, upper), turn)


def mixed(seed: int) -> Scene:
    """Bodies that float or touch, pillars, bars and frames at random; start and goal are not looked at."""
    rng, upper = np.random.default_rng([seed, 63]), np.array([4.0, 3.0, 2.5])
    found = [any_solid(f"body {i}", rng, np.zeros(3), upper) for i in range(rng.integers(1, 5))]
    for i in range(rng.integers(0, 3)):
        x, y, half = rng.uniform(0.6, 3.4), rng.uniform(0.6, 2.4), rng.uniform(0.1, 0.3)
        found.append(box(f"pillar {i}", (x - half, y - half, 0.0), (x + half, y + half, 2.5)))
    for i in range(rng.integers(0, 2)):
        x, z = rng.uniform(0.6, 3.4), rng.uniform(0.5, 2.0)
        found.append(box(f"bar {i}", (x - 0.1, 0.0, z - 0.1), (x + 0.1, 3.0, z + 0.1)))
    if rng.random() < 0.5:
        x, y, z = rng.uniform(0.6, 3.4), rng.uniform(0.6, 1.1), rng.uniform(0.4, 0.8)
        hole = (y + 0.2, z + 0.2, y + 1.0, z + 1.0)
        found += framed("frame", x, (-0.1, 0.1), (y, z, y + 1.2, z + 1.2), hole)
    return in_space(found, upper=upper, start=(0.1, 0.1, 0.1), goal=(3.9, 2.9, 2.4, 0.1), radius=0.15)


def guarded() -> Scene:
    """The window with a ball that crosses before it, and a bar that tumbles down there a little later."""
    ball = solid("ball", Kind.SPHERE, (0.3, 0.0, 0.0), (0, 0, 0))
    bar = solid("bar", Kind.BOX, (0.1, 0.5, 0.1), (0, 0, 0))
    movers = (
        flying("ball", [(0.0, 2.4, 0.8, 1.0), (3.6, 2.4, 3.2, 1.0), (7.2, 2.4, 0.8, 1.0)], ball, repeat=True),
        flying("bar", [(0.0, 2.0, 2.0, 2.6), (4.0, 2.0, 2.0, 0.4, 0.6, 0.8, 0.0, 0.0)], bar),
    )
    return replace(window(), movers=movers)
