"""Recordings read back, and as tables for other tools: Parquet or NumPy, with the columns that `columns.py` describes.

Columns of a class bear its title, as all tables and pictures do; the class' whole id is in the column's description.
"""

import json
import os
import re
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
from sim.recording.columns import CLASSES, COLUMNS, Column
from sim.states import ADAPTERS

STEPS, TIMING, SETTINGS = "/steps", "/timing/plan", "/__properties/run"
MCAP = ".mcap"  # of messages of ROS 2, which `sim.ros.mcap` writes
FORMATS = (".parquet", ".npz", MCAP)
MISSING = {float: nan, int: 0, str: ""}

Cells = dict[str, list[Any]]  # values by the name of their component
Table = dict[str, Array]


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """What an entity looks like from a time on."""

    time: float  # simulated [s]; 0 of what holds at all times
    cells: dict[str, Any]  # by component: numbers (k, ...), or lists of these, of texts or of mappings


Shown = dict[str, list[Row]]  # by the path of the entity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Numbers of a run, as its recording holds them."""

    settings: dict[str, Any]  # of the run
    steps: list[tuple[int, float, Cells]]  # number, simulated time [s] and values of each control step, in order
    plan_ms: dict[int, float]  # wall time of a step's plan [ms]

    @property
    def classes(self) -> list[str]:
        """Ids of the classes that were ever known, in order of their appearance."""
        return list(dict.fromkeys(name for row in self.values(CLASSES.component) for name in row))

    @property
    def whole(self) -> bool:
        """Return whether the run was recorded to its end."""
        return bool(self.values("outcome")[-1])

    def values(self, component: str) -> list[list[Any]]:
        """Return the values of a component, step by step; a step ends where the next one begins."""
        rows = [row.get(component) or [] for _, _, row in self.steps]
        if component == "end":
            starts = self.values("state")
            return [*starts[1:], rows[-1] or [nan] * len(starts[-1])]
        return rows


def read(file: Path) -> Recording:
    """Read a recording; an OptionError if it is not there, is none, or holds no run or several."""
    if (why := why_unreadable(file)) is not None:
        raise OptionError(f"{path_text(file)} {why}; name a recording, FILE.rrd")
    settings: dict[str, Any] = {}
    written: dict[int, tuple[float, Cells]] = {}
    early: dict[int, tuple[float, Cells]] = {}
    plan_ms: dict[int, float] = {}
    for chunk in _chunks(file, (STEPS, TIMING, SETTINGS)):
        for row in chunk.to_record_batch().to_pylist():
            cells = {name: value for name, value in row.items() if isinstance(value, list)}
            if chunk.entity_path == SETTINGS:
                settings |= {name: value[0] for name, value in cells.items()}
                continue
            step = row["step"]
            known = (row["sim_time"].total_seconds(), cells)

            if "Scalars:scalars" in cells:
                plan_ms[step] = cells["Scalars:scalars"][0]
            elif chunk.entity_path == TIMING:
                early[step] = known
            elif written.setdefault(step, known) is not known:
                raise OptionError(f"{file}: holds more than one run; export the recordings that it was merged from")
    steps = {**early, **written}
    if not steps:
        raise OptionError(f"{file}: holds no control steps; name a recording made by `pirrht run --record`")
    return Recording(settings=settings, steps=[(step, *steps[step]) for step in sorted(steps)], plan_ms=plan_ms)


def shown(file: Path) -> Shown:
    """Read what a recording shows in space, entity by entity; an OptionError as of `read`."""
    found: Shown = {}
    for chunk in _chunks(file, ("/world", "/map")):
        batch = chunk.to_record_batch()
        names = batch.schema.names
        times = [time.total_seconds() for time in batch["sim_time"].to_pylist()] if "sim_time" in names else [0.0]
        for k, time in enumerate(times):
            cells = {name: batch[name][k] for name in names if ":" in name}
            cells = {name: _plain(cell.values) for name, cell in cells.items() if cell.is_valid}
            found.setdefault(chunk.entity_path, []).append(Row(time, cells))
    return found


def _plain(values: Any) -> Any:
    """Values of a table of Arrow as an array, as a list of arrays, or one of texts or mappings."""
    import pyarrow as pa

    kind = values.type
    if pa.types.is_fixed_size_list(kind):
        return values.flatten().to_numpy(zero_copy_only=False).reshape(-1, kind.list_size)
    if pa.types.is_list(kind):
        return [_plain(one.values) for one in values]
    return values.to_numpy(zero_copy_only=False) if pa.types.is_primitive(kind) else values.to_pylist()


