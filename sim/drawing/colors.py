"""One colour and one title per homology class for a whole run, in recordings and figures alike."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pirrht.estimation.estimate import OTHER

Color = tuple[int, int, int]  # red, green, blue, 0..255

# Six hues that stay apart for colour-blind eyes and read on dark as on white ground.
PALETTE: tuple[Color, ...] = (
    (51, 187, 238),  # cyan
    (238, 51, 119),  # magenta
    (0, 153, 136),  # teal
    (238, 119, 51),  # orange
    (0, 119, 187),  # blue
    (204, 51, 17),  # red
)
OTHER_COLOR: Color = (187, 187, 187)
DEAD_COLOR: Color = (112, 116, 122)
DRIVEN: Color = (255, 200, 60)  # the driven path


class ClassColors:
    """Gives every class id a colour when it first appears, and keeps it."""

    def __init__(self) -> None:
        self._order: dict[str, int] = {}

    def __getitem__(self, name: str) -> Color:
        """The colour of a class id."""
        if name == OTHER:
            return OTHER_COLOR
        return nth_color(self._order.setdefault(name, len(self._order)))

    def meet(self, names: Iterable[str]) -> bool:
        """Take note of class ids; whether one of them is new."""
        known = len(self._order)
        for name in names:
            if name != OTHER:
                self._order.setdefault(name, len(self._order))
        return len(self._order) > known

    @property
    def names(self) -> list[str]:
        """The class ids met so far, in order of first appearance."""
        return list(self._order)


def title(name: str) -> str:
    """A class id for people: where there are many obstacles only those with turns, as in "+5 -12"."""
    turns = name.split(",")
    if len(turns) <= 4:
        return name
    parts = [f"{'+' if int(k) > 0 else '-'}{i}" * abs(int(k)) for i, k in enumerate(turns, 1) if int(k)]
    return " ".join(parts) or "straight"


def nth_color(index: int) -> Color:
    """The colour of the class that appeared as number `index`: palette, tints, shades, then greyish ones in turn."""
    color, round_ = PALETTE[index % len(PALETTE)], index // len(PALETTE)
    if round_ > 2:  # late comers must not be taken for the first classes
        return mix(color, (128, 128, 128), 0.7)
    return (color, mix(color, (255, 255, 255), 0.5), mix(color, (0, 0, 0), 0.35))[round_]


def mix(color: Color, other: Color, share: float) -> Color:
    """The colour with a share of another one."""
    red, green, blue = (round((1 - share) * c + share * o) for c, o in zip(color, other, strict=True))
    return red, green, blue


def fade(color: Color, ground: Color, opacity: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The colour seen over the ground with opacities (k,), (k, 3)."""
    share = np.asarray(opacity)[:, None]
    blend: NDArray[np.uint8] = np.rint(share * np.array(color) + (1 - share) * np.array(ground)).astype(np.uint8)
    return blend
