"""Every combination of scene, method, noise and seed as one run, on all cores or a cluster.

Trees and runs go side by side: a run is on the agenda as soon as its own scene's tree is there. A worker that has
grown a tree drives through it first and grows the next one when nobody needs it there, so that there are about as many
trees at a time as workers; each is dropped with the last of its runs.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

from tqdm import tqdm

from pirrht.exact.desirability import Desirability
from sim.mjcf import scene_names
from sim.sweeps import engine, runs
from sim.sweeps.dataset import TREES, Dataset
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Errand, Job, Planned, Survey
from sim.text import counted

SECOND = 1.0  # how often the line is written anew at least [s]
Record = dict[str, Any]
Crew = Callable[[Callable[[Any], Any], engine.Agenda, Callable[[Any, str], Any]], Iterator[Any]]


class Progress:
    """A line on standard error, as a context; nothing where that is no terminal.

    Args:
        asked: number of runs.
        done: records of runs that are there already.
        places: number of trees to grow.
    """

    def __init__(self, asked: int, done: Sequence[Mapping[str, Any]], places: int) -> None:
        self._ended, self._arrived, self._places = 0, 0, places
        self._bar = tqdm(total=asked, initial=len(done), desc="sweep", unit=" runs", disable=None, dynamic_ncols=True)
        for record in done:
            self._count(record)

        self._closed = threading.Event()
        self._clock = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> Progress:
        if not self._bar.disable:
            self.add(None, 0)
            self._clock.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._closed.set()
        if not self._bar.disable:
            self._clock.join()
        self._bar.close()

    def _tick(self) -> None:
        """Let the clock go on while the main thread is at a tree or a run."""
        while not self._closed.wait(SECOND):
            self._bar.refresh()

    def add(self, record: Mapping[str, Any] | None, grown: int) -> None:
        """Take note of a run that has ended, or of none, and of how many trees there have been."""
        if record is not None:
            self._count(record)
        told = [f"goal {self._arrived / self._ended:.0%}"] if self._ended else []
        told += [f"trees {grown}/{self._places}"] if grown < self._places else []
        self._bar.set_postfix_str(", ".join(told), refresh=record is None)  # the clock goes on while nothing ends
        self._bar.update(0 if record is None else 1)

    def say(self, line: str) -> None:
        """A line of its own, terminal or not."""
        self._bar.write(line, sys.stderr)

    def _count(self, record: Mapping[str, Any]) -> None:
        if record["outcome"] is not None:
            self._ended += 1
            self._arrived += record["outcome"] == "goal"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grown:
    """Result of a request for a tree."""

    place: tuple[Any, ...]
    planned: Planned


class Pipeline:
    """The runs of a sweep through a crew, trees and drives side by side.

    Args:
        jobs: no two of them alike.
        folder: where trees lie for processes of this machine; None: they travel.
    """

    def __init__(self, jobs: Sequence[Job], folder: Path | None) -> None:
        self._folder = folder
        self._waiting: dict[tuple[Any, ...], list[Job]] = {}  # for their place's tree
        self._through: dict[tuple[Any, ...], tuple[Any, ...]] = {}  # key of a run -> place of its tree
        for job in jobs:
            if runs.needs_tree(job):
                self._waiting.setdefault(job.place, []).append(job)
                self._through[key_of(runs.failure(job, ""))] = job.place
        self._left = Counter(self._through.values())  # runs that a tree is still needed for
        self._planned: dict[tuple[Any, ...], Planned] = {}
        self.places, self.grown = len(self._waiting), 0
        wishes = [Survey(job=jobs_there[0]) for jobs_there in self._waiting.values()]
        self._agenda = engine.Agenda([*wishes, *(Errand(job=job) for job in jobs if not runs.needs_tree(job))])

    @property
    def trees(self) -> int:
        """Number of trees at present."""
        return len(self._planned)

    def run(self, crew: Crew) -> Iterator[Record | None]:
        """Records as they come, and None now and then while there are none."""
        for result in crew(work, self._agenda, given_up):
            if isinstance(result, Grown):
                self._take(result)
                yield None
            elif result is None:
                yield None
            else:
                self._forget(result)
                yield result

    def _take(self, found: Grown) -> None:
        planned = found.planned
        if self._folder is not None:
            planned = runs.unpacked(planned, self._folder, self.grown)
        self.grown += 1
        self._planned[found.place] = planned
        for job in self._waiting.pop(found.place):
            self._agenda.add(Errand(job=job, planned=planned))

    def _forget(self, record: Record) -> None:
        """Drop the tree of a run if that was the last that needed it."""
        place = self._through.pop(key_of(record), None)
        if place is None:
            return
        self._left[place] -= 1
        if self._left[place] == 0:
            tree = self._planned.pop(place).tree
            if isinstance(tree, str):
                with suppress(OSError):
                    Path(tree).unlink()


def work(item: Survey | Errand) -> Grown | Record:
    """Grow a tree or drive, in whatever process this is. Errors are results."""
    if isinstance(item, Survey):
        place, planned = runs.survey(item)
        return Grown(place=place, planned=planned)
    return runs.attempt(item)


def given_up(item: Survey | Errand, why: str) -> Grown | Record:
    """The result of what ended too many processes."""
    if isinstance(item, Survey):
        return Grown(place=item.job.place, planned=Planned(error=why))
    return runs.failure(item.job, why)


def crew_of(stack: ExitStack, stop: engine.Stop, workers: int, scheduler: str | None, *, alone: bool) -> Crew:
    """Choose who does the work: a cluster, processes, or this thread if one is enough and nothing must be kept."""
    if scheduler is not None:
        from sim.sweeps.cluster import Cluster

        cluster = stack.enter_context(Cluster(scheduler))
        return lambda work, agenda, lost: cluster.run(work, agenda, stop, lost)
    if workers == 1 and alone:
        return lambda work, agenda, lost: engine.in_turn(work, agenda, stop)
    pool = stack.enter_context(engine.Pool(workers))
    return lambda work, agenda, lost: pool.run(work, agenda, stop, lost)


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
            scenario.check_known()
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
        crew = crew_of(stack, stop, workers, scheduler, alone=dataset is None)
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
    told = failing = False
    try:
        for record in results:
            if dataset is not None:
                if record is not None:
                    dataset.add(record)
                dataset.tend()
                if dataset.failing and not failing:
                    progress.say(f"{dataset.folder} cannot be written; finished runs are kept for another try")
                failing = dataset.failing
            yield record
            if stop.asked == 1 and not told:
                progress.say("stopping: the runs under way are waited for; Ctrl-C again ends them")
                told = True
    finally:
        if dataset is not None:
            dataset.flush()
