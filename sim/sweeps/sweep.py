"""Every combination of scene, method, noise and seed as one run, on all cores or a cluster.

Trees and runs go side by side: the runs through a tree come first as soon as it is there, and processes work on
different combinations of scene, noise and method while there are enough. So there are about as many trees at a time as
workers; each is dropped with the last of its runs.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pirrht.exact.desirability import Desirability
from sim.mjcf import scene_names
from sim.sweeps import engine, runs
from sim.sweeps.dataset import TREES, Dataset
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Job, Planned, Task
from sim.text import counted

SECOND = 1.0  # how often the line is written anew at least [s]
Record = dict[str, Any]


class Progress:
    """A line on standard error, as a context; nothing where that is no terminal.

    Args:
        asked: number of runs.
        done: records of runs that are there already.
        places: number of trees to grow.
    """

    def __init__(self, asked: int, done: Sequence[Mapping[str, Any]], places: int) -> None:
        self._outcomes, self._places, self._closed = Counter[str](), places, threading.Event()
        self._bar = tqdm(total=asked, initial=len(done), desc="sweep", unit=" runs", disable=None, dynamic_ncols=True)
        self._outcomes.update(record["outcome"] for record in done if record["outcome"] is not None)

    def __enter__(self) -> Progress:
        if not self._bar.disable:
            self.add(None, 0)
            threading.Thread(target=self._tick, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._bar.close()

    def _tick(self) -> None:
        """Let the clock go on while the main thread is at a tree or a run."""
        while not self._closed.wait(SECOND):
            self._bar.refresh()

    def add(self, record: Mapping[str, Any] | None, grown: int) -> None:
        """Take note of a run that has ended, or of none, and of how many trees there have been."""
        if record is not None and record["outcome"] is not None:
            self._outcomes[record["outcome"]] += 1
        ended = self._outcomes.total()
        notes = [f"goal {self._outcomes['goal'] / ended:.0%}"] if ended else []
        notes += [f"trees {grown}/{self._places}"] if grown < self._places else []
        self._bar.set_postfix_str(", ".join(notes), refresh=record is None)
        self._bar.update(0 if record is None else 1)

    def write(self, line: str) -> None:
        """A line of its own, terminal or not."""
        self._bar.write(line, sys.stderr)


class Pipeline:
    """The runs of a sweep through a crew, trees and drives side by side.

    Args:
        jobs: no two of them alike.
        folder: where trees lie for processes of this machine; None: they travel.
    """

    def __init__(self, jobs: Sequence[Job], folder: Path | None) -> None:
        self._folder = folder
        self._waiting: dict[tuple[Any, ...], list[Job]] = {}  # for their place's tree
        for job in jobs:
            if runs.needs_tree(job):
                self._waiting.setdefault(job.place, []).append(job)
        self._places = {key_of(runs.failure(job, "")): at for at, there in self._waiting.items() for job in there}
        self._left = Counter(self._places.values())  # runs that a tree is still needed for
        self._trees: dict[tuple[Any, ...], bytes | str] = {}
        self.places, self.grown = len(self._waiting), 0
        trees = [Task(job=there[0], grows=True) for there in self._waiting.values()]
        self._agenda = engine.Agenda([*trees, *(Task(job=job) for job in jobs if not runs.needs_tree(job))])

    @property
    def trees(self) -> int:
        """Number of trees at present."""
        return len(self._trees)

    def run(self, crew: engine.Crew) -> Iterator[Record | None]:
        """Records as they come, and None now and then while there are none."""
        for result in crew.run(runs.work, self._agenda, runs.given_up):
            if isinstance(result, Planned):
                self._take(result)
                yield None
                continue
            if result is not None:
                self._forget(result)
            yield result

    def _take(self, planned: Planned) -> None:
        if self._folder is not None:
            planned = runs.unpacked(planned, self._folder, self.grown)
        self.grown += 1
        self._trees[planned.place] = planned.tree
        self._agenda.add([Task(job=job, planned=planned) for job in self._waiting.pop(planned.place)])

    def _forget(self, record: Record) -> None:
        """Drop the tree of a run if that was the last that needed it."""
        place = self._places.pop(key_of(record), None)
        if place is None:
            return
        self._left[place] -= 1
        if self._left[place] == 0:
            tree = self._trees.pop(place)
            if isinstance(tree, str):
                with suppress(OSError):
                    Path(tree).unlink()


def _crew(stop: engine.Stop, workers: int, scheduler: str | None, *, alone: bool) -> engine.Crew:
    """Choose who does the work: a cluster, processes, or this thread if one is enough and nothing must be kept."""
    if scheduler is not None:
        from sim.sweeps.cluster import Cluster

        return Cluster(scheduler, stop)
    return engine.Crew(stop) if workers == 1 and alone else engine.Pool(workers, stop)


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
    asked = {key_of(runs.failure(job, "")): job for job in jobs}
    there = {} if dataset is None else {key_of(record): record for record in dataset.records()}
    done = {key: there[key] for key in asked if key in there}
    waiting = [job for key, job in asked.items() if key not in done]
    if done:
        print(f"{len(done)} of {counted(len(asked), 'run')} are there already", file=sys.stderr)
    workers = min(jobs_at_once or len(os.sched_getaffinity(0)), max(1, len(waiting)))
    with ExitStack() as stack:
        stop = stack.enter_context(engine.interruptible())
        near = None if dataset is None else dataset.folder
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=TREES, dir=near)))
        crew = stack.enter_context(_crew(stop, workers, scheduler, alone=dataset is None))
        pipeline = Pipeline(waiting, None if scheduler else folder)
        progress = stack.enter_context(Progress(len(asked), list(done.values()), pipeline.places))
        for record in _kept(pipeline.run(crew), dataset, stop, progress):
            progress.add(record, pipeline.grown)
            if record is not None:
                done[key_of(record)] = record
    if stop.asked:
        if dataset is not None:
            kept = f"{len(done)} of {counted(len(asked), 'run')} kept in {dataset.folder}"
            print(f"{kept}; the same command goes on", file=sys.stderr)
        signal.raise_signal(stop.number)  # whoever heeds signals says how this ends
        raise KeyboardInterrupt
    return [done[key_of(runs.failure(job, ""))] for job in jobs]


def _kept(
    results: Iterator[Any], dataset: Dataset | None, stop: engine.Stop, progress: Progress
) -> Iterator[dict[str, Any] | None]:
    """The results as they come, each record written to the dataset soon after, and all of them in the end."""
    warned = failing = False
    try:
        for record in results:
            if dataset is not None:
                if record is not None:
                    dataset.add(record)
                dataset.tend()
                if dataset.failing and not failing:
                    progress.write(f"{dataset.folder} cannot be written; finished runs are kept for another try")
                failing = dataset.failing
            yield record
            if stop.asked == 1 and not warned:
                progress.write("stopping: the runs under way are waited for; Ctrl-C again ends them")
                warned = True
    finally:
        if dataset is not None:
            dataset.flush()
