"""Words for paths: on which sides of which obstacles they pass.

A path passes a moving obstacle before or behind it, or left or right if that rests. Words follow from the ids of
homology classes, from where the robot is, and from the other classes: the fewest obstacles that set a class apart.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.planner.references import Reference
from pirrht.topology.homology import Homology
from pirrht.topology.tracks import places_at
from sim.drawing.strokes import interpolated, knots_of

MOMENTS = 60  # of a path that are evaluated
BACK = 0.1  # over which an obstacle's direction is taken [s]
STILL = 0.05  # m/s; of what is slower there is no before and behind
FEW = 4  # moving obstacles of which every one is named
NAMED = 8  # moving obstacles that all bear their names in a picture; those of more would hide it


def sides(reference: Reference, homology: Homology) -> tuple[str, ...]:
    """Return how a path passes each of J markers when nearest to it; "" for a path without times."""
    knots = knots_of(reference)
    if knots is None:
        return ("",) * homology.J
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way, places = interpolated(knots[:, :2], knots[:, 2], times), np.empty((3, homology.J, MOMENTS, 2))
    for shift, found in zip((0.0, BACK, -BACK), places, strict=True):
        places_at(homology.tracks, times + shift, found)
    words = []
    for at, late, early in zip(*places, strict=True):
        k = int(np.argmin(np.linalg.norm(at - way, axis=1)))
        ahead, aside, along = late[k] - early[k], way[k] - at[k], way[min(k + 1, MOMENTS - 1)] - way[max(k - 1, 0)]
        if np.hypot(*ahead) >= 2.0 * BACK * STILL:
            words.append("before" if aside @ ahead > 0.0 else "behind")
        else:
            words.append("left of" if along[0] * aside[1] > along[1] * aside[0] else "right of")
    return tuple(words)


def passing(reference: Reference, homology: Homology) -> list[str]:
    """List how a path passes moving obstacles, as "walker: behind" or "door: left of it"; of many those turned about.

    A part of an obstacle that paths may lead through bears its number in names of classes.
    """
    names, static = homology.names, len(homology.markers)
    named = [f"{name} ({static + j})" if names.count(name) > 1 else name for j, name in enumerate(names, 1)]
    rows = list(zip(named, sides(reference, homology), strict=True))
    if len(rows) > FEW:
        rows = [row for row, turn in zip(rows, reference.winding[static:], strict=True) if turn]
    return [f"{name}: {side}{' it' if side.endswith('of') else ''}" for name, side in rows if side]


def worded(
    windings: Mapping[str, Sequence[int]], straight: Array, names: Sequence[str], movers: Sequence[str] = (),
    among: Collection[str] | None = None, passed: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, str]:  # fmt: skip
    """Name each of several classes; left and right as seen along the path.

    Args:
        windings: by id, of M static and then of moving obstacles [turns].
        straight: H of the straight line from where the robot is, (M,) [turns].
        names: of the static obstacles, (M,).
        movers: of the moving obstacles.
        among: classes from which each is told apart; None: all.
        passed: by id, how each moving obstacle is passed (`sides`).
    """
    rivals = [winding for name, winding in windings.items() if among is None or name in among]
    found = {}
    for name, mine in windings.items():
        told, by = list[int](), (passed or {}).get(name, ())
        differ = np.array([np.not_equal(mine, other) for other in rivals if tuple(other) != tuple(mine)])
        while len(differ):  # the fewest obstacles that tell it from all others, one by one
            told.append(int(np.argmax(differ.sum(axis=0))))
            differ = differ[~differ[:, told[-1]]]
        groups: dict[str, list[str]] = {"once round": [], "right of": [], "left of": []}
        for k in sorted(k for k in told if k < len(names)):
            turn = float(straight[k]) + mine[k]
            groups["once round" if abs(turn) >= 1.0 else ("right of", "left of")[turn < 0.0]].append(names[k])
        parts = [f"{side} {' and '.join(group)}" for side, group in groups.items() if group]
        if len(names) == 2 and groups["right of"] and groups["left of"]:  # of many it need not lead through the gap
            parts = [f"between {groups['right of'][0]} and {groups['left of'][0]}"]
        moving = [k - len(names) for k in sorted(told) if k >= len(names)] if told else range(len(by))
        found[name] = ", ".join(parts + [f"{by[j]} {movers[j]}" for j in moving if j < len(by) and by[j]])
    return {name: words or "straight ahead" for name, words in found.items()}
