"""One colour and one title per homology class for a whole run, in recordings and figures alike."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, count
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from pirrht.estimation.estimate import OTHER

Color = tuple[int, int, int]  # red, green, blue, 0..255

# Cyan, magenta, teal, orange, blue, red: they stay apart for colour-blind eyes and read on dark as on white ground.
PALETTE: tuple[Color, ...] = (
    (51, 187, 238), (238, 51, 119), (0, 153, 136), (238, 119, 51), (0, 119, 187), (204, 51, 17),
)  # fmt: skip
# Charcoal, plum, olive, mint, sand, slate: of methods, none of which is the colour of a class.
METHODS: tuple[Color, ...] = (
    (68, 68, 68), (170, 51, 119), (153, 153, 51), (136, 204, 170), (170, 136, 85), (102, 102, 204),
)  # fmt: skip
EARLY = 3 * len(PALETTE)  # colours that look like no other: the palette, its tints and its shades
OTHER_COLOR: Color = (187, 187, 187)
DEAD_COLOR: Color = (112, 116, 122)
MOVER: Color = (186, 148, 230)  # outlines of bodies that move
DRIVEN: Color = (255, 200, 60)  # the driven path


class ClassColors:
    """Gives every class id the hue that follows from it, or if another class has it, the next free one; keeps it."""

    def __init__(self) -> None:
        self._place: dict[str, int] = {}

    def __getitem__(self, name: str) -> Color:
        """The colour of a class id."""
        if name == OTHER:
            return OTHER_COLOR
        self.meet((name,))
        return nth_color(self._place[name])

    def meet(self, names: Iterable[str]) -> None:
        """Take note of class ids."""
        hues = len(PALETTE)
        for name in (name for name in names if name != OTHER and name not in self._place):
            wanted, taken = place_of(name), set(self._place.values())
            early = (hues * tint + (wanted + k) % hues for tint in range(3) for k in range(hues))
            self._place[name] = next(k for k in chain(early, count(EARLY)) if k not in taken)

    @property
    def names(self) -> list[str]:
        """The class ids met so far, in order of first appearance."""
        return list(self._place)


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
    color, round_ = PALETTE[index % len(PALETTE)], index // len(PALETTE)
    if round_ > 2:  # late comers must not be taken for the first classes
        return mix(color, (128, 128, 128), 0.7)
    return (color, mix(color, (255, 255, 255), 0.5), mix(color, (0, 0, 0), 0.35))[round_]


def method_color(index: int) -> Color:
    """The colour of method number `index`; after the last of the palette, tints of the same."""
    color, round_ = METHODS[index % len(METHODS)], index // len(METHODS)
    return mix(color, (255, 255, 255), min(0.8, 0.4 * round_))


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
