"""What is kept of control steps at `/steps` of a recording: the components that `columns.py` names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

import rerun as rr

from sim.recording.columns import Column, components
from sim.recording.step_row import Row


def columns(rows: Sequence[Row]) -> list[Any]:
    """All components of some steps; step and time are their index."""
    return [part for name, column in components().items() for part in _component(name, column, rows)]


def _component(name: str, column: Column, rows: Sequence[Row]) -> Iterable[Any]:
    """One named component with any number of values per step."""
    assert column.values is not None
    texts = column.kind is str
    values = [[v if texts else float(v) for v in column.values(row)] for row in rows]
    flat = list(chain.from_iterable(values))
    if not flat:
        return ()
    parts: Iterable[Any] = rr.AnyValues.columns(**{name: flat}).partition([len(row) for row in values])
    return parts
