"""A drive as a table for other tools: Parquet or NumPy, with the columns that `columns.py` describes.

Columns of a class bear its title, as all tables and pictures do; the class' whole id is in the column's description.
"""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.files import replaced, shown
from sim.drawing.colors import title
from sim.recording.columns import CLASSES, COLUMNS, Column, described, of_states
from sim.recording.read import Cells, Recording
from sim.systems import POSE

FORMATS = (".parquet", ".npz")

Table = dict[str, Array]


def check_format(file: Path) -> None:
    """Refuse an ending that names no format.

    Raises:
        OptionError: with the endings that are known.
    """
    if file.suffix not in FORMATS:
        raise OptionError(f"--output {shown(file)}: the ending must be one of {', '.join(FORMATS)}")


def table(recording: Recording) -> Table:
    """The columns of a recording by name, each with one entry per control step."""
    columns: Table = {}
    for column in of_states(COLUMNS, _states(recording)):
        columns |= _expanded(column, recording)
    return columns


def write(file: Path, columns: Table, recording: Recording) -> None:
    """Write the table of a recording with its description; the ending of the file tells the format.

    Raises:
        OptionError: the file cannot be written.
    """
    ids = {title(name): name for name in recording.classes}
    about = {name: _about(name, ids) for name in columns}
    with replaced(file, "--output") as stream:
        if file.suffix == ".npz":
            notes = json.dumps({"settings": recording.settings, "columns": about})
            arrays: dict[str, Any] = {**columns, "about": np.array(notes)}
            np.savez_compressed(stream, **arrays)
        else:
            _write_parquet(stream, columns, about, recording.settings)


def _about(name: str, ids: dict[str, str]) -> dict[str, str]:
    """Unit and meaning of a column, and the class that it belongs to."""
    column = described(name)
    known = {"unit": column.unit, "text": column.text}
    return {**known, "class": ids[name.partition(":")[2]]} if column.by_class else known


def _write_parquet(stream: Any, columns: Table, about: dict[str, dict[str, str]], settings: dict[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = []
    for name, values in columns.items():
        notes = {"description" if key == "text" else key: text for key, text in about[name].items()}
        fields.append(pa.field(name, pa.array(values).type, metadata=notes))
    schema = pa.schema(fields, metadata={"pirrht": json.dumps(settings)})
    pq.write_table(pa.table(dict(columns), schema=schema), stream, compression="zstd")


def _expanded(column: Column, recording: Recording) -> Table:
    """A column, or those that it stands for."""
    if column.values is None:
        return {column.name: _index(column.name, recording)}
    if column.by_class:
        return _by_class(column, recording)
    rows = _cells(column, recording)
    width = max(map(len, rows)) - column.at
    if not column.many:
        return {column.name: _filled(column, rows, column.at)} if width > 0 or _always(column) else {}
    first = column.at + 1
    stem = column.name.removesuffix("K")
    return {f"{stem}{first + k}": _filled(column, rows, column.at + k) for k in range(width)}


def _states(recording: Recording) -> list[str]:
    """Names of the states; recordings of points and cars do not tell them."""
    known = recording.settings.get("states")
    width = max(len(row.get("state") or []) for _, _, row in recording.steps)
    return known.split() if known else [*POSE, *(f"state_{k + 1}" for k in range(3, width))][:width]


def _index(name: str, recording: Recording) -> Array:
    """What a recording tells beside its components."""
    if name == "step":
        return np.array([step for step, _, _ in recording.steps])
    if name == "time":
        return np.array([time for _, time, _ in recording.steps])
    return np.array([recording.plan_ms.get(step, nan) for step, _, _ in recording.steps])


def _cells(column: Column, recording: Recording) -> list[list[Any]]:
    """What each step has of a column's component."""
    cells: list[Cells] = [row for _, _, row in recording.steps]
    unknown = [nan] * len(cells[-1].get("state") or [])
    if column.component != "end":
        return [row.get(column.component) or [] for row in cells]
    return [*(row.get("state") or [] for row in cells[1:]), cells[-1].get("end") or unknown]


def _always(column: Column) -> bool:
    """Whether the column is there even if no step has a value."""
    return (column.at == 0 or column.component in ("state", "end")) and not column.optional


def _filled(column: Column, rows: list[list[Any]], at: int) -> Array:
    missing = {float: nan, int: 0, str: ""}[column.kind]
    return np.array([row[at] if len(row) > at else missing for row in rows], dtype=column.kind)


def _by_class(column: Column, recording: Recording) -> Table:
    """A column for each class that was ever known; a class without samples has 0."""
    named = [
        dict(zip(row.get(CLASSES.component) or [], row.get(column.component) or [], strict=True))
        for _, _, row in recording.steps
    ]
    stem = column.name.removesuffix("ID")
    return {f"{stem}{title(c)}": np.array([r.get(c, 0.0) if r else nan for r in named]) for c in recording.classes}
