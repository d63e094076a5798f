"""On which side of bodies that move a path in space and time passes: before or behind, left or right if they rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.topology.in_time import TimedHomology
from pirrht.topology.moving import MovingHomology
from pirrht.topology.tracks import places_at
from pirrht.tree.reference import Reference

MOMENTS = 60  # of a path that are looked at
BACK = 0.1  # over which a body's direction is taken [s]
STILL = 0.05  # m/s; of what is slower there is no before and behind
SIDES = "before", "behind", "left of", "right of"  # the last two seen along the path, of a body that hardly moves then
FEW = 4  # bodies of which every one is told
NAMED = 8  # bodies that all bear their names in a picture; those of more would hide it


def sides(reference: Reference, moving: MovingHomology) -> tuple[str, ...]:
    """One of SIDES for each of J markers, by where the path is when nearest to it; "" for a path without times."""
    path = reference.trajectory.path
    knots = getattr(path, "knots", None)
    if knots is None or knots.shape[1] != 3:
        return ("",) * moving.J
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way = path.places(times)
    places, late, early = (places_of(moving, times + shift) for shift in (0.0, BACK, -BACK))
    nearest = np.argmin(np.linalg.norm(places - way, axis=2), axis=1)
    found = []
    for j, k in enumerate(nearest.tolist()):
        ahead, aside = (late[j, k] - early[j, k]) / (2.0 * BACK), way[k] - places[j, k]
        if float(np.hypot(*ahead)) >= STILL:
            found.append("before" if float(aside @ ahead) > 0.0 else "behind")
        else:
            along = way[min(k + 1, MOMENTS - 1)] - way[max(k - 1, 0)]
            found.append("left of" if float(along[0] * aside[1] - along[1] * aside[0]) > 0.0 else "right of")
    return tuple(found)


def called(homology: TimedHomology) -> list[str]:
    """Bodies by name, (J,); each part of one that paths may lead through with its number in names of classes."""
    names, standing = homology.moving.names, homology.standing.M
    return [f"{name} ({standing + j})" if names.count(name) > 1 else name for j, name in enumerate(names, 1)]


def passed(reference: Reference, homology: TimedHomology) -> list[tuple[str, str]]:
    """Each body with its one of SIDES; of many those that the path turns about."""
    rows = list(zip(called(homology), sides(reference, homology.moving), strict=True))
    if len(rows) > FEW:
        turns = reference.winding[homology.standing.M :]
        rows = [row for row, turn in zip(rows, turns, strict=True) if turn]
    return [row for row in rows if row[1]]


def passing(reference: Reference, homology: TimedHomology) -> list[str]:
    """The same in words, as "walker: behind" or "door: left of it"."""
    return [f"{name}: {side}{' it' if side.endswith('of') else ''}" for name, side in passed(reference, homology)]


def by_side(rows: Sequence[tuple[str, str]]) -> list[str]:
    """What `passed` tells side by side, as "behind walker, cart", for where there is little room."""
    told = [(side, [name for name, own in rows if own == side]) for side in SIDES]
    return [f"{side} {', '.join(names)}" for side, names in told if names]


def places_of(moving: MovingHomology, times: Array) -> Array:
    """Where all markers are at times (T,) [s], (J, T, 2) [m]."""
    places = np.empty((moving.J, len(times), 2))
    places_at(moving.tracks, times, places)
    return places
