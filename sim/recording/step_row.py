"""A control step as a recording sees it, and what happens beside: classes come and go, obstacles are passed closely.

A class comes when it first weighs something, and goes when it has no path any more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.outcome import Outcome
from sim.drawing.colors import title
from sim.drive.episode import Frame
from sim.drive.truth import Truth
from sim.recording.reasons import arriving

Edges = tuple[Array, Array]  # ends (k, 2, 3) [m, m, turns] and heights of their middles (k,) [turns]
CLOSE, APART = 0.5, 2.0  # a passage is close below this share of the robot's radius, and over above this multiple of it
HEAVY = 0.01  # weight from which on a class is told of
GONE = 0.5  # classes that are away for no longer than this are not told of [s]
NAMED = 4  # classes named in one line at most


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One control step; it holds on to samples, of which there may be many, only where they are drawn."""

    step: int
    time: float  # simulated time at its start [s]
    duration: float  # [s]
    state: Array  # (n,) at its start
    control: Array  # (m,)
    states: Array  # (k, n) after each physics step
    noise: Array  # (k, m)
    cost: float
    length: float
    clearance: float
    vertices: int  # of the tree
    ids: tuple[str, ...]  # classes of the references
    weights: dict[str, float]  # by class; empty in a fallback
    sizes: dict[str, float]  # effective sample size by class
    arriving: dict[str, float]  # share of the samples drawn around each reference that arrive
    value: float  # infinite in a fallback
    value_error: float  # infinite where it is not known; 0 for a value that is exact
    control_error: Array  # (m,)
    doubtful: bool  # whether the estimate rests on few effective samples
    truth: Truth | None  # where a grid was solved
    favourite: str | None  # class of greatest weight, None in a fallback
    plan_seconds: float
    outcome: Outcome | None
    plan: Plan | None  # where a picture is due
    news: str | None
    growth: tuple[Edges, ...] = ()  # of the tree since the last picture, per obstacle that it is lifted by

    @property
    def size(self) -> int:
        """About how much memory it holds on to [bytes]: samples and tables, where a picture is to be made of them."""
        estimate = None if self.plan is None else self.plan.estimate
        if estimate is None:
            return self.states.nbytes
        arrays = [array for part in estimate.parts for array in (*part.paths, part.tables.law, part.tables.control)]
        return sum(array.nbytes for array in arrays)

    @classmethod
    def of(
        cls, frame: Frame, drawn: bool, news: str | None, truth: Truth | None = None, growth: tuple[Edges, ...] = ()
    ) -> Row:
        """The row of a frame."""
        plan, advance, estimate = frame.plan, frame.advance, frame.plan.estimate
        value, value_error = (inf, inf) if plan.exact is None else (plan.exact, 0.0)
        if estimate is not None:
            value, value_error = estimate.value, estimate.value_error
        return cls(
            step=frame.step,
            time=frame.time,
            duration=advance.time,
            state=plan.state,
            control=plan.control.copy(),
            states=advance.states,
            noise=advance.noise,
            cost=frame.cost,
            length=frame.length,
            clearance=frame.clearance,
            vertices=frame.vertices,
            ids=plan.ids,
            weights=estimate.class_weights if estimate else {},
            sizes=estimate.class_ess if estimate else {},
            arriving=arriving(estimate, plan.ids) if estimate else {},
            value=value,
            value_error=value_error,
            control_error=estimate.control_error if estimate else np.full(advance.noise.shape[1], value_error),
            doubtful=estimate is not None and estimate.doubtful,
            truth=truth,
            favourite=plan.favourite if estimate else None,
            plan_seconds=frame.plan_seconds,
            outcome=frame.outcome,
            plan=plan if drawn else None,
            news=news,
            growth=growth,
        )


class Happenings:
    """Watches the steps of a drive.

    Args:
        radius: of the robot [m].
        nearest: what is nearest to the robot at a step, in words.
        said: a class in words.
    """

    def __init__(self, radius: float, nearest: Callable[[Row], str], said: Callable[[str], str]) -> None:
        self._close, self._nearest, self._said = CLOSE * radius, nearest, said
        self._heavy: set[str] = set()  # classes that have weighed something and are there, or were a moment ago
        self._ever: set[str] = set()
        self._seen: dict[str, float] = {}  # when each was seen last [s]
        self._passage: Row | None = None  # the closest step of a passage that goes on
        self._favourite: str | None = None
        self._begun = False

    def add(self, row: Row) -> list[tuple[Row, str]]:
        """Take a step in; what is to be told, each at the step that it is about."""
        return [*((row, text) for text in (*self._classes(row), *self._switch(row))), *self._passages(row)]

    def _switch(self, row: Row) -> list[str]:
        """In words where the drive, which tells of the switch itself, is bound for now."""
        before, self._favourite = self._favourite, row.favourite or self._favourite
        words = self._said(self._favourite or "")
        return [f"now {words}"] if before not in (None, self._favourite) and words else []

    def _classes(self, row: Row) -> list[str]:
        if not row.ids:
            return []
        here = set(row.ids)
        self._seen |= dict.fromkeys(here, row.time)
        heavy = [name for name in row.ids if row.weights.get(name, 0.0) >= HEAVY and name not in self._heavy]
        lost = sorted(name for name in self._heavy - here if row.time - self._seen[name] > GONE)
        told = (
            ("new", [name for name in heavy if name not in self._ever]),
            ("back", [name for name in heavy if name in self._ever]),
            ("without a path for now", lost),
        )
        self._heavy = (self._heavy | set(heavy)) - set(lost)
        self._ever |= set(heavy)
        if not self._begun:
            self._begun = True
            return [f"{len(here)} classes, of weight: {self._counted(heavy)}"] if heavy else []
        return [f"{what}: {self._counted(names)}" for what, names in told if names]

    def _passages(self, row: Row) -> list[tuple[Row, str]]:
        if row.clearance < self._close and (self._passage is None or row.clearance < self._passage.clearance):
            self._passage = row
        if row.outcome is Outcome.COLLISION:
            self._passage = None
        over = self._passage is not None and (row.clearance > APART * self._close or row.outcome is not None)
        if not over or self._passage is None:
            return []
        closest, self._passage = self._passage, None
        return [(closest, f"passes {self._nearest(closest)} with {100 * max(0.0, closest.clearance):.1f} cm to spare")]

    def _counted(self, names: Sequence[str]) -> str:
        more = f"; and {len(names) - NAMED} more" if len(names) > NAMED else ""
        return "; ".join(self._named(name) for name in names[:NAMED]) + more

    def _named(self, name: str) -> str:
        words = self._said(name)
        return f"{title(name)} ({words})" if words else title(name)
