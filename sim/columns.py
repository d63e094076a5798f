"""How a number that is told in a table is described."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of a table, or a figure of a record."""

    name: str
    kind: str  # of Arrow: string, float64 or int64
    unit: str
    text: str
