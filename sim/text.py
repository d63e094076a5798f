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


def table(header: Sequence[str], rows: Sequence[Sequence[str]], columns: int | None = None, *, keep: int = 1) -> str:
    """Columns padded to their widest cell; the first is left-aligned, the others right.

    Args:
        columns: a table that is wider becomes several, each with the first `keep` columns and some of the others.
    """
    cells = [list(header), *[list(map(printable, row)) for row in rows]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    parts = [list(range(keep))]
    for i in range(keep, len(widths)):
        wide = sum(widths[k] + 2 for k in parts[-1]) + widths[i]
        if columns is not None and wide > columns and len(parts[-1]) > keep:
            parts.append(list(range(keep)))
        parts[-1].append(i)
    blocks = []
    for part in parts:
        lines = ["  ".join(row[i].rjust(widths[i]) if i else row[i].ljust(widths[i]) for i in part) for row in cells]
        blocks.append("\n".join(line.rstrip() for line in [lines[0], "-" * len(lines[0]), *lines[1:]]))
    return "\n\n".join(blocks)
