"""Trees and drives side by side: a drive is on the agenda as soon as its own scene's tree is there.

A worker that has grown a tree drives through it first and grows the next one when nobody needs it there, so that
there are about as many trees at a time as workers; each is dropped with the last of its runs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.sweeps import engine, runs
from sim.sweeps.columns import key_of
from sim.sweeps.runs import Errand, Job, Planned, Survey

Record = dict[str, Any]
Crew = Callable[[Callable[[Any], Any], engine.Agenda, Callable[[Any, str], Any]], Iterator[Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grown:
    """What became of the wish for a tree."""

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
        """How many trees are there now."""
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
    """Who does the work: a cluster, processes, or this thread if one is enough and nothing must be kept."""
    if scheduler is not None:
        from sim.sweeps.cluster import Cluster

        cluster = stack.enter_context(Cluster(scheduler))
        return lambda work, agenda, lost: cluster.run(work, agenda, stop, lost)
    if workers == 1 and alone:
        return lambda work, agenda, lost: engine.in_turn(work, agenda, stop)
    pool = stack.enter_context(engine.Pool(workers))
    return lambda work, agenda, lost: pool.run(work, agenda, stop, lost)
