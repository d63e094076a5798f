"""Scenes with bodies that move, written as numbers: the three of the package, and what small tests need."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from discs import Row, block, disc, scene_of
from scipy.spatial import ConvexHull

from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Footprint, Kind, Obstacle, Scene, Workspace

START = np.array([1.0, 2.5])


def moved(name: str, rows: Sequence[Row], *solids: Obstacle, repeat: bool = False) -> Mover:
    """A body whose rows are t [s], x, y [m] and a yaw [rad], of solids in its own frame."""
    return Mover(name=name, solids=solids, motion=Motion(rows=np.array(rows, dtype=float), repeat=repeat))


def as_mesh(box: Obstacle) -> Obstacle:
    """The hull of a box's corners."""
    corners = box.size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return replace(box, kind=Kind.MESH, vertices=corners, faces=ConvexHull(corners).simplices.astype(np.int64))


def clearance_among(movers: Iterable[Mover], footprint: Footprint, place: np.ndarray, time: float) -> float:
    """FCL's clearance [m] at a place (2,) from bodies as they stand at a time [s], without any border."""
    solids = tuple(one for mover in movers for one in mover.at(time))
    everywhere = Workspace(np.full(2, -np.inf), np.full(2, np.inf), solids)
    return float(Collision(everywhere, footprint).clearance(place[None])[0])


def hall(name: str, movers: Sequence[Mover], standing: Sequence[Obstacle] = (), goal: Row = (5.5, 2.5)) -> Scene:
    """A workspace of 6 x 5 m with a start at (1, 2.5) and a goal's disc of 0.3 m."""
    return scene_of(standing, start=START, goal=(*goal, 0.3), side=(6.0, 5.0), name=name, movers=tuple(movers))


def walled(speed: float) -> tuple[Scene, Callable[[float, float], float]]:
    """A wall of constant speed that a robot touches at x = 2.8 at 0.4 s; rate k of psi before it by b and lambda.

    With psi = 1 on it, psi = exp(-k z) at z before it, k = sqrt(c^2/b^4 + 2 q/(lambda b^2)) - c/b^2 for its speed c.
    """
    rows = [(0.0, 2.5 - 0.4 * speed, 1.5, 0.0), (2.0, 2.5 + 1.6 * speed, 1.5, 0.0)]
    wall = moved("wall", rows, block("wall", 0.0, 0.0, (0.1, 1.5)))
    scene = scene_of(start=(0.6, 1.5), goal=(4.3, 0.6, 0.3), side=(5.0, 3.0), radius=0.2, movers=(wall,))
    return scene, lambda b, temperature: np.hypot(speed / b**2, np.sqrt(2.0 / temperature) / b) - speed / b**2


def busy() -> Scene:
    """Bodies of one and two solids that turn, one of which starts over elsewhere and one where it ends."""
    way = [(0.0, 1.5, 1.5, 0.3), (0.4, 2.0, 1.2, 1.0), (1.1, 2.5, 2.4, -1.0)]
    lap = [(0.0, 4.0, 1.0, 0.0), (0.5, 4.6, 1.6, 2.0), (0.9, 4.0, 1.0, 6.283185307179586)]
    ell = block("ell", 0.2, 0.0, (0.1, 0.4), yaw=0.3), disc("end", -0.3, 0.1, 0.2)
    bodies = [
        moved("once", way, *ell),
        moved("again", way, as_mesh(block("box", 0.1, 0.2, (0.15, 0.3))), repeat=True),
        moved("around", lap, block("bar", 0.0, 0.0, (0.5, 0.05)), repeat=True),
    ]
    return hall("busy", bodies)


def crossing() -> Scene:
    """One disc crosses the straight way."""
    rows = [(0.0, 3.25, 1.09, 0.0), (4.5, 3.25, 3.79, 0.0)]
    return hall("crossing", [moved("crosser", rows, disc("crosser", 0.0, 0.0, 0.3))])


def closing_door() -> Scene:
    """A gap that closes when the robot would arrive, and a way around."""
    rows = [(0.0, 3.1, 1.7, 0.0), (0.3, 3.1, 1.7, 0.0), (1.7, 3.1, 2.5, 0.0)]
    walls = [block("wall_low", 3.1, 1.075, (0.1, 1.075)), block("wall_high", 3.1, 3.175, (0.1, 0.325))]
    door = moved("door", rows, block("door", 0.0, 0.0, (0.08, 0.4)))
    return hall("closing_door", [door], walls, goal=(5.2, 2.5))


def pincer() -> Scene:
    """Two discs that meet on the straight way."""
    low = moved("low", [(0.0, 3.25, 1.35, 0.0), (1.9, 3.25, 2.25, 0.0)], disc("low", 0.0, 0.0, 0.3))
    high = moved("high", [(0.0, 3.25, 3.75, 0.0), (1.9, 3.25, 2.85, 0.0)], disc("high", 0.0, 0.0, 0.3))
    return hall("pincer", [low, high])


def oblique() -> Scene:
    """Two discs on oblique ways with corners, a bar that turns while it drifts, and a standing block."""
    one = [(0.0, 2.2, 3.6, 0.0), (1.1, 2.9, 2.7, 0.0), (2.7, 2.3, 1.6, 0.0), (4.1, 3.4, 1.2, 0.0)]
    two = [(0.0, 4.9, 1.5, 0.0), (1.6, 4.3, 2.6, 0.0), (3.3, 4.7, 3.4, 0.0)]
    bar = [(0.0, 3.3, 3.0, 0.4), (2.0, 3.5, 2.6, 3.1), (4.4, 3.2, 3.3, 6.5)]
    movers = [
        moved("one", one, disc("one", 0.0, 0.0, 0.25)),
        moved("two", two, disc("two", 0.0, 0.0, 0.3)),
        moved("bar", bar, block("bar", 0.0, 0.0, (0.55, 0.06))),
    ]
    return hall("oblique", movers, [block("block", 2.0, 2.2, (0.2, 0.3))])


SCENES = {"crossing": crossing, "closing_door": closing_door, "pincer": pincer, "oblique": oblique}
