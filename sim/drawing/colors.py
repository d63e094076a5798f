"""Signature classes for people: one colour and one title for a whole run, and words for how a path passes obstacles.

A path passes a moving obstacle before or behind it if that crosses the way, else left or right. The word for an
obstacle follows from the turns about it, so that classes of equal turns have the same word and others another one.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.polyline import interpolated
from pirrht.planner.references import Reference
from pirrht.plotting.colors import Color, blend
from pirrht.topology.signature import Signature
from sim.drawing.strokes import knots_of

# Charcoal, plum, olive, mint, sand, slate: of methods, none of which is the colour of a class.
METHODS = ((68, 68, 68), (170, 51, 119), (153, 153, 51), (136, 204, 170), (170, 136, 85), (102, 102, 204))
DEAD_COLOR: Color = (112, 116, 122)
MOVER: Color = (186, 148, 230)  # outlines of bodies that move
DRIVEN: Color = (255, 200, 60)  # the driven path
MOMENTS = 60  # of a path that are evaluated
STILL = 0.05  # m/s; what is slower crosses no way
CROSSING = 0.7  # sine of the angle between its way and the robot's, on average, from which on it is before or behind
LEFT, RIGHT, ACROSS = "left of", "right of", ("before", "behind")
SIDES = (LEFT, RIGHT)
FEW = 4  # static or moving obstacles of which every one is named
NAMED = 8  # static or moving obstacles that all bear their names in a picture; those of more would hide it


def title(name: str) -> str:
    """A class id for people: where there are many obstacles only those with turns, as in "+5 -12"."""
    turns = name.split(",")
    if len(turns) <= 4:
        return name
    parts = [f"{'+' if int(k) > 0 else '-'}{i}" * abs(int(k)) for i, k in enumerate(turns, 1) if int(k)]
    return " ".join(parts) or "straight"


def method_color(index: int) -> Color:
    """The colour of method number `index`; after the last of the palette, tints of the same."""
    tint, hue = divmod(index, len(METHODS))
    return blend(METHODS[hue], (255, 255, 255), min(0.8, 0.4 * tint))


def fade(color: Color, ground: Color, opacity: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The colour seen over the ground with opacities (k,), (k, 3)."""
    seen = np.outer(opacity, color) + np.outer(1 - np.asarray(opacity), ground)
    return np.asarray(np.rint(seen).astype(np.uint8))


