"""The rows of a sweep's dataset: their columns, and how a run's record becomes a row and a row a record again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim.drive.result import FIGURES, Column

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


def _column(line: str) -> Column:
    name, kind, unit, text = line.split(maxsplit=3)
    return Column(name=name, kind=kind, unit="" if unit == "-" else unit, text=text)


def _columns(table: str) -> tuple[Column, ...]:
    return tuple(_column(line) for line in table.strip().splitlines())


COLUMNS = (*_columns(_TABLE), *FIGURES, *_columns(_MORE))
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
    """What tells a run from all others of its dataset."""
    return tuple(record[name] for name in KEY)
