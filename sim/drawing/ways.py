"""Words for homology classes: on which sides of which obstacles their paths pass, as a person would say it.

Ids stay what programs compare; these words follow from them, from where the robot is, and from what the other classes
are: a class is told by the fewest obstacles that set it apart.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from pirrht.arrays import Array

PASSED = 0.2  # turns about an obstacle from which a path counts as passing it


def worded(
    windings: Mapping[str, Sequence[int]],
    straight: Array,
    names: Sequence[str],
    movers: Sequence[str] = (),
    among: Collection[str] | None = None,
    sides: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, str]:
    """What to call each of several classes.

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
