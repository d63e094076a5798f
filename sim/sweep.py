"""Every combination of scene, method, noise and seed as one drive, on all cores."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from tqdm import tqdm

from pirrht.desirability import Desirability
from pirrht.errors import OptionError
from pirrht.methods import METHODS, TREELESS
from pirrht.tree import HomologyTree
from sim import episode, present
from sim.colors import title
from sim.scenarios import Scenario, prepare


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One drive; equal seeds mean equal plant noise whatever the method."""

    scene: str
    method: str
    noise: float | None  # None: what the scene asks for
    seed: int
    task: tuple[tuple[str, Any], ...]  # robot, radius, start, goal, preset
    given: tuple[tuple[str, Any], ...]  # settings that all runs share

    @property
    def point(self) -> tuple[Any, ...]:
        """What runs share that differ in their seed only."""
        return self.scene, self.noise, self.method


def parse_grid(arguments: argparse.Namespace) -> list[Job]:
    """The runs a command line asks for.

    Raises:
        OptionError: an unknown method, or seeds or noise that are no numbers.
    """
    from sim.commands import given

    methods = [m.strip() for m in arguments.methods.split(",")]
    for method in methods:
        if method not in METHODS:
            raise OptionError(f"--methods names {method!r}; known are {', '.join(METHODS)}")
    noises: list[float | None] = [None]
    if arguments.noise:
        noises = list(_numbers("--noise", arguments.noise.split(",")))
    seeds = _seeds(arguments.seeds)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise OptionError(f"--jobs is {arguments.jobs}; it must be at least 1")
    task = {name: getattr(arguments, name) for name in ("robot", "radius", "start", "goal", "preset")}
    shared = {k: v for k, v in given(arguments).items() if k not in ("methods", "noise", "seeds", "jobs")}
    frozen = tuple((k, tuple(v) if isinstance(v, list) else v) for k, v in task.items())
    return [
        Job(scene=scene, method=method, noise=noise, seed=seed, task=frozen, given=tuple(shared.items()))
        for scene in arguments.scenes
        for noise in noises
        for method in methods
        for seed in seeds
    ]


def sweep(jobs: Sequence[Job], *, jobs_at_once: int | None = None) -> list[dict[str, Any]]:
    """Run them all; one record each, in the order asked for.

    Raises:
        PirrhtError: a scene or a setting is wrong; all are checked before the first drive.
    """
    for first in {job.point: job for job in jobs}.values():
        scenario = _settled(first)
        if first.method == "optimal":
            Desirability.spacing_for(scenario.problem, scenario.space)
    workers = jobs_at_once or len(os.sched_getaffinity(0))
    with tqdm(total=len(jobs), desc="sweep", unit=" runs", disable=None) as bar:
        return [_ticked(bar, row) for row in _results(jobs, min(workers, len(jobs)))]


