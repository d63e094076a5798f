"""Text for people: numbers with their nouns, lines that fit the terminal, tables."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Any

from pirrht.errors import printable

LEAST = 30  # columns of a terminal that text is broken for
WORDS: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and what it counts, as in 1 run and 2 runs; `plural` where it is no mere s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def width() -> int | None:
    """Columns of the terminal that standard output goes to; None where it goes elsewhere."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def say(text: str) -> None:
    """Print lines, broken between words where a terminal is narrower."""
    room = width()
    for line in text.splitlines():
        print(line if room is None else textwrap.fill(line, max(room, LEAST), subsequent_indent="  ", **WORDS))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], room: int | None = None, *, keep: int = 1) -> str:
    """Columns padded to their widest cell; the first is left-aligned, the others right.

    Args:
        room: a table that is wider becomes several, each with the first `keep` columns and some of the others.
    """
    cells = [list(header), *[list(map(printable, row)) for row in rows]]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    first = list(range(keep))
    parts = [list(first)]
    for i in range(keep, len(widths)):
        wide = sum(widths[k] + 2 for k in parts[-1]) + widths[i]
        if room is not None and wide > room and len(parts[-1]) > keep:
            parts.append(list(first))
        parts[-1].append(i)
    return "\n\n".join(_block([[row[i] for i in part] for row in cells], [widths[i] for i in part]) for part in parts)


def _block(cells: Sequence[Sequence[str]], widths: Sequence[int]) -> str:
    """A table's header, a line under it, and its rows."""
    lines = [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    return "\n".join(line.rstrip() for line in [lines[0], "-" * len(lines[0]), *lines[1:]])