def _chunks(file: Path, paths: tuple[str, ...]) -> list[Any]:
    """The chunks of entities of a recording, of a file that breaks off in the middle of a chunk those before.

    Args:
        paths: with which those of the entities begin.
    """
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")  # a recording that breaks off has no footer
        repaired = Path(folder) / "repaired.rrd"
        for one in (file, repaired):
            try:
                reader = RrdReader(str(one))
                if len(reader.recordings()) > 1:
                    raise OptionError(f"{file}: holds more than one recording; take them apart with `rerun rrd split`")
                return [chunk for chunk in reader.stream() if chunk.entity_path.startswith(paths)]
            except (RuntimeError, ValueError):
                command = [sys.executable, "-P", "-m", "rerun", "rrd", "merge", str(file), "-o", str(repaired)]
                subprocess.run(command, env={**os.environ, "CI": "1"}, capture_output=True, check=False)
    raise OptionError(f"{file}: holds no Rerun recording; name one, FILE.rrd")


def check_format(file: Path) -> None:
    """Refuse an ending that names no format, by an OptionError with those that do."""
    if file.suffix not in FORMATS:
        raise OptionError(f"--output {path_text(file)}: the ending must be one of {', '.join(FORMATS)}")


def table(recording: Recording) -> Table:
    """The columns of a recording by name, each with one entry per control step."""
    columns: Table = {}
    rows = [(step, time, recording.plan_ms.get(step, nan)) for step, time, _ in recording.steps]
    known = dict(zip(("step", "time", "plan_ms"), zip(*rows, strict=True), strict=True))
    for column in COLUMNS:
        if column.values is None:
            columns[column.name] = np.array(known[column.name])
        else:
            columns |= (_by_class if column.name.endswith(":ID") else _by_place)(column, recording)
    return columns


def _by_class(column: Column, recording: Recording) -> Table:
    """One column for each class: one without samples has 0."""
    pairs = zip(recording.values(CLASSES.component), recording.values(column.component), strict=True)
    rows = [dict(zip(ids, values, strict=True)) for ids, values in pairs]
    stem = column.name.removesuffix("ID")
    return {f"{stem}{title(c)}": np.array([r.get(c, 0.0) if r else nan for r in rows]) for c in recording.classes}


def _by_place(column: Column, recording: Recording) -> Table:
    """A column, or those that it stands for."""
    rows = recording.values(column.component)
    width = max(map(len, rows))
    given = recording.settings.get("states")  # recordings of points and cars do not have them
    states = given.split() if given else [*ADAPTERS[0].pose, *["state"] * width][: len(recording.values("state")[0])]
    missing = MISSING[column.kind]
    return {
        name: np.array([row[k] if k < len(row) else missing for row in rows], dtype=column.kind)
        for name, k in column.places(states, width).items()
    }


def write(file: Path, columns: Table, recording: Recording) -> None:
    """Write a recording's table, described, in the format of the file's ending; an OptionError if that fails."""
    ids = {title(name): name for name in recording.classes}
    about = {}

    for name in columns:
        c = next(c for c in COLUMNS if re.fullmatch(c.name.replace("_K", r"_\d+").replace(":ID", ":.+"), name))
        about[name] = {"unit": c.unit, "text": c.text}
        if c.name.endswith(":ID"):
            about[name]["class"] = ids[name.partition(":")[2]]
    with replaced(file, "--output") as stream:
        if file.suffix == ".npz":
            notes = json.dumps({"settings": recording.settings, "columns": about})
            arrays: dict[str, Any] = {**columns, "about": np.array(notes)}
            return np.savez_compressed(stream, **arrays)
        import pyarrow as pa
        import pyarrow.parquet as pq

        fields = []
        for name, values in columns.items():
            known = {"description" if key == "text" else key: text for key, text in about[name].items()}
            fields.append(pa.field(name, pa.array(values).type, metadata=known))
        schema = pa.schema(fields, metadata={"pirrht": json.dumps(recording.settings)})
        pq.write_table(pa.table(dict(columns), schema=schema), stream, compression="zstd")