def drive(job: Job) -> dict[str, Any]:
    """One run as a record: what it was, and what came of it."""
    scenario = _settled(job)
    planned = _planned(job.scene, job.task, job.given) if job.method not in TREELESS else None
    controller: episode.Driver
    if job.method == "optimal":
        controller = scenario.optimal(_solved(job.scene, job.task, job.given, scenario.settings.noise))
    else:
        controller = scenario.controller(planned.tree if planned else None)
    tally = episode.Tally(scenario.settings.period)
    plant = scenario.plant()
    for frame in episode.run(
        plant, controller, scenario.start, scenario.plant_rng(), max_time=scenario.settings.max_time
    ):
        tally.add(frame)
    return {
        "scene": job.scene,
        "method": job.method,
        "noise": scenario.settings.noise,
        "seed": job.seed,
        **tally.result(),
        "shortest_length": planned.shortest if planned else None,
        "plan_seconds": planned.seconds if planned else None,
    }


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """A table with one line per scene, noise and method; `length` is the driven over the shortest reference's."""
    points: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        points.setdefault((row["scene"], row["noise"], row["method"]), []).append(row)
    header = [
        "scene",
        "b",
        "method",
        "runs",
        "goal",
        "collision",
        "timeout",
        "cost",
        "time [s]",
        "length",
        "switches",
        "ms/step",
        "plan [s]",
        "classes",
    ]
    lines = []
    for (scene, noise, method), group in points.items():
        count = {name: sum(r["outcome"] == name for r in group) for name in ("goal", "collision", "timeout")}
        arrived = [r for r in group if r["outcome"] == "goal"]
        lines.append(
            [
                scene,
                f"{noise:g}",
                method,
                str(len(group)),
                *(str(n) for n in count.values()),
                _mean([r["cost"] for r in arrived]),
                _mean([r["time"] for r in arrived]),
                _mean([r["path_length"] / r["shortest_length"] for r in arrived if r["shortest_length"]]),
                f"{np.mean([r['class_switches'] for r in group]):.2f}",
                f"{np.median([r['step_ms']['median'] for r in group]):.1f}",
                _mean([r["plan_seconds"] for r in group if r["plan_seconds"] is not None]),
                _shares([r["executed_class"] for r in arrived]),
            ]
        )
    return present.table(header, lines)


def _results(jobs: Sequence[Job], workers: int) -> Iterator[dict[str, Any]]:
    if workers == 1:
        yield from map(drive, jobs)
        return
    # A fresh interpreter per worker: forking one that has threads is not safe.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(drive, jobs, chunksize=max(1, min(8, len(jobs) // (4 * workers))))


def _ticked(bar: Any, row: dict[str, Any]) -> dict[str, Any]:
    bar.update()
    return row


@cache
def _prepared(scene: str, task: tuple[tuple[str, Any], ...], given: tuple[tuple[str, Any], ...]) -> Scenario:
    return prepare(scene, **dict(task), given=dict(given))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Planned:
    tree: HomologyTree
    shortest: float  # length of the shortest reference at the start [m]
    seconds: float  # wall time of tree and references


@cache
def _planned(scene: str, task: tuple[tuple[str, Any], ...], given: tuple[tuple[str, Any], ...]) -> _Planned:
    """One tree per scene: it depends neither on noise nor on the method."""
    scenario = _prepared(scene, task, given)
    began = time.perf_counter()
    tree = scenario.grown_tree()
    references = tree.references(scenario.start, polished=scenario.settings.polish)
    seconds = time.perf_counter() - began
    return _Planned(tree=tree, shortest=min(r.length for r in references), seconds=seconds)


@cache
def _solved(scene: str, task: tuple[tuple[str, Any], ...], given: tuple[tuple[str, Any], ...], noise: float) -> Any:
    """One grid per scene and noise."""
    return _prepared(scene, task, given).with_settings(noise=noise).optimal().desirability


def _settled(job: Job) -> Scenario:
    changes: dict[str, Any] = {"method": job.method, "seed": job.seed, "threads": 1}
    if job.noise is not None:
        changes["noise"] = job.noise
    return _prepared(job.scene, job.task, job.given).with_settings(**changes)


def _numbers(option: str, texts: Sequence[str]) -> Iterator[float]:
    for text in texts:
        try:
            yield float(text)
        except ValueError:
            raise OptionError(f"{option}: {text!r} is no number; write for instance 0.1,0.3") from None


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if last else int(first) + 1)
    except ValueError:
        raise OptionError(f"--seeds: {text!r} is no range; write for instance 0:100") from None
    if len(seeds) == 0 or seeds.start < 0:
        raise OptionError(f"--seeds: {text!r} holds no seed; write for instance 0:100")
    return seeds


def _mean(values: Sequence[float]) -> str:
    return f"{np.mean(values):.3f}" if values else "-"


def _shares(ids: Sequence[str]) -> str:
    if not ids:
        return "-"
    names, counts = np.unique(ids, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return ", ".join(f"{title(str(names[i]))}: {counts[i] / len(ids):.0%}" for i in order[:4])
