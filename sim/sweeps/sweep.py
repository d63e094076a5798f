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
from sim.sweeps.runs import Job, Task
from sim.text import counted

Record = dict[str, Any]


class Progress(tqdm):  # type: ignore[misc]
    """A line on standard error, as a context; nothing where that is no terminal.

    Args:
        asked: number of runs.
        done: records of runs that are there already.
        places: number of trees to grow.
    """

    def __init__(self, asked: int, done: Sequence[Mapping[str, Any]], places: int) -> None:
        super().__init__(total=asked, initial=len(done), desc="sweep", unit=" runs", disable=None, dynamic_ncols=True)
        self._outcomes, self._places = Counter(record["outcome"] for record in done), places

    def add(self, record: Mapping[str, Any] | None, grown: int) -> None:
        """Take note of a run that has ended, or of none, and of how many trees there have been."""
        if record is not None:
            self._outcomes[record["outcome"]] += 1
        ended = self._outcomes.total() - self._outcomes[None]
        notes = [f"goal {self._outcomes['goal'] / ended:.0%}"] if ended else []
        notes += [f"trees {grown}/{self._places}"] if grown < self._places else []
        self.set_postfix_str(", ".join(notes), refresh=record is None)
        self.update(0 if record is None else 1)


def driven(jobs: Sequence[Job], crew: engine.Crew, folder: Path | None = None) -> Iterator[tuple[Record | None, int]]:
    """Drive through trees that are grown at the same time.

    Args:
        jobs: no two of them alike.
        folder: where trees lie for processes of this machine; None: they travel.

    Yields:
        records as they come, and None now and then while there are none; with the number of trees that have been grown.
    """
    waiting: dict[Any, list[Job]] = {}  # for the tree of their place
    for job in jobs:
        if job.needs_tree:
            waiting.setdefault(job.place, []).append(job)
    left, grown = {place: len(known) for place, known in waiting.items()}, 0
    trees = (Task(job=known[0], grows=True) for known in waiting.values())
    agenda = engine.Agenda([*trees, *(Task(job=job) for job in jobs if not job.needs_tree)])
    for ended in crew.run(runs.work, agenda, runs.given_up):
        record = None
        if ended is not None:
            task, result = ended
            place = task.job.place
            if task.grows:
                if folder is not None and result.tree:
                    with suppress(OSError):  # without room for a file it travels
                        file = folder / f"{grown}.tree"
                        file.write_bytes(result.tree)
                        result = replace(result, tree=str(file))
                agenda.add([Task(job=job, planned=result) for job in waiting[place]])
                grown += 1
            else:
                record = result
            if task.planned is not None:
                left[place] -= 1
                if left[place] == 0 and isinstance(task.planned.tree, str):
                    Path(task.planned.tree).unlink(missing_ok=True)
        yield record, grown


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
        if scenario.settings.tree is not None and job.needs_tree and job.place not in fitting:
            scenario.grown_tree()
            fitting.add(job.place)
        known[job.point] = {
            "scene": job.scene if job.scene in scene_names() else str(scenario.loaded.path.resolve()),
            "noise": scenario.settings.noise,
            "digest": runs.digest(*job.place),
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
    asked = {key_of(job.identity): job for job in jobs}
    there = {key_of(record): record for record in (dataset.records() if dataset else [])}
    done = {key: there[key] for key in asked if key in there and not (again and there[key]["outcome"] is None)}
    waiting = [job for key, job in asked.items() if key not in done]
    if done:
        print(f"{len(done)} of {counted(len(asked), 'run')} are there already", file=sys.stderr)
    workers = min(jobs_at_once or len(os.sched_getaffinity(0)), max(1, len(waiting)))
    places = len({job.place for job in waiting if job.needs_tree})
    warned = failing = False
    with ExitStack() as stack:
        stop = stack.enter_context(engine.interruptible())
        near = None if dataset is None else dataset.folder
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=TREES, dir=near)))
        if scheduler is not None:
            from sim.sweeps.cluster import Cluster

            crew: engine.Crew = Cluster(scheduler, stop)
        else:  # this thread if one is enough and nothing must be kept
            crew = engine.Crew(stop) if workers == 1 and dataset is None else engine.Pool(workers, stop)
        stack.enter_context(crew)
        progress = stack.enter_context(Progress(len(asked), list(done.values()), places))
        if dataset is not None:
            stack.callback(dataset.compact)
        for record, grown in driven(waiting, crew, None if scheduler else folder):
            if record is not None:
                done[key_of(record)] = record
            if dataset is not None:
                dataset.tend() if record is None else dataset.add(record)
                if dataset.failing and not failing:
                    progress.write(
                        f"{dataset.folder} cannot be written; finished runs are kept for another try", sys.stderr
                    )
                failing = dataset.failing
            progress.add(record, grown)
            if stop.asked == 1 and not warned:
                progress.write("stopping: the runs under way are waited for; Ctrl-C again ends them", sys.stderr)
                warned = True
    if stop.asked:
        if dataset is not None:
            kept = f"{len(done)} of {counted(len(asked), 'run')} kept in {dataset.folder}"
            print(f"{kept}; the same command goes on", file=sys.stderr)
        signal.raise_signal(stop.number)  # whoever heeds signals says how this ends
        raise KeyboardInterrupt
    return [done[key_of(job.identity)] for job in jobs]
