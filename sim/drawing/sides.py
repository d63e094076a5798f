"""Words for paths: on which sides of which obstacles they pass, as a person would say it.

A path passes a moving obstacle before or behind it, or left or right if that rests. Ids of homology classes stay what
programs compare; words follow from them, from where the robot is, and from the other classes: a class is told by the
fewest obstacles that set it apart.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.planner.references import Reference
from pirrht.topology.homology import Homology
from pirrht.topology.tracks import places_at

MOMENTS = 60  # of a path that are looked at
BACK = 0.1  # over which a body's direction is taken [s]
STILL = 0.05  # m/s; of what is slower there is no before and behind
SIDES = "before", "behind", "left of", "right of"  # the last two seen along the path, of a body that hardly moves then
FEW = 4  # bodies of which every one is told
NAMED = 8  # bodies that all bear their names in a picture; those of more would hide it
PASSED = 0.2  # turns about an obstacle from which a path counts as passing it


def sides(reference: Reference, homology: Homology) -> tuple[str, ...]:
    """One of SIDES for each of J markers, by where the path is when nearest to it; "" for a path without times."""
    path = reference.trajectory.path
    knots = getattr(path, "knots", None)
    if knots is None or knots.shape[1] != 3:
        return ("",) * homology.J
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way = np.column_stack([np.interp(times, knots[:, 2], knots[:, k]) for k in (0, 1)])
    places, late, early = (places_of(homology, times + shift) for shift in (0.0, BACK, -BACK))
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


def called(homology: Homology) -> list[str]:
    """Bodies by name, (J,); each part of one that paths may lead through with its number in names of classes."""
    names, standing = homology.names, len(homology.markers)
    return [f"{name} ({standing + j})" if names.count(name) > 1 else name for j, name in enumerate(names, 1)]


def passed(reference: Reference, homology: Homology) -> list[tuple[str, str]]:
    """Each body with its one of SIDES; of many those that the path turns about."""
    rows = list(zip(called(homology), sides(reference, homology), strict=True))
    if len(rows) > FEW:
        turns = reference.winding[len(homology.markers) :]
        rows = [row for row, turn in zip(rows, turns, strict=True) if turn]
    return [row for row in rows if row[1]]


def passing(reference: Reference, homology: Homology) -> list[str]:
    """List `passed` in words, as "walker: behind" or "door: left of it"."""
    return [f"{name}: {side}{' it' if side.endswith('of') else ''}" for name, side in passed(reference, homology)]


def by_side(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Group `passed` by side, as "behind walker, cart", for where there is little room."""
    told = [(side, [name for name, own in rows if own == side]) for side in SIDES]
    return [f"{side} {', '.join(names)}" for side, names in told if names]


def places_of(homology: Homology, times: Array) -> Array:
    """Return the places of all markers at times (T,) [s], (J, T, 2) [m]."""
    places = np.empty((homology.J, len(times), 2))
    places_at(homology.tracks, times, places)
    return places


def worded(
    windings: Mapping[str, Sequence[int]],
    straight: Array,
    names: Sequence[str],
    movers: Sequence[str] = (),
    among: Collection[str] | None = None,
    sides: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, str]:
    """Name each of several classes.

    Args:
        windings: by id, of M obstacles and then of bodies that move [turns].
        straight: H of the straight line from where the robot is, (M,) [turns].
        names: of the obstacles, (M,).
        movers: of the bodies that move, in the order of the windings.
        among: those from which each is to be told apart; None: from all.
        sides: by id, how each body is passed, as `sides.SIDES` has it.

    Left and right are those of somebody who goes along the path.
    """
    rivals = [winding for name, winding in windings.items() if among is None or name in among]
    by = sides or {}
    return {name: _words(mine, rivals, straight, names, movers, by.get(name, ())) for name, mine in windings.items()}


def _words(
    mine: Sequence[int],
    rivals: Sequence[Sequence[int]],
    straight: Array,
    names: Sequence[str],
    movers: Sequence[str],
    passed: Sequence[str],
) -> str:
    others = [other for other in rivals if tuple(other) != tuple(mine)]
    told = _telling(mine, others) if others else _passed(mine, straight)
    standing = [k for k in told if k < len(names)]
    turns = {k: float(straight[k]) + mine[k] for k in standing}
    rounds = [f"once round {names[k]}" for k in standing if abs(turns[k]) >= 1.0]
    left = [names[k] for k in standing if -1.0 < turns[k] < 0.0]
    right = [names[k] for k in standing if 0.0 <= turns[k] < 1.0]
    if len(left) == len(right) == 1 and len(names) == 2:  # of two among many it need not lead through the gap
        sides = [f"between {right[0]} and {left[0]}"]
    else:
        sides = [f"{side} of {_listed(group)}" for side, group in (("right", right), ("left", left)) if group]
    bodies = [_about(mine[k], movers, k - len(names), passed) for k in told if k >= len(names)]
    if not standing and not bodies:  # a class alone is told by the bodies that it passes
        bodies = [f"{side} {name}" for side, name in zip(passed, movers, strict=False) if side]
    return ", ".join([*rounds, *sides, *bodies]) or "straight ahead"


def _telling(mine: Sequence[int], others: list[Sequence[int]]) -> list[int]:
    """The fewest obstacles that tell a class from all others, found one by one, in their order."""
    told: list[int] = []
    while others:
        apart = np.array([[a != b for a, b in zip(mine, other, strict=True)] for other in others]).sum(axis=0)
        best = int(np.argmax(apart))
        told.append(best)
        others = [other for other in others if other[best] == mine[best]]
    return sorted(told)


def _passed(mine: Sequence[int], straight: Array) -> list[int]:
    """The two obstacles that the only class there is passes most clearly."""
    turns = np.abs(straight + np.asarray(mine)[: len(straight)])
    clear = np.argsort(-turns, kind="stable")[:2]
    return sorted(int(k) for k in clear if turns[k] >= PASSED)


def _about(turns: int, movers: Sequence[str], body: int, sides: Sequence[str]) -> str:
    name = movers[body] if body < len(movers) else "a moving body"
    if body < len(sides) and sides[body]:
        return f"{sides[body]} {name}"
    return f"past {name} as the straight way" if turns == 0 else f"the other way round {name}"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
