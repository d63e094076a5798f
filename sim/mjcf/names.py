"""Names of static obstacles, by which sentences, tables, JSON and pictures call them."""

from collections.abc import Mapping, Sequence

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.topology.nerve import WORKSPACE, Loop
from sim.mjcf.load import Loaded
from sim.text import shared

SPARE = "a wall"  # name of a solid of the border that has none of its own


def names_of(loaded: Loaded, space: FreeSpace) -> tuple[str, ...]:
    """Name each topological obstacle that paths can turn about: by words that its solids share, or by one of them.

    One that is gone from a map has its number left.
    """
    solids = names_of_solids(loaded, space)
    places = np.array([obstacle.position[: space.scene.dimension] for obstacle in space.scene.obstacles])
    found = []
    for k, (part, at) in enumerate(zip(space.obstacles, space.homology.markers, strict=True), 1):
        near = min(part.members, key=lambda i: float(np.hypot.reduce(places[i] - at)), default=None)
        found.append(f"obstacle {k}" if near is None else solids[near])
    loops = [[n for n in part.names if n != WORKSPACE] if isinstance(part, Loop) else [] for part in space.obstacles]
    return tuple((len(loop) > 1 and shared(loop)) or name for loop, name in zip(loops, found, strict=True))


def names_of_solids(loaded: Loaded, space: FreeSpace) -> tuple[str, ...]:
    """Name each static solid, in the order of the scene: as its geom, or else as its body; cells of a map have none."""
    model = loaded.model
    given = [""] * len(space.scene.obstacles)
    if space.grain is None:
        bodies = model.geom_bodyid
        chosen = np.flatnonzero(loaded.obstacle_geoms & ~loaded.moving_geoms)
        given = [model.geom(g).name or (model.body(bodies[g]).name if bodies[g] else "") for g in chosen]
    return tuple(called(given, {i: k for k, part in enumerate(space.obstacles, 1) for i in part.members}))


def called(given: Sequence[str], number: Mapping[int, int]) -> list[str]:
    """Names for solids: those given, unless empty or of several obstacles; else by the obstacle's number.

    Numbers are by place in `given`; solids of the border have none.
    """
    spare = [f"obstacle {number[i]}" if i in number else SPARE for i in range(len(given))]
    users: dict[str, set[int | None]] = {}
    for i, name in enumerate(given):
        users.setdefault(name, set()).add(number.get(i))
    unique = {name for name, obstacles in users.items() if name and len(obstacles) == 1}
    return [name if name in unique else other for name, other in zip(given, spare, strict=True)]
