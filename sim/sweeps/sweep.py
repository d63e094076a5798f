"""Every combination of scene, method, noise and seed as one drive, on all cores or a cluster."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pirrht.control.methods import METHODS
from pirrht.errors import OptionError
from pirrht.exact.desirability import Desirability
from sim.drawing.colors import title
from sim.mjcf import scene_names
from sim.options import table as options
from sim.options.settings import SEED
from sim.sweeps import engine, runs
from sim.sweeps.columns import key_of
from sim.sweeps.dataset import TREES, Dataset
from sim.sweeps.runs import Errand, Job, Planned, Survey
from sim.text import counted, table

GRID_MOST = 1_000_000  # runs of a sweep


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What a command line asks for."""

    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    noises: tuple[float | None, ...]  # None: what the scene asks for
    seeds: range
    task: runs.Frozen
    given: runs.Frozen

    def jobs(self) -> list[Job]:
        """All combinations, by scene, noise, method and seed."""
        return [
            Job(scene=scene, method=method, noise=noise, seed=seed, task=self.task, given=self.given, label=label)
            for scene, label in zip(self.scenes, _labels(self.scenes), strict=True)
            for noise in self.noises
            for method in self.methods
            for seed in self.seeds
        ]

    @property
    def settings(self) -> dict[str, Any]:
        """What all runs share and results depend on, by option."""
        return options.identity(dict((*self.task, *self.given)))


def parse_grid(arguments: argparse.Namespace) -> Grid:
    """What a command line asks for.

    Raises:
        OptionError: an unknown method, or seeds or noise that are no numbers, or something said twice.
    """
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
    for option, values in (("SCENE", arguments.scenes), ("--methods", methods), ("--noise", noises)):
        twice = [value for i, value in enumerate(values) if value in values[:i]]
        if twice:
            raise OptionError(f"{option} names {twice[0]} twice; every combination is one run: leave one out")
    said = vars(arguments)
    task, shared = options.task(said), options.settings("sweep", said)
    options.refuse_idle(shared, methods)
    runs_asked = len(arguments.scenes) * len(methods) * len(noises) * len(seeds)
    if runs_asked > GRID_MOST:
        raise OptionError(
            f"--seeds {arguments.seeds}: {runs_asked:,} runs are asked for, and a sweep has at most {GRID_MOST:,}"
        )
    return Grid(
        scenes=tuple(arguments.scenes),
        methods=tuple(methods),
        noises=tuple(noises),
        seeds=seeds,
        task=_frozen(task),
        given=_frozen(shared),
    )


def checked(jobs: Sequence[Job]) -> list[Job]:
    """The jobs with noise and the scene's digest filled in.

    Raises:
        PirrhtError: a scene, a setting or a saved tree is wrong; the first that is.
    """
    known: dict[tuple[Any, ...], dict[str, Any]] = {}
    fitting: set[tuple[Any, ...]] = set()  # places whose saved tree has been looked at
    runs.forget()
    for job in jobs:
        if job.point in known:
            continue
        scenario = runs.settled(job)
        if job.method == "optimal":
            Desirability.spacing_for(scenario.problem, scenario.space)
        if scenario.settings.tree is not None and runs.needs_tree(job) and job.place not in fitting:
            scenario.grown_tree()
            fitting.add(job.place)
        known[job.point] = {
            "scene": job.scene if job.scene in scene_names() else str(scenario.loaded.path.resolve()),
            "noise": scenario.settings.noise,
            "digest": runs.digest(job),
            "label": job.name,
        }
    return [replace(job, **known[job.point]) for job in jobs]


def sweep(
    jobs: Sequence[Job],
    *,
    jobs_at_once: int | None = None,
    scheduler: str | None = None,
    dataset: Dataset | None = None,
) -> list[dict[str, Any]]:
    """Run them all; one record each, in the order asked for.

    Args:
        jobs_at_once: processes; without it one per core.
        scheduler: address of a Dask cluster that does it instead.
        dataset: keeps what is finished; runs that it has already are not repeated.

    Raises:
        PirrhtError: a scene or a setting is wrong; all are checked before the first drive.
        KeyboardInterrupt: it was stopped; what was finished is kept.
    """
    jobs = jobs if all(job.digest for job in jobs) else checked(jobs)
    keys = [key_of(runs.failure(job, "")) for job in jobs]
    done = {} if dataset is None else {key_of(record): record for record in dataset.records()}
    waiting = [job for job, key in zip(jobs, keys, strict=True) if key not in done]
    if done and len(waiting) < len(jobs):
        print(f"{len(jobs) - len(waiting)} of {counted(len(jobs), 'run')} are there already", file=sys.stderr)
    workers = min(jobs_at_once or len(os.sched_getaffinity(0)), max(1, len(waiting)))
    with ExitStack() as stack:
        stop = stack.enter_context(engine.interruptible())
        near = None if dataset is None else dataset.folder
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=TREES, dir=near)))
        crew = _crew(stack, stop, workers, scheduler, alone=dataset is None)
        errands = _planned(waiting, crew, stop, None if scheduler else folder)
        bar = stack.enter_context(
            tqdm(total=len(jobs), initial=len(jobs) - len(waiting), desc="sweep", unit=" runs", disable=None)
        )
        for record in _kept(crew(runs.attempt, errands, _given_up), dataset, stop, bar):
            done[key_of(record)] = record
    if stop.asked:
        if dataset is not None:
            kept = f"{sum(key in done for key in keys)} of {counted(len(jobs), 'run')} kept in {dataset.folder}"
            print(f"{kept}; the same command goes on", file=sys.stderr)
        raise KeyboardInterrupt
    return [done[key] for key in keys]


