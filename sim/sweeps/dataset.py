"""A sweep on disk: `manifest.json` says what was asked for, `runs/part-*.parquet` hold a row per finished run.

Each file is whole or absent (`sim.sweeps.parts`); of a run that is in several the last counts.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import Any

import pirrht
from pirrht.errors import OptionError
from sim.files import MISSING, path_text, refused, replaced, why_unreadable
from sim.sweeps import parts
from sim.sweeps.parts import key_of, record_of, row_of

TREES = ".trees-"  # begins the names of folders that trees lie in while they are driven through
CHUNK_RUNS, CHUNK_SECONDS = 500, 2.0  # a file is written after so many runs, or so long after the file before [s]
MOST = 10_000_000  # seeds of a wish
MOST_POINTS = 1_000_000  # combinations of scene, noise and method of all wishes: some hundred megabytes
LIBRARIES = ("mujoco", "numpy", "numba", "scipy", "python-fcl")


class Dataset:
    """The folder of a sweep.

    Args:
        folder: need not exist before `begin`.
        now: monotonic time [s].
    """

    def __init__(self, folder: Path, now: Callable[[], float] = time.monotonic) -> None:
        self.folder, self.runs, self._now = folder, folder / "runs", now
        self._kept: list[dict[str, Any]] = []  # rows that are in no file yet
        self._tried = now()  # when they were last written
        self.failing = False  # whether that went wrong

    def manifest(self) -> dict[str, Any]:
        """Read the manifest of the sweep.

        Raises:
            OptionError: the folder holds none, or it cannot be read.
        """
        if self.folder.is_file():
            raise OptionError(f"{self.folder} is a file; give the folder of `pirrht sweep -o`")
        file = self.folder / "manifest.json"
        try:
            why = why_unreadable(file)
            if why not in (None, MISSING):
                raise OptionError(f"{file}: {why}; remove it and start the sweep again")
            found = json.loads(file.read_text())
        except FileNotFoundError:
            raise OptionError(
                f"{self.folder} is no sweep: it has no manifest.json; give the folder of `pirrht sweep -o`"
            ) from None
        except (OSError, ValueError, RecursionError) as error:
            raise OptionError(f"{file}: cannot be read ({error}); remove it and start the sweep again") from None
        if not isinstance(found, dict) or found.get("format") != parts.DATASET_FORMAT:
            theirs = found.get("format") if isinstance(found, dict) else None
            raise OptionError(
                f"{file}: dataset format {theirs}; pirrht {pirrht.__version__} reads format {parts.DATASET_FORMAT}: "
                "choose another folder"
            )
        flaw = _flaw(found)
        if flaw is not None:
            why = f'"{flaw}" is not what a sweep writes'
            raise OptionError(f"{file} is damaged: {why}; put a copy back, or choose another folder")
        return found

    def check(self, settings: Mapping[str, Any], scenes: Mapping[str, str]) -> None:
        """Refuse what does not belong to the runs that are there already, by OptionError with the first difference."""
        try:
            if not stat.S_ISDIR(os.stat(self.folder).st_mode):
                raise OptionError(f"--output {path_text(self.folder)} is a file; give the path of a folder")
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:  # ValueError: a name that is none
            raise refused("--output", self.folder, error) from None
        if not (self.folder / "manifest.json").exists():
            strange = [file.name for file in self.folder.glob("[!.]*") if file != self.runs] or self.files()
            if strange:
                raise self._other(f"holds {strange[0]} and no manifest.json, so it is no sweep's")
            return
        known, asked = self.manifest(), plain(settings)
        for name in {**known["settings"], **asked}:
            before, now = known["settings"].get(name), asked.get(name)
            if before != now:
                raise self._other(f"was made {_option(name, before)} and this sweep is {_option(name, now)}")
        for name, digest in scenes.items():
            if known["scenes"].get(name, digest) != digest:
                raise self._other(f"was made with another {name}: the files of scene or robot have changed since")

    def begin(self, settings: Mapping[str, Any], scenes: Mapping[str, str], *asked: Mapping[str, Any]) -> None:
        """Make the folder, or add to what one was asked for; what a killed sweep left half-written goes.

        Raises:
            OptionError: another sweep's folder, or one that cannot be written.
        """
        self.check(settings, scenes)
        known = self.manifest() if (self.folder / "manifest.json").exists() else {}
        everything = [*known.get("asked", []), *map(plain, asked)]
        content = {
            "format": parts.DATASET_FORMAT,
            "version": pirrht.__version__,
            "libraries": {name: _version(name) for name in LIBRARIES},
            "settings": plain(settings),
            "scenes": {**known.get("scenes", {}), **scenes},
            "asked": [wish for i, wish in enumerate(everything) if wish not in everything[:i]],
        }
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            for left in (*self.runs.glob(".part-*"), *self.folder.glob(".manifest*")):
                left.unlink()
            for left in self.folder.glob(f"{TREES}*"):
                shutil.rmtree(left, ignore_errors=True)
        except OSError as error:
            raise refused("--output", self.folder, error) from None
        with replaced(self.folder / "manifest.json", "--output") as stream:
            stream.write((json.dumps(content, indent=2) + "\n").encode())
            stream.flush()
            os.fsync(stream.fileno())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other sweeps out of the folder by OptionError; a process that is killed keeps nobody out."""
        try:
            import fcntl
        except ImportError:  # no such locks on this system
            yield
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = self.folder / ".lock"
            why = why_unreadable(lock)
            if why not in (None, MISSING):
                raise OptionError(f"{lock} {why}; remove it, or choose another folder")
            stream = lock.open("a")
        except OSError as error:
            raise refused("--output", self.folder, error) from None
        with stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise OptionError(
                    f"--output {self.folder}: another sweep is writing there; wait for it or choose another folder"
                ) from None
            yield

    def files(self) -> list[Path]:
        """The files of rows, oldest first."""
        return sorted(self.runs.glob("part-*.parquet"))

    def records(self) -> list[dict[str, Any]]:
        """Every finished run once, in the order of the files; OptionError if one cannot be read."""
        rows = (row for file in self.files() for row in parts.read(file).to_pylist())
        return [record_of(row) for row in {key_of(row): row for row in rows}.values()]

    def compact(self) -> None:
        """Write what has been added; rewrite all rows as one file if a run is there twice."""
        self.flush()
        files = self.files()
        rows = [row for file in files for row in parts.read(file).to_pylist()]
        known = {key_of(row): row for row in rows}
        if len(known) < len(rows):
            try:
                parts.add(self.runs, list(known.values()))
                for file in files:
                    file.unlink()
            except OSError as error:
                raise refused("--output", self.folder, error) from None

    def add(self, record: Mapping[str, Any]) -> None:
        """Take a finished run in; it is written when `tend` or `flush` is called."""
        self._kept.append(row_of(record))

    def tend(self) -> None:
        """Write what has waited long enough; what cannot be written is kept for the next time."""
        if (len(self._kept) >= CHUNK_RUNS and not self.failing) or self._now() - self._tried >= CHUNK_SECONDS:
            try:
                self.flush()
            except OptionError:
                self.failing = True

    def flush(self) -> None:
        """Write all finished runs that are in no file yet; OptionError if they cannot be, and are kept."""
        if not self._kept:
            return
        self._tried = self._now()
        try:
            parts.add(self.runs, self._kept)
        except OSError as error:
            raise OptionError(
                f"--output {self.folder}: {error.strerror or error}; {len(self._kept)} finished runs could not be "
                "written: fix that and give the same command again"
            ) from None
        self._kept, self.failing = [], False

    def _other(self, difference: str) -> OptionError:
        return OptionError(f"--output {self.folder} {difference}; choose another folder")


def plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping as JSON gives it back, without what was not said."""
    known: dict[str, Any] = json.loads(json.dumps({k: v for k, v in value.items() if v is not None}))
    return known


def _option(name: str, value: Any) -> str:
    option = f"--{name.replace('_', '-')}"
    if value is None:
        return f"without {option}"
    return f"with {option} {' '.join(map(str, value)) if isinstance(value, list) else value}"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def wished(asked: Iterable[Mapping[str, Any]]) -> int:
    """Count the different runs that the wishes of a manifest add up to."""
    stretches: dict[tuple[str, float, str], list[list[int]]] = {}
    for wish in asked:
        for scene, noises in wish["noise"].items():
            for point in product([scene], set(noises), set(wish["methods"])):
                stretches.setdefault(point, []).append(wish["seeds"])
    total = 0
    for known in stretches.values():
        reached = 0
        for first, end in sorted(known):
            total += max(0, end - max(first, reached))
            reached = max(reached, end)
    return total


def _flaw(manifest: Mapping[str, Any]) -> str | None:
    """Name the first part of a manifest that is not what a sweep writes."""

    def fits(name: str, found: Any) -> bool:
        if name == "version":
            return isinstance(found, str)
        if name == "asked":
            return isinstance(found, list) and all(map(_is_wish, found)) and sum(map(_points, found)) <= MOST_POINTS
        return isinstance(found, dict) and (name == "settings" or _all([*found.values()], str))

    names = ("version", "settings", "scenes", "libraries", "asked")
    return next((name for name in names if not fits(name, manifest.get(name))), None)


def _points(wish: Mapping[str, Any]) -> int:
    return len(wish["methods"]) * sum(map(len, wish["noise"].values()))


def _is_wish(wish: Any) -> bool:
    if not isinstance(wish, dict) or not isinstance(wish.get("noise"), dict):
        return False
    seeds: Any = wish.get("seeds")
    return (
        _all(wish.get("methods"), str)
        and all(_all(values, (int, float)) for values in wish["noise"].values())
        and (_all(seeds, int) and len(seeds) == 2 and 0 <= seeds[0] <= seeds[1] <= seeds[0] + MOST)
    )


def _all(values: Any, kind: Any) -> bool:
    return isinstance(values, list) and all(isinstance(v, kind) and not isinstance(v, bool) for v in values)
