"""A sweep on disk: `manifest.json` says what was asked for, `runs/part-*.parquet` hold a row per finished run.

Each file is whole or absent (`sim.sweeps.parts`); of a run that is in several the last counts.
"""

import fcntl
import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path
from typing import Any

import pirrht
from pirrht.errors import OptionError
from sim.files import MISSING, path_text, refused, replaced, why_unreadable
from sim.sweeps import parts

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
        self.folder = folder
        self.file = folder / "manifest.json"
        self.runs = folder / "runs"
        self._now = now

        self._kept: list[dict[str, Any]] = []  # rows that are in no file yet
        self._tried = now()  # when they were last written
        self._failing = False  # whether that went wrong

    def manifest(self) -> dict[str, Any]:
        """Read the manifest of the sweep.

        Raises:
            OptionError: the folder holds none, or it cannot be read.
        """
        why = why_unreadable(self.file)
        if why == MISSING:
            what = "a file" if self.folder.is_file() else "no sweep: it has no manifest.json"
            raise OptionError(f"{self.folder} is {what}; give the folder of `pirrht sweep -o`")
        try:
            found: Any = json.loads(self.file.read_text()) if why is None else None
        except (OSError, ValueError, RecursionError) as error:
            why = f"cannot be read ({error})"
        if why is not None:
            raise OptionError(f"{self.file}: {why}; remove it and start the sweep again")
        theirs = found.get("format") if isinstance(found, dict) else None
        if theirs != parts.DATASET_FORMAT:
            ours = f"pirrht {pirrht.__version__} reads format {parts.DATASET_FORMAT}"
            raise OptionError(f"{self.file}: dataset format {theirs}; {ours}: choose another folder")
        if (flaw := _flaw(found)) is not None:
            why = f'"{flaw}" is not what a sweep writes'
            raise OptionError(f"{self.file} is damaged: {why}; put a copy back, or choose another folder")
        return dict(found)

    def check(self, settings: Mapping[str, Any], scenes: Mapping[str, str]) -> dict[str, Any]:
        """Return the manifest, empty if there is no sweep yet.

        Raises:
            OptionError: what is asked for does not belong to the runs that are there; names the first difference.
        """
        try:
            if self.folder.exists() and not self.folder.is_dir():
                raise OptionError(f"--output {path_text(self.folder)} is a file; give the path of a folder")
            if self.runs.is_symlink():
                raise self._other("has a link where its folder runs should be, and a sweep writes through none")
            if not self.file.exists():
                strange = [file.name for file in self.folder.glob("[!.]*") if file != self.runs] or self.files()
                if strange:
                    raise self._other(f"holds {strange[0]} and no manifest.json, so it is no sweep's")
                return {}
        except (OSError, ValueError) as error:  # ValueError: a name that is none
            raise refused("--output", self.folder, error) from None
        known = self.manifest()
        asked = plain(settings)

        for name in {**known["settings"], **asked}:
            before = known["settings"].get(name)
            now = asked.get(name)

            if before != now:
                raise self._other(f"was made {_option(name, before)} and this sweep is {_option(name, now)}")
        for name, digest in scenes.items():
            if known["scenes"].get(name, digest) != digest:
                raise self._other(f"was made with another {name}: the files of scene or robot have changed since")
        return known

    def begin(self, settings: Mapping[str, Any], scenes: Mapping[str, str], *asked: Mapping[str, Any]) -> None:
        """Make the folder, or add to what one was asked for; what a killed sweep left half-written goes.

        Raises:
            OptionError: another sweep's folder, or one that cannot be written.
        """
        known = self.check(settings, scenes)
        libraries = dict.fromkeys(LIBRARIES, "unknown")
        for name in LIBRARIES:
            with suppress(PackageNotFoundError):
                libraries[name] = version(name)
        everything = [*known.get("asked", []), *map(plain, asked)]
        content = {
            "format": parts.DATASET_FORMAT,
            "version": pirrht.__version__,
            "libraries": libraries,
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
        with replaced(self.file, "--output", follow=False) as stream:
            stream.write((json.dumps(content, indent=2) + "\n").encode())
            stream.flush()
            os.fsync(stream.fileno())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other sweeps out of the folder by OptionError; a process that is killed keeps nobody out."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            stream = os.fdopen(os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "r+b")
        except (OSError, ValueError) as error:
            raise refused("--output", self.folder, error) from None
        with stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                why = "another sweep is writing there; wait for it or choose another folder"
                raise OptionError(f"--output {self.folder}: {why}") from None
            yield

    def files(self) -> list[Path]:
        """The files of rows, oldest first."""
        return sorted(self.runs.glob("part-*.parquet"))

    def records(self) -> list[dict[str, Any]]:
        """Every finished run once, in the order of the files; OptionError if one cannot be read."""
        return [parts.record_of(row) for row in {parts.key_of(row): row for row in parts.rows(self.files())}.values()]

    def compact(self) -> None:
        """Write what has been added; rewrite all rows as one file if a run is there twice."""
        self.flush()
        files = self.files()
        rows = parts.rows(files)
        known = {parts.key_of(row): row for row in rows}
        if len(known) < len(rows):
            try:
                parts.add(self.runs, list(known.values()))
                for file in files:
                    file.unlink()
            except OSError as error:
                raise refused("--output", self.folder, error) from None

    def add(self, record: Mapping[str, Any] | None = None) -> bool:
        """Take in a finished run, if there is one, and write rows that have waited long enough.

        Returns:
            whether that has begun to go wrong; what cannot be written is kept for the next time.
        """
        if record is not None:
            self._kept.append(parts.row_of(record))
        before = self._failing
        if (len(self._kept) >= CHUNK_RUNS and not before) or self._now() - self._tried >= CHUNK_SECONDS:
            with suppress(OptionError):
                self.flush()
        return self._failing and not before

    def flush(self) -> None:
        """Write all finished runs that are in no file yet; OptionError if they cannot be, and are kept."""
        if not self._kept:
            return
        self._tried = self._now()
        try:
            parts.add(self.runs, self._kept)
        except OSError as error:
            self._failing = True
            waits = f"{len(self._kept)} finished runs could not be written: fix that and give the same command again"
            raise OptionError(f"--output {self.folder}: {error.strerror or error}; {waits}") from None
        self._kept, self._failing = [], False

    def _other(self, difference: str) -> OptionError:
        return OptionError(f"--output {self.folder} {difference}; choose another folder")


def plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping as JSON reads it back, without values that are None."""
    known: dict[str, Any] = json.loads(json.dumps({k: v for k, v in value.items() if v is not None}))
    return known


def _option(name: str, value: Any) -> str:
    option = f"--{name.replace('_', '-')}"
    if value is None:
        return f"without {option}"
    return f"with {option} {' '.join(map(str, value)) if isinstance(value, list) else value}"


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
    kinds: dict[str, Any] = {"version": str, "settings": dict, "scenes": dict, "libraries": dict, "asked": list}
    for name, kind in kinds.items():
        found = manifest.get(name)
        if not isinstance(found, kind) or (name in ("scenes", "libraries") and not _all([*found.values()], str)):
            return name
    points = (len(wish["methods"]) * sum(map(len, wish["noise"].values())) for wish in manifest["asked"])
    return None if all(map(_is_wish, manifest["asked"])) and sum(points) <= MOST_POINTS else "asked"


def _is_wish(wish: Any) -> bool:
    match wish:
        case {"methods": methods, "noise": dict(noises), "seeds": [int(first), int(end)]} if _all(methods, str):
            return 0 <= first <= end <= first + MOST and all(_all(known, (int, float)) for known in noises.values())
    return False


def _all(values: Any, kind: Any) -> bool:
    return isinstance(values, list) and all(isinstance(v, kind) and not isinstance(v, bool) for v in values)
