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
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
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

Record = dict[str, Any]


class Progress:
    """A line on standard error, as a context; nothing where that is no terminal.

    Args:
        asked: number of runs.
        done: records of runs that are there already.
        places: number of trees to grow.
    """

    def __init__(self, asked: int, done: Sequence[Mapping[str, Any]], places: int) -> None:
        self._outcomes, self._places = Counter(record["outcome"] for record in done), places
        self._bar = tqdm(total=asked, initial=len(done), desc="sweep", unit=" runs", disable=None, dynamic_ncols=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def add(self, record: Mapping[str, Any] | None, grown: int) -> None:
        """Take note of a run that has ended, or of none, and of how many trees there have been."""
        if record is not None:
            self._outcomes[record["outcome"]] += 1
        ended = self._outcomes.total() - self._outcomes[None]
        notes = [f"goal {self._outcomes['goal'] / ended:.0%}"] if ended else []
        notes += [f"trees {grown}/{self._places}"] if grown < self._places else []
        self._bar.set_postfix_str(", ".join(notes), refresh=record is None)
        self._bar.update(0 if record is None else 1)

    def write(self, line: str) -> None:
        """A line of its own, terminal or not."""
        self._bar.write(line, sys.stderr)


@dataclass(eq=False)
class _Place:
    jobs: list[Job]  # that need its tree
    left: int = 0  # runs of them that have not ended
    tree: bytes | str | None = None


class Pipeline:
    """The runs of a sweep through a crew, trees and drives side by side.

    Args:
        jobs: no two of them alike.
        folder: where trees lie for processes of this machine; None: they travel.
    """

    def __init__(self, jobs: Sequence[Job], folder: Path | None) -> None:
        self._folder, self.grown = folder, 0
        self._places: dict[tuple[Any, ...], _Place] = {}
        self._of: dict[tuple[Any, ...], _Place] = {}  # by the key of a run
        for job in filter(runs.needs_tree, jobs):
            place = self._places.setdefault(job.place, _Place([]))
            place.jobs.append(job)
            place.left += 1
            self._of[key_of(runs.failure(job, ""))] = place
        trees = [Task(job=place.jobs[0], grows=True) for place in self._places.values()]
        self._agenda = engine.Agenda([*trees, *(Task(job=job) for job in jobs if not runs.needs_tree(job))])

    @property
    def places(self) -> int:
        """Number of trees to grow."""
        return len(self._places)

    @property
    def trees(self) -> int:
        """Number of trees at present."""
        return sum(place.tree is not None for place in self._places.values())

    def run(self, crew: engine.Crew) -> Iterator[Record | None]:
        """Records as they come, and None now and then while there are none."""
        for result in crew.run(runs.work, self._agenda, runs.given_up):
            if isinstance(result, Planned):
                planned = result if self._folder is None else runs.unpacked(result, self._folder, self.grown)
                place = self._places[planned.place]
                place.tree = planned.tree
                self._agenda.add([Task(job=job, planned=planned) for job in place.jobs])
                self.grown += 1
                yield None
                continue
            if result is not None and (ended := self._of.get(key_of(result))) is not None:
                ended.left -= 1
                if ended.left == 0:
                    if isinstance(ended.tree, str):
                        Path(ended.tree).unlink(missing_ok=True)
                    ended.tree = None
            yield result


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
    again: bool = False,
) -> list[dict[str, Any]]:
    """Run them all; one record each, in the order asked for.

    Args:
        jobs_at_once: processes; without it one per core.
        scheduler: address of a Dask cluster that does it instead.
        dataset: keeps what is finished; runs that it has already are not repeated.
        again: repeat those that ended with an error all the same.

    Raises:
        PirrhtError: a scene or a setting is wrong; all are checked before the first drive.
        KeyboardInterrupt: it was stopped; what was finished is kept.
    """
    jobs = jobs if all(job.digest for job in jobs) else checked(jobs)
    asked = {key_of(runs.failure(job, "")): job for job in jobs}
    there = {key_of(record): record for record in (dataset.records() if dataset else [])}
    done = {key: there[key] for key in asked if key in there and not (again and there[key]["outcome"] is None)}
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
            dataset.compact()
