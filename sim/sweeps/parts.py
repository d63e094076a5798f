"""Rows of a dataset, and the files that hold them: whole or absent, whoever else writes next to them."""

import json
import os
import secrets
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pirrht
from pirrht.errors import OptionError
from sim.drive.result import FIGURES, columns
from sim.files import Draft, why_unreadable

TIMING = "timing_"  # begins the names of columns that differ when a run is repeated

_TABLE = """
scene            string  -     name of the scene
scene_digest     string  -     of the content of the files of scene and robot
method           string  -     pi-rrht, single, passive, ...
noise            float64 b     noise level: m/sqrt(s) of a point, rad/sqrt(s) of a car
seed             int64   1     of sampler and plant; runs of equal seeds meet equal plant noise
plan_seed        int64   1     of the tree
robot            string  -     name of the robot
lambda           float64 cost  temperature
samples          int64   1     around each reference
dt               float64 s     rollout step
period           float64 s     control period
"""
_MORE = """
shortest_length  float64 m     shortest reference at the start; null for methods without a tree
error            string  -     why the run did not come to an end, null if it did
timing_step_median_ms  float64 ms  wall time of a plan
timing_step_p95_ms     float64 ms  its 95th percentile
timing_step_max_ms     float64 ms  the longest
timing_deadline_misses int64   1   plans that took longer than the period
timing_plan_seconds    float64 s   wall time of tree and references without compiling; the runs of a scene share it
timing_drive_seconds   float64 s   wall time of the run without compiling
"""
DATASET_FORMAT = 2  # raised when rows of different versions would not be comparable
COLUMNS = (*columns(_TABLE), *FIGURES, *columns(_MORE))
KEY = ("scene", "scene_digest", "method", "noise", "seed", "plan_seed")
RESULTS = tuple(c.name for c in COLUMNS if not c.name.startswith(TIMING))  # equal whenever a run is repeated

_STEPS = {"median": f"{TIMING}step_median_ms", "p95": f"{TIMING}step_p95_ms", "max": f"{TIMING}step_max_ms"}
_TIMES = {f"{TIMING}{name}": name for name in ("deadline_misses", "plan_seconds", "drive_seconds")}


def row_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """A run's record as a row, with null for what it does not know."""
    known = {**record, **{column: record.get(name) for column, name in _TIMES.items()}}
    known |= {column: (record.get("step_ms") or {}).get(name) for name, column in _STEPS.items()}
    return {c.name: known.get(c.name) for c in COLUMNS}


def record_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """The record that a row was made of."""
    record = {name: row[name] for name in RESULTS}
    if row["outcome"] is None:
        return {**{name: row[name] for name in KEY}, "outcome": None, "error": row["error"]}
    record["step_ms"] = {name: row[column] for name, column in _STEPS.items()}
    return record | {name: row[column] for column, name in _TIMES.items()}


def key_of(record: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the key of a run in its dataset."""
    return tuple(record[name] for name in KEY)


def schema() -> Any:
    """The columns of the rows, with their units and descriptions."""
    import pyarrow as pa

    fields = [
        pa.field(c.name, pa.type_for_alias(c.kind), metadata={"unit": c.unit, "description": c.text}) for c in COLUMNS
    ]
    return pa.schema(fields, metadata={"pirrht": json.dumps({"format": DATASET_FORMAT, "version": pirrht.__version__})})


def rows(files: Iterable[Path]) -> list[dict[str, Any]]:
    """The rows of files; OptionError if one cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    found: list[dict[str, Any]] = []
    for file in files:
        try:
            if (why := why_unreadable(file)) is not None:
                raise ValueError(f"it {why}")
            table = pq.read_table(file, schema=schema())
            for name in ("scene", "method", "noise", "seed"):
                if table[name].null_count:
                    raise ValueError(f"it has rows without {name}")
        except (OSError, ValueError, pa.ArrowException) as error:
            reason = " ".join(str(error).split())
            raise OptionError(f"{file} cannot be read ({reason}); remove it, and its runs are made again") from None
        found += table.to_pylist()
    return found


def add(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a file of rows after all that are there: seen whole or not at all, and on disk; its name is no other's."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    taken = [int(file.name[5:11]) for file in folder.glob("part-*.parquet") if file.name[5:11].isdecimal()]
    draft = Draft(folder / f"part-{max(taken, default=-1) + 1:06d}-{secrets.token_hex(4)}.parquet", follow=False)
    try:
        with os.fdopen(draft.handle, "wb") as stream:
            pq.write_table(pa.Table.from_pylist(list(rows), schema=schema()), stream, compression="zstd")
            stream.flush()
            os.fsync(stream.fileno())
        draft.publish()
    finally:
        draft.discard()
