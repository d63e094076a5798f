"""One drive of a sweep as a record, and the plans that drives of one scene share."""

import hashlib
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from pirrht.control.settings import TREELESS
from pirrht.errors import PirrhtError
from pirrht.planner.tree import HomologyTree
from sim import tree_file
from sim.mjcf.library import find
from sim.rehearsal import rehearse
from sim.scenario import Driver, Scenario, prepare
from sim.systems import source

KEPT = 4  # scenes and trees that a process keeps at hand
GRIDS = 1  # likewise; one among bodies that move takes 0.2 GB, and runs come by scene and noise

Frozen = tuple[tuple[str, Any], ...]

_rehearsed: set[tuple[Any, ...]] = set()
_alone = threading.Lock()  # a worker with several threads drives one robot at a time: its time is its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One drive; equal seeds mean equal plant noise whatever the method."""

    scene: str
    method: str
    noise: float | None  # None: what the scene asks for
    seed: int
    task: Frozen  # robot, system, radius, margin, start, goal, preset
    given: Frozen  # settings that all runs share
    label: str = ""  # what tables call the scene; empty: as `scene`
    digest: str = ""  # of the files of scene and robot; empty: not looked at

    @property
    def name(self) -> str:
        """The scene's name in tables."""
        return self.label or self.scene

    @property
    def place(self) -> tuple[Any, ...]:
        """Key of runs that share one tree."""
        return self.scene, self.task, self.given

    @property
    def point(self) -> tuple[Any, ...]:
        """Key of runs that differ in their seed only; the scene comes first."""
        return self.scene, self.noise, self.method, self.task, self.given


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """The tree of a place, or why there is none."""

    place: tuple[Any, ...] = ()
    tree: bytes | str = b""  # packed, or the file that holds it
    shortest: float | None = None  # length of the shortest reference at the start [m]
    seconds: float | None = None  # wall time of tree and references
    error: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Task:
    """A drive with the tree that it needs, if it needs one; or the tree of a job's place."""

    job: Job
    planned: Planned | None = None
    grows: bool = False

    @property
    def point(self) -> tuple[Any, ...]:
        """Key of tasks that a process had better do one after the other."""
        return self.job.place if self.grows else self.job.point


def frozen(values: Mapping[str, Any]) -> Frozen:
    """Return arguments as they can be hashed."""
    return tuple((name, tuple(v) if isinstance(v, list | np.ndarray) else v) for name, v in values.items())


def settled(job: Job) -> Scenario:
    """The scenario of a job; PirrhtError if a scene or a setting is wrong."""
    # Drives share a tree, so it does not grow; and cores, so none is against the clock.
    changes: dict[str, Any] = {"method": job.method, "seed": job.seed, "threads": 1, "grow": None, "real_time": False}
    if job.noise is not None:
        changes["noise"] = job.noise
    return _prepared(job.scene, job.task, job.given).with_settings(**changes)


def digest(job: Job) -> str:
    """Names the content of the files of scene and robot, wherever they lie, as this process first read them."""
    return _digest(job.scene, job.task, job.given)


def forget() -> None:
    """Files of scenes and robots may have changed: read them anew."""
    for known in (_prepared, _digest, _received, _solved):
        known.cache_clear()


def work(task: Task) -> Planned | dict[str, Any]:
    """Grow a tree, or drive and return the record. Errors are results."""
    try:
        with _alone:
            return grown(task.job) if task.grows else drive(task.job, task.planned)
    except Exception as error:
        return given_up(task, one_line(error))


def given_up(task: Task, why: str) -> Planned | dict[str, Any]:
    """Return the result of a task that came to nothing."""
    return Planned(place=task.job.place, error=why) if task.grows else failure(task.job, why)


def drive(job: Job, planned: Planned | None = None) -> dict[str, Any]:
    """One run as a record: what it was, and what came of it. PirrhtError if it is impossible."""
    scenario = settled(job)
    if job.digest and job.digest != digest(job):
        raise PirrhtError(f"{job.scene}: the file is not the one that the sweep began with")
    driver = _driver(job, scenario, planned)
    _ready(job, scenario)
    began = time.perf_counter()
    last = deque(scenario.drive(scenario.plant(), driver), maxlen=1).pop()
    seconds = time.perf_counter() - began
    return finished(key(job, scenario.settings.noise), scenario, last.metrics.json(), seconds, planned)


