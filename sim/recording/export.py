"""A drive as a table for other tools: Parquet or NumPy, with the columns that `columns.py` describes."""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.files import replaced
from sim.recording.columns import described
from sim.recording.read import Cells, Recording

FORMATS = (".parquet", ".npz")

Table = dict[str, Array]


def check_format(file: Path) -> None:
    """Refuse an ending that names no format.

    Raises:
        OptionError: with the endings that are known.
    """
    if file.suffix not in FORMATS:
        raise OptionError(f"--output {file}: the ending must be one of {', '.join(FORMATS)}")


def table(recording: Recording) -> Table:
    """The columns of a recording by name, each with one entry per control step."""
    cells = [row for _, _, row in recording.steps]
    columns: Table = {
        "step": np.array([step for step, _, _ in recording.steps]),
        "time": np.array([time for _, time, _ in recording.steps]),
        **_scalar("duration", cells),
        **_places("", np.array([row["state"] for row in cells])),
        **_vector("control", cells),
        **_vector("noise", cells),
        **_places("end_", _ends(cells)),
    }
    for name in ("cost", "length", "clearance", "value", "value_error"):
        columns |= _scalar(name, cells)
    columns |= _vector("control_error", cells)
    columns["doubtful"] = np.array([int(row.get("doubtful", [0])[0]) for row in cells])
    if all("exact_value" in row for row in cells):
        columns |= {**_scalar("exact_value", cells), **_vector("exact_control", cells)}
    columns |= {**_by_class("weight", "weights", cells), **_by_class("ess", "ess", cells)}
    columns["vertices"] = np.array([int(row.get("vertices", [0])[0]) for row in cells])
    columns["plan_ms"] = np.array([recording.plan_ms.get(step, nan) for step, _, _ in recording.steps])
    columns["outcome"] = np.array([(row.get("outcome") or [""])[0] for row in cells])
    return columns


def write(file: Path, columns: Table, settings: dict[str, Any]) -> None:
    """Write a table with its description; the ending of the file tells the format.

    Raises:
        OptionError: the file cannot be written.
    """
    with replaced(file, "--output") as stream:
        if file.suffix == ".npz":
            about = {name: {"unit": described(name).unit, "text": described(name).text} for name in columns}
            notes = json.dumps({"settings": settings, "columns": about})
            arrays: dict[str, Any] = {**columns, "about": np.array(notes)}
            np.savez_compressed(stream, **arrays)
        else:
            _write_parquet(stream, columns, settings)


def _write_parquet(stream: Any, columns: Table, settings: dict[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = []
    for name, values in columns.items():
        about = {"unit": described(name).unit, "description": described(name).text}
        fields.append(pa.field(name, pa.array(values).type, metadata=about))
    schema = pa.schema(fields, metadata={"pirrht": json.dumps(settings)})
    pq.write_table(pa.table(dict(columns), schema=schema), stream, compression="zstd")


def _scalar(name: str, cells: list[Cells]) -> Table:
    return {name: np.array([row[name][0] for row in cells])}


def _vector(name: str, cells: list[Cells]) -> Table:
    values = np.array([row[name] for row in cells])
    return {f"{name}_{k + 1}": values[:, k] for k in range(values.shape[1])}


def _places(prefix: str, states: Array) -> Table:
    """Positions and headings, and what else a state has."""
    names = ["x", "y", "heading", *(f"state_{k}" for k in range(4, states.shape[1] + 1))]
    return {f"{prefix}{names[k]}": states[:, k] for k in range(states.shape[1])}


def _ends(cells: list[Cells]) -> Array:
    """Where each step ended, which is where the next began."""
    unknown = [nan] * len(cells[-1]["state"])
    return np.array([*(row["state"] for row in cells[1:]), cells[-1].get("end") or unknown])


def _by_class(column: str, component: str, cells: list[Cells]) -> Table:
    """A column for each class that was ever known; a class without samples has 0."""
    named = [dict(zip(row.get("classes") or [], row.get(component) or [], strict=True)) for row in cells]
    classes = list(dict.fromkeys(name for row in named for name in row))
    return {f"{column}:{c}": np.array([row.get(c, 0.0) if row else nan for row in named]) for c in classes}
