"""Recordings read back, and as tables for other tools: Parquet or NumPy, with the columns that `columns.py` describes.

Columns of a class bear its title, as all tables and pictures do; the class' whole id is in the column's description.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import warnings
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from pirrht.arrays import Array
from pirrht.errors import OptionError
from sim.drawing.colors import title
from sim.files import path_text, replaced, why_unreadable
from sim.recording.columns import CLASSES, COLUMNS, Column, described, of_states
from sim.systems import POSE

STEPS, TIMING, SETTINGS = "/steps", "/timing/plan", "/__properties/run"

Cells = dict[str, list[Any]]  # values by the name of their component
FORMATS = (".parquet", ".npz")

Table = dict[str, Array]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Numbers of a run, as its recording holds them."""

    settings: dict[str, Any]  # of the run
    steps: list[tuple[int, float, Cells]]  # number, simulated time [s] and values of each control step, in order
    plan_ms: dict[int, float]  # wall time of a step's plan [ms]

    @property
    def classes(self) -> list[str]:
        """Ids of the classes that were ever known, in order of their appearance."""
        return list(dict.fromkeys(name for _, _, row in self.steps for name in row.get(CLASSES.component) or ()))

    @property
    def whole(self) -> bool:
        """Return whether the run was recorded to its end."""
        return bool(self.steps[-1][2].get("outcome"))


def read(file: Path) -> Recording:
    """Read a recording.

    Raises:
        OptionError: the file is not there, is no recording, or holds no run or several.
    """
    if (why := why_unreadable(file)) is not None:
        raise OptionError(f"{path_text(file)} {why}; name a recording, FILE.rrd")
    settings: dict[str, Any] = {}
    written: dict[int, tuple[float, Cells]] = {}
    early: dict[int, tuple[float, Cells]] = {}
    plan_ms: dict[int, float] = {}
    for chunk in _chunks(file):
        batch = chunk.to_record_batch()
        table = {name: batch.column(name).to_pylist() for name in batch.schema.names}
        if chunk.entity_path == SETTINGS:
            settings = {name: cells[0][0] for name, cells in table.items() if isinstance(cells[0], list)}
            continue
        for i, step in enumerate(table["step"]):
            cells = {name: values[i] for name, values in table.items() if isinstance(values[i], list)}
            time = table["sim_time"][i].total_seconds()
            if "Scalars:scalars" in cells:
                plan_ms[step] = cells["Scalars:scalars"][0]
            elif chunk.entity_path == TIMING:
                early[step] = time, cells
            elif written.setdefault(step, (time, cells))[1] is not cells:
                raise OptionError(f"{file}: holds more than one run; export the recordings that it was merged from")
    known = {**early, **written}
    if not known:
        raise OptionError(f"{file}: holds no control steps; name a recording made by `pirrht run --record`")
    return Recording(settings=settings, steps=[(step, *known[step]) for step in sorted(known)], plan_ms=plan_ms)


def _chunks(file: Path) -> list[Any]:
    """The chunks of a recording; of one that breaks off in the middle of a chunk, those before."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a recording that breaks off has no footer
        try:
            return _stream(file)
        except (RuntimeError, ValueError):
            pass
        with tempfile.TemporaryDirectory() as folder:
            mended = Path(folder) / "mended.rrd"
            command = [sys.executable, "-P", "-m", "rerun", "rrd", "merge", str(file), "-o", str(mended)]
            subprocess.run(command, env={**os.environ, "CI": "1"}, capture_output=True, check=False)
            try:
                return _stream(mended)
            except (RuntimeError, ValueError):
                raise OptionError(f"{file}: holds no Rerun recording; name one, FILE.rrd") from None


def _stream(file: Path) -> list[Any]:
    reader = RrdReader(str(file))
    if len(reader.recordings()) > 1:
        raise OptionError(f"{file}: holds more than one recording; take them apart with `rerun rrd split`")
    return [chunk for chunk in reader.stream() if chunk.entity_path in (STEPS, TIMING, SETTINGS)]


def check_format(file: Path) -> None:
    """Refuse an ending that names no format, by an OptionError with those that do."""
    if file.suffix not in FORMATS:
        raise OptionError(f"--output {path_text(file)}: the ending must be one of {', '.join(FORMATS)}")


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
    about = {}
    for name in columns:
        column = described(name)
        about[name] = {"unit": column.unit, "text": column.text}
        if column.by_class:
            about[name]["class"] = ids[name.partition(":")[2]]
    with replaced(file, "--output") as stream:
        if file.suffix == ".npz":
            notes = json.dumps({"settings": recording.settings, "columns": about})
            arrays: dict[str, Any] = {**columns, "about": np.array(notes)}
            np.savez_compressed(stream, **arrays)
        else:
            _write_parquet(stream, columns, about, recording.settings)


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
    """A column, or those that it stands for; one that no step has only where runs may not do without it."""
    steps, many = recording.steps, column.name.removesuffix("K")
    if column.values is None:  # no component
        known = {"step": [s for s, _, _ in steps], "time": [t for _, t, _ in steps]}
        return {column.name: np.array(known.get(column.name, [recording.plan_ms.get(s, nan) for s, _, _ in steps]))}
    cells: list[Cells] = [row for _, _, row in steps]
    rows = [row.get(column.component) or [] for row in cells]
    if column.by_class:  # a class without samples has 0
        ids = [row.get(CLASSES.component) or [] for row in cells]
        named = [dict(zip(own, values, strict=True)) for own, values in zip(ids, rows, strict=True)]
        stem = column.name.removesuffix("ID")
        return {f"{stem}{title(c)}": np.array([r.get(c, 0.0) if r else nan for r in named]) for c in recording.classes}
    if column.component == "end":  # a step ends where the next one begins
        last = cells[-1].get("end") or [nan] * len(cells[-1].get("state") or [])
        rows = [*(row.get("state") or [] for row in cells[1:]), last]
    width = max(map(len, rows)) - column.at
    if column.many:
        return {f"{many}{column.at + 1 + k}": _filled(column, rows, column.at + k) for k in range(width)}
    always = (column.at == 0 or column.component in ("state", "end")) and not column.optional
    return {column.name: _filled(column, rows, column.at)} if width > 0 or always else {}


def _states(recording: Recording) -> list[str]:
    """Names of the states; recordings of points and cars do not have them."""
    known = recording.settings.get("states")
    width = max(len(row.get("state") or []) for _, _, row in recording.steps)
    return known.split() if known else [*POSE, *(f"state_{k + 1}" for k in range(3, width))][:width]


def _filled(column: Column, rows: list[list[Any]], at: int) -> Array:
    missing = {float: nan, int: 0, str: ""}[column.kind]
    return np.array([row[at] if len(row) > at else missing for row in rows], dtype=column.kind)