def packed(colors: NDArray[np.uint8] | Sequence[Color]) -> NDArray[np.uint32]:
    """Colours (k, 3) as 0xRRGGBBAA (k,), opaque; Rerun takes these without converting one by one."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    return rgb @ np.array([1 << 24, 1 << 16, 1 << 8], np.uint32) + np.uint32(255)


def sides(references: Sequence[Reference], homology: Signature) -> list[tuple[str, ...]]:
    """Return how each of several paths passes each of J moving markers: a word for each number of turns about it.

    One that crosses the way of most is passed before or behind it, any other left or right as these paths go.
    """
    views = _views(references, homology)
    static = len(homology.markers)
    turns = [[float(h) - 1.0 for h in reference.signature[static:]] for reference in references]
    words = [[_side(turn) for turn in row] for row in turns]
    return [tuple(view.get(word, word) for view, word in zip(views, row, strict=True)) for row in words]


def _views(references: Sequence[Reference], homology: Signature) -> list[dict[str, str]]:
    """Return for each of J markers what its left and its right are called, by how it goes by all paths on average."""
    lines = [knots for one in references if homology.J and (knots := knots_of(one)) is not None]
    sums = np.zeros((3, homology.J)) + sum(_seen(knots, homology) for knots in lines)
    views = list[dict[str, str]]()
    for across, moving, faster in sums.T.tolist():
        if moving > 0.0 and abs(across) >= CROSSING * moving:
            views.append(dict(zip(SIDES if across > 0.0 else SIDES[::-1], ACROSS, strict=True)))
        else:  # one that overtakes the robot is on its other side
            views.append(dict(zip(SIDES, SIDES[::-1], strict=True)) if faster > 0.0 else {})
    return views


def _seen(knots: Array, homology: Signature) -> Array:
    """Return how J markers go by a path (k, 3), (3, J): sums over moments, each the more the nearer a marker is.

    The sine of the angle from the robot's direction to the marker's, while both move; 1 while both move; and 1 or -1
    as the marker is faster in the robot's direction or not.
    """
    times = np.linspace(knots[0, 2], knots[-1, 2], MOMENTS)
    way = interpolated(knots[:, :2], knots[:, 2], times)
    places = homology.places(times)
    along = np.diff(way, axis=0)
    moved = np.diff(places, axis=1)
    weight = 1.0 / np.maximum(np.sum((places - way)[:, 1:] ** 2, axis=-1), 1e-9)
    far = np.hypot(moved[..., 0], moved[..., 1])
    lengths = far * np.hypot(*along.T)
    across = along[:, 0] * moved[..., 1] - along[:, 1] * moved[..., 0]  # positive: from the right to the left
    moving = weight * (far >= STILL * np.diff(times)) * (lengths > 0.0)
    faster = weight * np.sign(np.sum((moved - along) * along, axis=-1))
    return np.asarray(np.sum([moving * across / np.maximum(lengths, 1e-12), moving, faster], axis=-1))


def _side(turn: float) -> str:
    """Return how a path passes something about which it makes a turn [turns]: a word for each whole number more."""
    often = int(abs(turn))
    way = "clockwise" if turn < 0.0 else "anticlockwise"

    if often == 0:
        return LEFT if turn < 0.0 else RIGHT
    return f"{way} round" if often == 1 else f"{often} times {way} round"


def numbered(names: Sequence[str]) -> list[str]:
    """Return names of obstacles, with its number in names of classes for one that shares its name with another.

    Of many all have their numbers, since pictures show no more than these.
    """
    often = Counter(names)
    both = [name if name == f"obstacle {k}" else f"{name} ({k})" for k, name in enumerate(names, 1)]
    short = [long if often[name] > 1 else name for name, long in zip(names, both, strict=True)]
    return both if len(names) > NAMED or len({*short}) < len(short) else short


def labels(names: Sequence[str]) -> list[str]:
    """Return what stands at each static obstacle in a picture: its number in names of classes, and if few its name."""
    few = len(names) <= NAMED
    return [f"{k} {n}" if few and n != f"obstacle {k}" else str(k) for k, n in enumerate(names, 1)]


def passing(references: Sequence[Reference], homology: Signature, names: Sequence[str]) -> list[list[str]]:
    """List how each path passes the obstacles by which the paths differ, as "walker: behind" or "pillar: left of it".

    `names` (S,) are those of the static ones. Of many only those that a path turns about are listed. Where paths do
    not differ, the moving obstacles are listed. A part of an obstacle that paths may lead through bears its number in
    names of classes.
    """
    static = len(names)
    called = numbered([*names, *homology.names])
    turns = np.array([reference.winding for reference in references]).reshape(len(references), len(called))
    differ = (turns != turns[:1]).any(axis=0)
    named = np.flatnonzero(differ) if differ.any() else np.arange(static, len(called))
    groups = [named[named < static].tolist(), named[named >= static].tolist()]
    found = []
    for reference, moving in zip(references, sides(references, homology), strict=True):
        words = [*(_side(float(h) - 1.0) for h in reference.signature[:static]), *moving]
        chosen = [k for group in groups for k in group if len(group) <= FEW or reference.winding[k]]
        found.append([f"{called[k]}: {words[k]}{'' if words[k] in ACROSS else ' it'}" for k in chosen])
    return found


def worded(
    windings: Mapping[str, Sequence[int]], straight: Array, names: Sequence[str], movers: Sequence[str] = (),
    among: Collection[str] | None = None, passed: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, str]:  # fmt: skip
    """Name each of several classes, no two alike; left and right as seen along the path.

    `windings` by id, of M static and then of moving obstacles, and `straight` (M,), H of the straight line from where
    the robot is, are in turns; `names` (M,) and `movers` are those of the obstacles. Each class is set apart from those
    in `among`, from all if None. `passed` says by id how each moving obstacle is passed (`sides`).
    """
    M = len(names)
    called = numbered([*names, *movers])

    def moving(name: str, chosen: Sequence[int]) -> list[str]:
        few = len(movers) <= FEW
        some = [k for k in chosen or range(M, len(called)) if k >= M and (chosen or few or windings[name][k])]
        by = (passed or {}).get(name, ())
        return [f"{by[k - M]} {called[k]}" for k in some]

    def sentence(name: str, rivals: Collection[str]) -> str:
        mine = windings[name]
        chosen = telling(mine, [windings[rival] for rival in rivals])
        groups: dict[str, list[str]] = {RIGHT: [], LEFT: []}
        for k in (k for k in chosen if k < M):
            groups.setdefault(_side(float(straight[k]) + mine[k]), []).append(called[k])
        parts = [f"{side} {' and '.join(group)}" for side, group in groups.items() if group]
        if M == 2 and groups[RIGHT] and groups[LEFT]:  # of many it need not lead through the gap
            parts = [f"between {groups[RIGHT][0]} and {groups[LEFT][0]}"]
        return ", ".join([*parts, *moving(name, chosen)]) or "straight ahead"

    found = {name: sentence(name, windings if among is None else among) for name in windings}
    often = Counter(found.values())  # two that are alike are not both in `among`, and are set apart from all
    return {name: text if often[text] == 1 else sentence(name, windings) for name, text in found.items()}


def telling(mine: Sequence[int], rivals: Sequence[Sequence[int]]) -> list[int]:
    """Return the fewest obstacles, found one by one, whose turns tell a class from all that have others."""
    chosen = list[int]()
    differ = np.array([np.not_equal(mine, other) for other in rivals if tuple(other) != tuple(mine)])
    while len(differ):
        chosen.append(int(np.argmax(differ.sum(axis=0))))
        differ = differ[~differ[:, chosen[-1]]]
    return sorted(chosen)
