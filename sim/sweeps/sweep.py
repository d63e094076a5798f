"""Every combination of scene, method, noise and seed as one drive, on all cores or a cluster."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from pirrht.exact.desirability import Desirability
from sim.mjcf import scene_names
from sim.sweeps import engine, runs
from sim.sweeps.columns import key_of
from sim.sweeps.dataset import TREES, Dataset
from sim.sweeps.pipeline import Pipeline, crew_of
from sim.sweeps.progress import Progress
from sim.sweeps.runs import Job
from sim.text import counted


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
            scenario.refuse_foretold()
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
