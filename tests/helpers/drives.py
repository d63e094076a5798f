"""A drive to record, and recordings read back."""

import os
import subprocess
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rerun.chunk import RrdReader
from trees import grown

from pirrht import Controller, FreeSpace, Problem, Sampling, SingleIntegrator, StraightLine
from pirrht.steering.in_time import InTime
from sim.drive.episode import run
from sim.drive.executor import Executor
from sim.drive.metrics import Frame
from sim.mjcf import load
from sim.recording.recorder import Look, Recorder, Sinks

PERIOD, MAX_TIME = 0.01, 0.5


class Drive:
    """The slit under noise, with everything a recorder wants to know; the same every time."""

    def __init__(
        self, scene: Path | str = "slit", b: float = 0.3, limit: float = 0.6, vertices: int = 200, samples: int = 60
    ) -> None:
        self.loaded = load(scene)
        self.scene = self.loaded.scene
        self.space = FreeSpace.of(self.scene)
        problem = Problem(dynamics=SingleIntegrator(b=b), scene=self.scene, R=2 * np.eye(2))
        steering = InTime.of(problem) if self.scene.movers else StraightLine()
        self.tree = grown(self.space, steering, vertices, limit=limit)
        sampling, period = Sampling(samples=samples), 2 * PERIOD if self.scene.movers else PERIOD
        self.controller = Controller(problem, self.space, self.tree, sampling, rng=np.random.default_rng(0))
        self.plant = Executor(self.loaded, problem, period=period)
        self.plant_rng = np.random.default_rng(0)

    def recorder(self, file: Path | None = None, connect: str | None = None, **look) -> Recorder:
        settings = {"scene": "slit", "seed": 0, "noise": 0.3, "method": "pi-rrht"}
        sinks = Sinks(file=file, connect=connect)
        return Recorder(self.loaded, self.tree, self.controller.path_integral, sinks, Look(**look), settings=settings)

    def frames(self, max_time: float = MAX_TIME, **more) -> Iterator[Frame]:
        return run(self.plant, self.controller, self.scene.start, self.plant_rng, max_time=max_time, **more)


class Moving(Drive):
    """A scene with bodies that move, planned in with few vertices and samples."""

    def __init__(self, scene: Path | str, *, vertices: int = 5, samples: int = 20) -> None:
        super().__init__(scene, 0.1, 0.8, vertices, samples)


def timed(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Frames while the writer's clock shows their time: into how many chunks it cuts does not depend on the machine."""
    now = 0.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.recording.writer.time", SimpleNamespace(monotonic=lambda: now))
        for frame in frames:
            now = frame.end_time
            yield frame


def logged(recorder: Recorder, frames: Iterable[Frame]) -> list[Frame]:
    """Frames, each of which is recorded when it is there."""
    with recorder:
        found = []
        for frame in timed(frames):
            recorder.log(frame)
            found.append(frame)
    return found


def record(file: Path) -> tuple[list[Frame], list[str]]:
    drive = Drive()
    frames = logged(drive.recorder(file), drive.frames())
    return frames, [frame.news for frame in frames if frame.news]


def columns(file: Path) -> dict[str, dict[str, list]]:
    """All temporal rows by entity and column, in the order of the file."""
    table: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without footer is what one of the tests is about
        for chunk in RrdReader(str(file)).stream():
            if not chunk.is_static:
                batch = chunk.to_record_batch()
                for name in batch.schema.names:
                    table[chunk.entity_path][name] += batch.column(name).to_pylist()
    return table


def static(file: Path, path: str, column: str) -> list:
    """What is recorded once of an entity."""
    for chunk in RrdReader(str(file)).stream():
        batch = chunk.to_record_batch()
        if chunk.is_static and chunk.entity_path == path and column in batch.schema.names:
            return batch.column(column).to_pylist()[0]
    raise AssertionError(path)


def rerun(*arguments: str | Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "rerun", *map(str, arguments)]
    return subprocess.run(command, env={**os.environ, "CI": "1"}, capture_output=True, text=True, timeout=60)
