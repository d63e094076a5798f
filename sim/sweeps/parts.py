"""Rows of a dataset, and the files that hold them: whole or absent, whoever else writes next to them.

A file is written next to its place, forced to disk and then given its name.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pirrht
from pirrht.errors import OptionError
from sim.drive.result import FIGURES, columns
from sim.files import why_unreadable

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
timing_drive_seconds   float64 s   wall time of the drive without compiling
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


def read(file: Path) -> Any:
    """The table of a file; OptionError if it cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    why = why_unreadable(file)
    if why is not None:
        raise _unreadable(file, f"it {why}")
    try:
        table = pq.read_table(file, schema=schema())
    except (OSError, pa.ArrowException) as error:
        raise _unreadable(file, " ".join(str(error).split())) from None
    empty = [name for name in ("scene", "method", "noise", "seed") if table[name].null_count]
    if empty:
        raise _unreadable(file, f"it has rows without {empty[0]}")
    return table


def _unreadable(file: Path, reason: str) -> OptionError:
    return OptionError(f"{file} cannot be read ({reason}); remove it, and its runs are made again")


def parquet(table: Any) -> Callable[[Any], object]:
    """Return what writes a table to a stream."""
    import pyarrow.parquet as pq

    return lambda stream: pq.write_table(table, stream, compression="zstd")


def add(folder: Path, write: Callable[[Any], object]) -> None:
    """Write another file of rows, under a number that no file has, whoever else writes there."""
    with _whole(folder, ".part-", write) as part:
        taken = (file.stem.removeprefix("part-") for file in folder.glob("part-*.parquet"))
        number = 1 + max((int(text) for text in taken if text.isdecimal()), default=-1)
        while not _linked(part, folder / f"part-{number:06d}.parquet"):
            number += 1


def _linked(part: Path, file: Path) -> bool:
    """Give a file its name, unless another has it."""
    try:
        os.link(part, file)
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links
        if file.exists():
            return False
        os.replace(part, file)
    return True


def replace(file: Path, write: Callable[[Any], object]) -> None:
    """Write a file so that it is whole whenever it is seen, even after a loss of power."""
    with _whole(file.parent, f".{file.name}-", write) as part:
        os.replace(part, file)


@contextmanager
def _whole(folder: Path, prefix: str, write: Callable[[Any], object]) -> Iterator[Path]:
    """A new file in a folder, forced to disk; it is gone afterwards unless it got another name."""
    part = folder / f"{prefix}{os.getpid()}-{secrets.token_hex(4)}"
    try:
        with part.open("xb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        yield part
    finally:
        with suppress(OSError):
            part.unlink()
    with suppress(OSError):  # not every file system lets a folder be forced to disk
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
