"""Homology classes for people: one colour and one title for a whole run, and words for how a path passes obstacles.

A path passes a moving obstacle before or behind it, or left or right if that rests. Words follow from the ids of
classes, from where the robot is, and from the other classes: the fewest obstacles that set a class apart.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.estimation.estimate import OTHER
from pirrht.planner.references import Reference
from pirrht.topology.homology import Homology
from pirrht.topology.tracks import places_at
from sim.drawing.strokes import interpolated, knots_of

Color = tuple[int, int, int]  # red, green, blue, 0..255

# Cyan, magenta, teal, orange, blue, red: they stay apart for colour-blind eyes and read on dark as on white ground.
PALETTE = ((51, 187, 238), (238, 51, 119), (0, 153, 136), (238, 119, 51), (0, 119, 187), (204, 51, 17))
# Charcoal, plum, olive, mint, sand, slate: of methods, none of which is the colour of a class.
METHODS = ((68, 68, 68), (170, 51, 119), (153, 153, 51), (136, 204, 170), (170, 136, 85), (102, 102, 204))
# What is mixed into the palette in turn, and its share: late comers must not be taken for the first classes.
TINTS = (((0, 0, 0), 0.0), ((255, 255, 255), 0.5), ((0, 0, 0), 0.35), ((128, 128, 128), 0.7))
EARLY = 3 * len(PALETTE)  # colours that look like no other: the palette, its tints and its shades
OTHER_COLOR: Color = (187, 187, 187)
DEAD_COLOR: Color = (112, 116, 122)
MOVER: Color = (186, 148, 230)  # outlines of bodies that move
DRIVEN: Color = (255, 200, 60)  # the driven path
MOMENTS = 60  # of a path that are evaluated
BACK = 0.1  # over which an obstacle's direction is taken [s]
STILL = 0.05  # m/s; of what is slower there is no before and behind
FEW = 4  # moving obstacles of which every one is named
NAMED = 8  # moving obstacles that all bear their names in a picture; those of more would hide it


class ClassColors(dict[str, Color]):
    """Gives every class id the hue that follows from it, or if another class has it, the next free one; keeps it."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        super().__init__()
        self.meet(names)

    def __missing__(self, name: str) -> Color:
        if name == OTHER:
            return OTHER_COLOR
        wanted, hues, taken = place_of(name), len(PALETTE), set(self.values())
        early = (nth_color(hues * tint + (wanted + k) % hues) for tint in range(3) for k in range(hues))
        self[name] = next((color for color in early if color not in taken), nth_color(len(self)))
        return self[name]

    def meet(self, names: Iterable[str]) -> None:
        """Take note of class ids."""
        for name in names:
            self.__getitem__(name)


def place_of(name: str) -> int:
    """The hue that a class id asks for, whatever run or picture it appears in.

    The straight class comes first, then for each obstacle the first neighbour on one side or the other in turn.
    """
    turns = [int(k) for k in name.split(",") if k.lstrip("-").isdigit()]
    away = [i for i, k in enumerate(turns) if k]
    if not away:
        return 0
    if len(away) == 1 and abs(turns[away[0]]) == 1:
        first = turns[away[0]] == (-1) ** (away[0] + 1)
        return (1 + away[0] + (0 if first else len(turns))) % len(PALETTE)
    return crc32(name.encode()) % len(PALETTE)


def title(name: str) -> str:
    """A class id for people: where there are many obstacles only those with turns, as in "+5 -12"."""
    turns = name.split(",")
    if len(turns) <= 4:
        return name
    parts = [f"{'+' if int(k) > 0 else '-'}{i}" * abs(int(k)) for i, k in enumerate(turns, 1) if int(k)]
    return " ".join(parts) or "straight"


def nth_color(index: int) -> Color:
    """Colour number `index`: palette, tints, shades, then greyish ones in turn."""
    tint, hue = divmod(index, len(PALETTE))
    return mix(PALETTE[hue], *TINTS[min(tint, len(TINTS) - 1)])


def method_color(index: int) -> Color:
    """The colour of method number `index`; after the last of the palette, tints of the same."""
    tint, hue = divmod(index, len(METHODS))
    return mix(METHODS[hue], (255, 255, 255), min(0.8, 0.4 * tint))


def mix(color: Color, other: Color, share: float) -> Color:
    """The colour with a share of another one."""
    red, green, blue = (round((1 - share) * c + share * o) for c, o in zip(color, other, strict=True))
    return red, green, blue


def rgb(color: Color) -> tuple[float, ...]:
    """Return a colour as matplotlib takes it."""
    return tuple(channel / 255.0 for channel in color)


def fade(color: Color, ground: Color, opacity: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The colour seen over the ground with opacities (k,), (k, 3)."""
    blend = np.outer(opacity, color) + np.outer(1 - np.asarray(opacity), ground)
    return np.asarray(np.rint(blend).astype(np.uint8))


def packed(colors: NDArray[np.uint8] | Sequence[Color]) -> NDArray[np.uint32]:
    """Colours (k, 3) as 0xRRGGBBAA (k,), opaque; Rerun takes these without converting one by one."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    return rgb @ np.array([1 << 24, 1 << 16, 1 << 8], np.uint32) + np.uint32(255)


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

    `windings` by id, of M static and then of moving obstacles, and `straight` (M,), H of the straight line from where
    the robot is, are in turns; `names` (M,) and `movers` are those of the obstacles. Each class is set apart from those
    in `among`, from all if None. `passed` says by id how each moving obstacle is passed (`sides`).
    """
    rivals = [winding for name, winding in windings.items() if among is None or name in among]
    found, M = {}, len(names)
    for name, mine in windings.items():
        chosen, by = _telling(mine, rivals), (passed or {}).get(name) or [""] * len(movers)
        groups: dict[str, list[str]] = {"once round": [], "right of": [], "left of": []}
        for k in (k for k in chosen if k < M):
            turn = float(straight[k]) + mine[k]
            groups["once round" if abs(turn) >= 1.0 else ("right of", "left of")[turn < 0.0]].append(names[k])
        parts = [f"{side} {' and '.join(group)}" for side, group in groups.items() if group]
        if M == 2 and groups["right of"] and groups["left of"]:  # of many it need not lead through the gap
            parts = [f"between {groups['right of'][0]} and {groups['left of'][0]}"]
        moving = [k - M for k in chosen if k >= M] if chosen else range(len(by))
        found[name] = ", ".join(parts + [f"{by[j]} {movers[j]}" for j in moving if by[j]]) or "straight ahead"
    return found


def _telling(mine: Sequence[int], rivals: Sequence[Sequence[int]]) -> list[int]:
    """Return the fewest obstacles, found one by one, whose turns tell a class from all that have others."""
    chosen = list[int]()
    differ = np.array([np.not_equal(mine, other) for other in rivals if tuple(other) != tuple(mine)])
    while len(differ):
        chosen.append(int(np.argmax(differ.sum(axis=0))))
        differ = differ[~differ[:, chosen[-1]]]
    return sorted(chosen)