def finished(
    identity: Mapping[str, Any],
    scenario: Scenario,
    result: Mapping[str, Any],
    seconds: float,
    planned: Planned | None = None,
) -> dict[str, Any]:
    """The record of a run that came to an end, whose drive took `seconds` [s] of wall time."""
    return {
        **identity,
        "robot": scenario.loaded.robot,
        "lambda": scenario.problem.temperature,
        "samples": scenario.settings.samples,
        "dt": scenario.settings.dt,
        "period": scenario.settings.period,
        **result,
        "shortest_length": planned.shortest if planned else None,
        "plan_seconds": planned.seconds if planned else None,
        "drive_seconds": seconds,
        "error": None,
    }


def failure(job: Job, error: str) -> dict[str, Any]:
    """The record of a run that did not come to an end."""
    return {**key(job, job.noise), "outcome": None, "error": error}


def one_line(error: BaseException) -> str:
    """Kind and message of an error."""
    text = " ".join(str(error).split())
    return text if isinstance(error, PirrhtError) else f"{type(error).__name__}: {text}".removesuffix(": ")


def needs_tree(job: Job) -> bool:
    """Return whether a job's method drives through a tree."""
    return job.method not in TREELESS


def unpacked(planned: Planned, folder: Path, number: int) -> Planned:
    """Put the tree of a plan into a file, for processes of this machine; keep it if there is no room for one."""
    if not planned.tree or isinstance(planned.tree, str):
        return planned
    file = folder / f"{number}.tree"
    try:
        file.write_bytes(planned.tree)
    except OSError:
        return planned
    return replace(planned, tree=str(file))


def _driver(job: Job, scenario: Scenario, planned: Planned | None) -> Driver:
    if job.method == "optimal":
        return scenario.driver(truth=_solved(job.scene, job.task, job.given, scenario.settings.noise))
    if planned is None:
        return scenario.driver()
    if planned.error is not None:
        raise PirrhtError(planned.error)
    return scenario.driver(_received(job.scene, job.task, job.given, planned.tree))


def grown(job: Job) -> Planned:
    """Grow the tree of a job's place."""
    scenario = settled(job)
    rehearse(scenario)
    began = time.perf_counter()
    tree = scenario.grown_tree()
    shortest = min((r.length for r in scenario.references(tree, waits=True)), default=None)
    seconds = time.perf_counter() - began
    return Planned(place=job.place, tree=pack(tree), shortest=shortest, seconds=seconds)


def pack(tree: HomologyTree) -> bytes:
    """A grown tree without the scene around it."""
    content = BytesIO()
    tree_file.save(tree, content)
    return content.getvalue()


def unpack(scenario: Scenario, content: bytes) -> HomologyTree:
    """The tree as it was packed, in the same scenario."""
    return tree_file.load(BytesIO(content), scenario.space, scenario.steering(), classes=scenario.settings.classes)


def key(job: Job, noise: float | None) -> dict[str, Any]:
    """Return the key of a job's run in its dataset."""
    return {
        "scene": job.name,
        "scene_digest": job.digest,
        "method": job.method,
        "noise": noise,
        "seed": job.seed,
        "plan_seed": dict(job.given).get("plan_seed"),
    }


@lru_cache(KEPT)
def _prepared(scene: str, task: Frozen, given: Frozen) -> Scenario:
    return prepare(scene, **dict(task), given=dict(given))


def _ready(job: Job, scenario: Scenario) -> None:
    """See to it that a drive does not have to wait for the compiler; once per kind of drive and process."""
    kind = scenario.loaded.dynamics_name, job.method, job.given
    if kind not in _rehearsed:
        rehearse(scenario, driving=True)
        _rehearsed.add(kind)


@lru_cache(KEPT)
def _digest(scene: str, task: Frozen, given: Frozen) -> str:
    scenario = _prepared(scene, task, given)
    content = hashlib.sha256()
    for file in (scenario.loaded.path, find("robot", dict(task).get("robot") or scenario.loaded.robot)):
        content.update(hashlib.sha256(file.read_bytes()).digest())
    content.update(source(dict(task).get("system")))
    return content.hexdigest()[:16]


@lru_cache(KEPT)
def _received(scene: str, task: Frozen, given: Frozen, tree: bytes | str) -> HomologyTree:
    """One tree per scene: it depends neither on noise nor on the method."""
    content = tree if isinstance(tree, bytes) else Path(tree).read_bytes()
    return unpack(_prepared(scene, task, given), content)


@lru_cache(GRIDS)
def _solved(scene: str, task: Frozen, given: Frozen, noise: float) -> Any:
    """One grid per scene and noise."""
    return _prepared(scene, task, given).with_settings(noise=noise).optimal().desirability
