"""On which side of bodies that move a path in space and time passes: before them, or behind."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.topology.in_time import TimedHomology
from pirrht.topology.moving import MovingHomology, places_at
from pirrht.tree.reference import Reference

MOMENTS = 60  # of a path that are looked at
BACK = 0.1  # over which a body's direction is taken [s]
STILL = 0.05  # m/s; what is slower is passed, not gone before or behind
FEW = 4  # bodies of which every one is told


def sides(reference: Reference, moving: MovingHomology) -> tuple[str, ...]:
    """ "before", "behind" or "past", one for each of J markers, by where the path is when it is nearest to it.

    "" for a path that has no times.
    """
    path = reference.trajectory.path
    knots = getattr(path, "knots", None)
    if knots is None or knots.shape[1] != 3:
        return ("",) * moving.J
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way = np.column_stack([np.interp(times, knots[:, 2], knots[:, k]) for k in (0, 1)])
    places, late, early = (_places(moving, times + shift) for shift in (0.0, BACK, -BACK))
    nearest = np.argmin(np.linalg.norm(places - way, axis=2), axis=1)
    found = []
    for j, k in enumerate(nearest.tolist()):
        ahead = (late[j, k] - early[j, k]) / (2.0 * BACK)
        slow = float(np.hypot(*ahead)) < STILL
        found.append("past" if slow else "before" if float((way[k] - places[j, k]) @ ahead) > 0.0 else "behind")
    return tuple(found)


def passing(reference: Reference, homology: TimedHomology) -> list[str]:
    """Each body with its side, as "walker: behind"; of many bodies those alone that the path turns about."""
    passed = list(zip(homology.moving.names, sides(reference, homology.moving), strict=True))
    if len(passed) > FEW:
        turns = reference.winding[homology.standing.M :]
        passed = [row for row, turn in zip(passed, turns, strict=True) if turn]
    return [f"{name}: {side}" for name, side in passed if side]


def _places(moving: MovingHomology, times: Array) -> Array:
    places = np.empty((moving.J, len(times), 2))
    places_at(moving.tracks, times, places)
    return places
