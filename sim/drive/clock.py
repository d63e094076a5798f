"""The clock of real-time runs, how well these keep their times, and work that gives way to them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np

from pirrht.arrays import Array

LONGEST_WAIT = 0.1  # after which work that gives way continues in any case [s]


class Clock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Time since some moment [s]."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""
        rest = until - self.now()
        if rest > 0.0:
            time.sleep(rest)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timing:
    """One control period of a real-time run."""

    missed: bool  # its plan was not ready when it began
    samples: int | None  # of the plan that it began with; None if that is an older one, or the first
    slack: float | None  # time between the end of planning and the period's beginning [s]; None as for the samples
    late: Array  # (k,) how late each physics step began [s]


def figures(timings: Sequence[Timing], period: float) -> dict[str, Any]:
    """The figures of a run under the names of the public JSON."""
    late = 1e3 * np.concatenate([t.late for t in timings])
    return {
        "period": period,
        "periods": len(timings),
        "deadline_misses": sum(t.missed for t in timings),
        "samples_per_period": _spread([t.samples for t in timings if t.samples is not None]),
        "slack_ms": _spread([1e3 * t.slack for t in timings if t.slack is not None]),
        "late_ms": {"median": float(np.median(late)), "p99": float(np.percentile(late, 99)), "max": float(late.max())},
    }


def _spread(values: Sequence[float]) -> dict[str, float | None]:
    known = (float(np.median(values)), float(np.min(values))) if values else (None, None)
    return dict(zip(("median", "min"), known, strict=True))


def summary(figures: Mapping[str, Any]) -> str:
    """Sum up `figures` in a line for a person."""

    def texts(name: str) -> dict[str, str]:
        return {key: "none" if value is None else f"{value:.0f}" for key, value in figures[name].items()}

    samples, slack, late = texts("samples_per_period"), texts("slack_ms"), figures["late_ms"]
    return (
        f"real time: {figures['deadline_misses']} of {figures['periods']} plans late; samples per period "
        f"{samples['median']} (least {samples['min']}), slack {slack['median']} ms (least {slack['min']}); "
        f"physics steps late by {late['median']:.2g} ms, p99 {late['p99']:.2g}, max {late['max']:.2g}"
    )


class PlannerPriority:
    """Priority of planning that a clock waits for."""

    def __init__(self) -> None:
        self.clocked = False  # whether a run goes by the clock, after which there will be more time
        self._idle = Event()
        self._idle.set()

    @contextmanager
    def work(self) -> Iterator[None]:
        """Let everything else give way meanwhile."""
        self._idle.clear()
        try:
            yield
        finally:
            self._idle.set()

    def give_way(self) -> None:
        """Return when nothing is urgent, or after LONGEST_WAIT."""
        self._idle.wait(LONGEST_WAIT)


URGENT = PlannerPriority()  # the interpreter is one for all, too
