"""Text for people: numbers with their nouns, lines that fit the terminal, tables."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Sequence

from pirrht.errors import printable

MIN_COLUMNS = 30  # of a terminal that text is broken for


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and what it counts, as in 1 run and 2 runs; `plural` where it is no mere s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def width() -> int | None:
    """Columns of the terminal that standard output goes to; None where it goes elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def say(text: str) -> None:
    """Print lines, broken between words where a terminal is narrower."""
    columns = width()
    fit = textwrap.TextWrapper(
        max(columns or 0, MIN_COLUMNS), subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    for line in text.splitlines():
        print(line if columns is None else fit.fill(line))


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns padded to their widest cell; the first is left-aligned, the others right."""
    cells = [list(header), *[list(map(printable, row)) for row in rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip() for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])
