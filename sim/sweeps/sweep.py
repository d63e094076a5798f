"""Every combination of scene, method, noise and seed as one run, on all cores or a cluster.

The runs through a tree come first as soon as it is there, and processes work on different combinations of scene, noise
and method while there are enough: there are about as many trees at a time as workers.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pirrht.control.settings import METHODS
from pirrht.errors import OptionError, printable
from pirrht.exact.desirability import Desirability
from sim import options
from sim.mjcf import scene_names
from sim.settings import BY_SETTING, IDENTIFYING, SEED, refuse_unused
from sim.sweeps import engine, runs
from sim.sweeps.dataset import TREES, Dataset
from sim.sweeps.parts import key_of
from sim.sweeps.runs import Frozen, Job, Task, frozen
from sim.text import counted, suggestion

MOST_RUNS = 1_000_000  # jobs and records of so many fit into some gigabytes
Record = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Runs that a command line asks for."""

    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    noises: tuple[float | None, ...]  # None: what the scene asks for
    seeds: range
    given: Frozen  # scene options and settings

    def __post_init__(self) -> None:
        for option, values in (("SCENE", self.scenes), ("--methods", self.methods), ("--noise", self.noises)):
            twice = [value for i, value in enumerate(values) if value in values[:i]]
            if twice:
                raise OptionError(f"{option} names {twice[0]} twice; every combination is one run: leave one out")
        seeds = self.seeds.stop - self.seeds.start  # len() knows no more than a machine word
        size = len(self.scenes) * len(self.methods) * len(self.noises) * seeds
        if size > MOST_RUNS:
            remedy = "ask for fewer --seeds at a time: the same -o DIR takes the others later"
            raise OptionError(f"{size} runs are asked for, and a sweep has {MOST_RUNS} at most; {remedy}")

    def jobs(self) -> list[Job]:
        """All combinations, by scene, noise, method and seed; labels are built-in names, or of files where they differ.

        Where a risk decides on the margin, the noise is a setting that all runs of it share.
        """
        stems = [printable(scene if scene in scene_names() else Path(scene).stem) for scene in self.scenes]
        risky = dict(self.given).get("risk") is not None
        return [
            Job(scene=scene, method=method, noise=noise, seed=seed, given=given, label=label)
            for scene, stem in zip(self.scenes, stems, strict=True)
            for label in [stem if stems.count(stem) == 1 else printable(scene)]
            for noise in self.noises
            for given in [(*self.given, ("noise", noise)) if risky and noise is not None else self.given]
            for method in self.methods
            for seed in self.seeds
        ]

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that all runs share and results depend on, by option."""
        return {name: value for name, value in self.given if name in IDENTIFYING}


def parse(words: Mapping[str, Any]) -> Grid:
    """Return the grid of a parsed command line.

    Args:
        words: scenes; methods and noise levels with commas between them, None for the noise of each scene; seeds as
            `A:B` for A to B-1, or one seed; scene options and settings that all runs share, None where not given.

    Raises:
        OptionError: an unknown method, seeds or noise that are no numbers, a value twice, too many runs.
    """
    given = options.of_run("sweep", words)
    names = tuple(name.strip() for name in words["methods"].split(","))
    for name in names:
        if name not in METHODS:
            raise OptionError(f"--methods names {name!r}{suggestion(name, METHODS)}; known are {', '.join(METHODS)}")
    refuse_unused(given, names)
    noises: list[float | None] = []
    for part in [] if words["noise"] is None else words["noise"].split(","):
        try:
            noises.append(BY_SETTING["noise"].check(float(part)))
        except ValueError:
            raise OptionError(f"--noise: {part!r} is no number; write for instance 0.1,0.3") from None
    return Grid(
        scenes=tuple(words["scenes"]),
        methods=names,
        noises=tuple(noises) or (None,),
        seeds=seeds_of(words["seeds"]),
        given=frozen(given),
    )


def seeds_of(text: str) -> range:
    """Seeds as in 0:100, or one; OptionError if it is no range, empty, or beyond what a dataset can hold."""
    first, _, last = text.partition(":")
    try:
        start = int(first)
        stop = int(last) if last else int(first) + 1
    except ValueError:
        raise OptionError(f"--seeds: {text[:60]!r} is no range; write for instance 0:100") from None
    if start < 0 or stop <= start:
        raise OptionError(f"--seeds: {text[:60]!r} holds no seed; write for instance 0:100")
    if stop - 1 > SEED:
        raise OptionError(f"--seeds: {text[:60]!r} goes beyond {SEED}, the largest seed; write smaller ones")
    return range(start, stop)


class Progress(tqdm):  # type: ignore[misc]
    """A line on standard error, as a context; nothing where that is no terminal.

    It is for `asked` runs, those with records that are `done` included, and `places`, of which each needs a tree.
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
    known: dict[tuple[Any, ...], Job] = {}
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
        scene = job.scene if job.scene in scene_names() else str(scenario.loaded.path.resolve())
        noise, digest = scenario.settings.noise, runs.digest(*job.place)
        known[job.point] = replace(job, scene=scene, noise=noise, digest=digest, label=job.label or job.scene)
    return [replace(known[job.point], seed=job.seed) for job in jobs]


def sweep(
    jobs: Sequence[Job], *, jobs_at_once: int | None = None, scheduler: str | None = None,
    dataset: Dataset | None = None, again: bool = False,
) -> list[Record]:  # fmt: skip
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
    with engine.interruptible() as stop:
        if scheduler is not None:
            from sim.sweeps.cluster import Cluster

            crew: engine.Crew = Cluster(scheduler, stop)
        else:  # this thread if one is enough and nothing must be kept
            crew = engine.Crew(stop) if workers == 1 and dataset is None else engine.Pool(workers, stop)
        for record in _records(waiting, list(done.values()), stop, crew, dataset):
            done[key_of(record)] = record
    if stop.asked:
        if dataset is not None:
            kept = f"{len(done)} of {counted(len(asked), 'run')} kept in {dataset.folder}; the same command continues"
            print(kept, file=sys.stderr)
        signal.raise_signal(stop.number)  # whoever heeds signals says how this ends
        raise KeyboardInterrupt
    return [done[key_of(job.identity)] for job in jobs]


def _records(
    jobs: Sequence[Job], done: Sequence[Record], stop: engine.Stop, crew: engine.Crew, dataset: Dataset | None
) -> Iterator[Record]:  # fmt: skip
    """Records of jobs as they come, next to those that are done already; the dataset has them all in the end."""
    places, warned = {job.place for job in jobs if job.needs_tree}, False
    with ExitStack() as stack:
        near = dataset.folder if dataset else None
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=TREES, dir=near)))
        stack.enter_context(crew)
        progress = stack.enter_context(Progress(len(jobs) + len(done), done, len(places)))
        if dataset is not None:
            stack.callback(dataset.compact)
        for record, grown in driven(jobs, crew, None if crew.remote else folder):
            if dataset is not None and dataset.add(record):
                problem = f"{dataset.folder} cannot be written; finished runs are kept for another try"
                progress.write(problem, sys.stderr)
            progress.add(record, grown)
            if record is not None:
                yield record
            if stop.asked == 1 and not warned:
                progress.write("stopping after the current runs; Ctrl-C again ends them at once", sys.stderr)
                warned = True