def summary(rows: Sequence[dict[str, Any]], room: int | None = None) -> str:
    """A table with one line per scene, noise and method; a path is held against the shortest reference."""
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
        "path/shortest",
        "switches",
        "ms/step",
        "plan [s]",
        "classes",
    ]
    if any(row["outcome"] is None for row in rows):
        header.insert(7, "error")
    lines = []
    for (scene, noise, method), everyone in points.items():
        group = [r for r in everyone if r["outcome"] is not None]
        errors = [str(len(everyone) - len(group))] if "error" in header else []
        count = {name: sum(r["outcome"] == name for r in group) for name in ("goal", "collision", "timeout")}
        arrived = [r for r in group if r["outcome"] == "goal"]
        lines.append(
            [
                scene,
                f"{noise:g}",
                method,
                str(len(everyone)),
                *(str(n) for n in count.values()),
                *errors,
                _mean([r["cost"] for r in arrived]),
                _mean([r["time"] for r in arrived]),
                _mean([r["path_length"] / r["shortest_length"] for r in arrived if r["shortest_length"]]),
                _mean([r["class_switches"] for r in group], 2),
                _mean([np.median([r["step_ms"]["median"] for r in group])] if group else [], 1),
                _mean([r["plan_seconds"] for r in group if r["plan_seconds"] is not None]),
                _shares([r["executed_class"] for r in arrived]),
            ]
        )
    return table(header, lines, room, keep=3)


Crew = Callable[[Callable[[Any], Any], Sequence[Any], Callable[[Any, str], Any]], Iterator[Any]]


def _crew(stack: ExitStack, stop: engine.Stop, workers: int, scheduler: str | None, *, alone: bool) -> Crew:
    """Who does the work: a cluster, processes, or this thread if one is enough and nothing must be kept."""
    if scheduler is not None:
        from sim.sweeps.cluster import Cluster

        cluster = stack.enter_context(Cluster(scheduler))
        return lambda work, items, lost: cluster.run(work, engine.Agenda(items), stop, lost)
    if workers == 1 and alone:
        return lambda work, items, lost: engine.in_turn(work, engine.Agenda(items), stop)
    pool = stack.enter_context(engine.Pool(workers))
    return lambda work, items, lost: pool.run(work, engine.Agenda(items), stop, lost)


def _planned(jobs: Sequence[Job], crew: Crew, stop: engine.Stop, folder: Path | None) -> list[Errand]:
    """The jobs with their trees, of which one is grown per scene; in files of a folder, or else at hand."""
    wishes = list({job.place: Survey(job=job) for job in jobs if runs.needs_tree(job)}.values())
    plans: dict[tuple[Any, ...], Planned] = {}
    with tqdm(total=len(wishes), desc="plan", unit=" trees", leave=False, disable=None) as bar:
        for found in crew(runs.survey, wishes, lambda wish, why: (wish.job.place, Planned(error=why))):
            if found is not None:
                place, planned = found
                plans[place] = planned if folder is None else runs.unpacked(planned, folder, len(plans))
                bar.update()
    return [
        Errand(job=job, planned=plans.get(job.place) if runs.needs_tree(job) else None)
        for job in jobs
        if not stop.asked
    ]


def _kept(results: Iterator[Any], dataset: Dataset | None, stop: engine.Stop, bar: Any) -> Iterator[dict[str, Any]]:
    """The records as they come, each written to the dataset soon after, and all of them in the end."""
    told = failing = False
    try:
        for record in results:
            if record is not None:
                if dataset is not None:
                    dataset.add(record)
                bar.update()
                yield record
            if dataset is not None:
                dataset.tend()
                if dataset.failing and not failing:
                    bar.write(f"{dataset.folder} cannot be written; finished runs are kept for another try", sys.stderr)
                failing = dataset.failing
            if stop.asked == 1 and not told:
                bar.write("stopping: the runs under way are waited for; Ctrl-C again ends them", sys.stderr)
                told = True
    finally:
        if dataset is not None:
            dataset.flush()


def _given_up(errand: Errand, why: str) -> dict[str, Any]:
    return runs.failure(errand.job, why)


def _labels(scenes: Sequence[str]) -> list[str]:
    """Names of built-in scenes, and of files where they differ."""
    stems = [scene if scene in scene_names() else Path(scene).stem for scene in scenes]
    return [stem if stems.count(stem) == 1 else scene for scene, stem in zip(scenes, stems, strict=True)]


def _frozen(values: Mapping[str, Any]) -> runs.Frozen:
    return tuple((name, tuple(value) if isinstance(value, list) else value) for name, value in values.items())


def _numbers(option: str, texts: Sequence[str]) -> Iterator[float]:
    for text in texts:
        try:
            value = float(text)
        except ValueError:
            raise OptionError(f"{option}: {text!r} is no number; write for instance 0.1,0.3") from None
        yield options.BY_SETTING["noise"].check(value)


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if last else int(first) + 1)
    except ValueError:
        raise OptionError(f"--seeds: {text!r} is no range; write for instance 0:100") from None
    for seed in (seeds.start, max(seeds.start, seeds.stop - 1)):
        if seed > SEED:
            raise OptionError(f"--seeds: {text[:40]!r} goes beyond {SEED}; write for instance 0:100")
    if len(seeds) == 0 or seeds.start < 0:
        raise OptionError(f"--seeds: {text!r} holds no seed; write for instance 0:100")
    return seeds


def _mean(values: Sequence[float], digits: int = 3) -> str:
    return f"{np.mean(values):.{digits}f}" if values else "-"


def _shares(ids: Sequence[str]) -> str:
    if not ids:
        return "-"
    names, counts = np.unique(ids, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return ", ".join(f"{title(str(names[i]))}: {counts[i] / len(ids):.0%}" for i in order[:4])
