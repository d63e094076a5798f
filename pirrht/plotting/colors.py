"""One colour for every homology class, the same in all pictures."""

from collections.abc import Iterable
from zlib import crc32

from pirrht.topology.signature import OTHER

Color = tuple[int, int, int]  # red, green, blue, 0..255

# Cyan, magenta, teal, orange, blue, red: they stay apart for colour-blind eyes and read on dark as on white ground.
PALETTE = ((51, 187, 238), (238, 51, 119), (0, 153, 136), (238, 119, 51), (0, 119, 187), (204, 51, 17))
# What is mixed into the palette in turn, and its share: late comers must not be taken for the first classes.
TINTS = (((0, 0, 0), 0.0), ((255, 255, 255), 0.5), ((0, 0, 0), 0.35), ((128, 128, 128), 0.7))
OTHER_COLOR: Color = (187, 187, 187)


class ClassColors(dict[str, Color]):
    """Gives every class id the hue that follows from it, or if another class has it, the next free one; keeps it."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        super().__init__()
        self.meet(names)

    def __missing__(self, name: str) -> Color:
        if name == OTHER:
            return OTHER_COLOR

        wanted = place_of(name)
        hues = len(PALETTE)
        taken = set(self.values())

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
        return (1 + away[0] + (0 if turns[away[0]] == (-1) ** (away[0] + 1) else len(turns))) % len(PALETTE)
    return crc32(name.encode()) % len(PALETTE)


def nth_color(index: int) -> Color:
    """Colour number `index`: palette, tints, shades, then greyish ones in turn."""
    tint, hue = divmod(index, len(PALETTE))
    return blend(PALETTE[hue], *TINTS[min(tint, len(TINTS) - 1)])


def blend(color: Color, other: Color, share: float) -> Color:
    """The colour with a share of another one."""
    red, green, blue = (round((1 - share) * c + share * o) for c, o in zip(color, other, strict=True))
    return red, green, blue


def rgb(color: Color) -> tuple[float, ...]:
    """Return a colour as matplotlib takes it."""
    return tuple(channel / 255.0 for channel in color)
