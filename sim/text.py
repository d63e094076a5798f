"""Text for people: numbers with their nouns, lines, tables."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import takewhile

from pirrht.errors import printable


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and what it counts, as in 1 run and 2 runs; `plural` where it is no mere s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def suggestion(word: object, known: Iterable[str]) -> str:
    """A question in brackets for the known word that a word is most like; empty if it is like none."""
    near = get_close_matches(str(word), [*known], 1)
    return f" (did you mean {near[0]}?)" if near else ""


def shared(names: Sequence[str]) -> str:
    """Return the first words that all of several names share; empty if they share none."""
    columns = zip(*(name.split() for name in names), strict=False)
    return " ".join(words[0] for words in takewhile(lambda words: len({*words}) == 1, columns))


def say(text: str) -> None:
    """Print lines, none of an empty text."""
    print(text, end="\n" if text else "")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns padded to their widest cell; the first is left-aligned, the others right."""
    cells = [list(header), *[list(map(printable, row)) for row in rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip() for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
