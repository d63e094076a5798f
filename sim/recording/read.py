"""Recordings read back: the rows that `components.columns` wrote, whether it is whole or breaks off."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from pirrht.errors import OptionError
from pirrht.files import shown
from sim.files import checked_name
from sim.recording.columns import CLASSES

STEPS, TIMING, SETTINGS = "/steps", "/timing/plan", "/__properties/run"

Cells = dict[str, list[Any]]  # values by the name of their component


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """What a recording holds of a drive in numbers."""

    settings: dict[str, Any]  # what the drive was made with
    steps: list[tuple[int, float, Cells]]  # number, simulated time [s] and values of each control step, in order
    plan_ms: dict[int, float]  # wall time of a step's plan [ms]

    @property
    def classes(self) -> list[str]:
        """Ids of the classes that were ever known, in order of their appearance."""
        return list(dict.fromkeys(name for _, _, row in self.steps for name in row.get(CLASSES.component) or ()))

    @property
    def whole(self) -> bool:
        """Whether the drive was recorded to its end."""
        return bool(self.steps[-1][2].get("outcome"))


def read(file: Path) -> Recording:
    """Read a recording.

    Raises:
        OptionError: the file is not there, is no recording, or holds no drive or several.
    """
    _check_readable(file)
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
        for step, time, cells in _rows(table):
            if "Scalars:scalars" in cells:
                plan_ms[step] = cells["Scalars:scalars"][0]
            elif chunk.entity_path == TIMING:
                early[step] = time, cells
            elif written.setdefault(step, (time, cells))[1] is not cells:
                raise OptionError(f"{file}: holds more than one drive; export the recordings that it was merged from")
    known = {**early, **written}
    if not known:
        raise OptionError(f"{file}: holds no control steps; name a recording made by `pirrht run --record`")
    return Recording(settings=settings, steps=[(step, *known[step]) for step in sorted(known)], plan_ms=plan_ms)


def _check_readable(file: Path) -> None:
    found = checked_name(file, "recording")
    if found is None:
        raise OptionError(f"{shown(file)}: no such file; name a recording, FILE.rrd")
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "not a file"
        raise OptionError(f"{shown(file)}: {what}; name a recording, FILE.rrd")
    if not os.access(file, os.R_OK):
        raise OptionError(f"{shown(file)} may not be read; mend its permissions")


def _rows(table: Cells) -> Iterator[tuple[int, float, Cells]]:
    for i, step in enumerate(table["step"]):
        cells = {name: values[i] for name, values in table.items() if isinstance(values[i], list)}
        yield step, table["sim_time"][i].total_seconds(), cells


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
