"""One drive of a sweep as a record, and the plans that drives of one scene share."""

import hashlib
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from typing import Any

import numpy as np

from pirrht.control.settings import TREELESS
from pirrht.errors import PirrhtError, one_line
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
    """One run; runs with equal seeds have equal plant noise, whatever the method."""

    scene: str
    method: str
    noise: float | None  # None: what the scene asks for
    seed: int
    given: Frozen  # scene options and settings that all runs share
    label: str = ""  # what tables call the scene; empty: as `scene`
    digest: str = ""  # of the files of scene and robot; empty: not looked at

    @property
    def place(self) -> tuple[str, Frozen]:
        """Key of runs that share one tree."""
        return self.scene, self.given

    @property
    def point(self) -> tuple[Any, ...]:
        """Key of runs that differ in their seed only; the scene comes first."""
        return self.scene, self.noise, self.method, self.given

    @property
    def needs_tree(self) -> bool:
        """Whether its method drives through a tree."""
        return self.method not in TREELESS

    @property
    def identity(self) -> dict[str, Any]:
        """The part of its record that is the key of a dataset."""
        known = {"scene": self.label or self.scene, "scene_digest": self.digest, "method": self.method}
        return known | {"noise": self.noise, "seed": self.seed, "plan_seed": dict(self.given).get("plan_seed")}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """The tree of a place, or why there is none."""

    tree: bytes | str = b""  # as it is saved, or the file that holds it
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
    return _prepared(*job.place).with_settings(**changes)


def forget() -> None:
    """Files of scenes and robots may have changed: read them anew."""
    for known in (_prepared, digest, _received, _solved):
        known.cache_clear()


def work(task: Task) -> Planned | dict[str, Any]:
    """Grow a tree, or drive and return the record. Errors are results."""
    try:
        with _alone:
            return grown(task.job) if task.grows else drive(task.job, task.planned)
    except PirrhtError as error:
        return given_up(task, " ".join(str(error).split()))
    except Exception as error:
        return given_up(task, one_line(error).removesuffix(":"))


def given_up(task: Task, why: str) -> Planned | dict[str, Any]:
    """Return the result of a task that came to nothing."""
    return Planned(error=why) if task.grows else task.job.identity | {"outcome": None, "error": why}


def drive(job: Job, planned: Planned | None = None) -> dict[str, Any]:
    """One run as a record: what it was, and what came of it. PirrhtError if it is impossible."""
    scenario = settled(job)
    if job.digest and job.digest != digest(*job.place):
        raise PirrhtError(f"{job.scene}: the file is not the one that the sweep began with")
    driver = _driver(job, scenario, planned)
    kind = scenario.loaded.dynamics_name, job.method, job.given
    if kind not in _rehearsed:  # so that no drive has to wait for the compiler
        rehearse(scenario, driving=True)
        _rehearsed.add(kind)
    began = time.perf_counter()
    last = deque(scenario.drive(scenario.plant(), driver), maxlen=1).pop()
    seconds = time.perf_counter() - began
    return finished(job.identity, scenario, last.metrics.json(), seconds, planned or Planned())


def finished(
    identity: Mapping[str, Any], scenario: Scenario, result: Mapping[str, Any], seconds: float, planned: Planned
) -> dict[str, Any]:
    """The record of a run that came to an end, whose drive took `seconds` [s] of wall time."""
    return {
        **identity, "robot": scenario.loaded.robot, "lambda": scenario.problem.temperature,
        **{name: getattr(scenario.settings, name) for name in ("samples", "dt", "period")}, **result,
        "shortest_length": planned.shortest, "plan_seconds": planned.seconds, "drive_seconds": seconds, "error": None,
    }  # fmt: skip


def _driver(job: Job, scenario: Scenario, planned: Planned | None) -> Driver:
    if job.method == "optimal":
        return scenario.driver(truth=_solved(*job.place, scenario.settings.noise))
    if planned is None:
        return scenario.driver()
    if planned.error is not None:
        raise PirrhtError(planned.error)
    return scenario.driver(_received(*job.place, planned.tree))


def grown(job: Job) -> Planned:
    """Grow the tree of a job's place."""
    scenario = settled(job)
    content = BytesIO()
    rehearse(scenario)
    began = time.perf_counter()
    tree = scenario.grown_tree()
    shortest = min((r.length for r in scenario.references(tree, waits=True)), default=None)
    seconds = time.perf_counter() - began
    tree_file.save(tree, content)
    return Planned(tree=content.getvalue(), shortest=shortest, seconds=seconds)


@lru_cache(KEPT)
def _prepared(scene: str, given: Frozen) -> Scenario:
    return prepare(scene, given=dict(given))


@lru_cache(KEPT)
def digest(scene: str, given: Frozen) -> str:
    """Names the content of a place's files of scene and robot, wherever they lie, as this process first read them."""
    scenario = _prepared(scene, given)
    content = hashlib.sha256()
    for file in (scenario.loaded.path, find("robot", dict(given).get("robot") or scenario.loaded.robot)):
        content.update(hashlib.sha256(file.read_bytes()).digest())
    content.update(source(dict(given).get("system")))
    return content.hexdigest()[:16]


@lru_cache(KEPT)
def _received(scene: str, given: Frozen, tree: bytes | str) -> HomologyTree:
    """One tree per scene: it depends neither on noise nor on the method."""
    s = _prepared(scene, given)
    file = tree if isinstance(tree, str) else BytesIO(tree)
    return tree_file.load(file, s.space, s.steering(), classes=s.settings.classes)


@lru_cache(GRIDS)
def _solved(scene: str, given: Frozen, noise: float) -> Any:
    """One grid per scene and noise."""
    return _prepared(scene, given).with_settings(noise=noise).optimal().desirability
