"""Clocks that real-time runs go by, how well these keep their times, and work that gives way to them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event
from typing import Any, Protocol

import numpy as np

from pirrht.arrays import Array

LONGEST = 0.1  # what gives way goes on after this time in any case, lest it never end [s]


class Clock(Protocol):
    """Tells the time and lets it pass."""

    def now(self) -> float:
        """Time since some moment [s]."""

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""


class WallClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Time since some moment [s]."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""
        rest = until - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timing:
    """One control period of a real-time drive."""

    missed: bool  # its plan was not ready when it began
    samples: int | None  # of the plan that it began with; None if that is an older one, or the first
    slack: float | None  # time between the end of planning and the period's beginning [s]; None likewise
    late: Array  # (k,) how late each physics step began [s]


def figures(timings: Sequence[Timing], period: float) -> dict[str, Any]:
    """The figures of a drive under the names of the public JSON."""
    samples = [t.samples for t in timings if t.samples is not None]
    slack = [1e3 * t.slack for t in timings if t.slack is not None]
    late = 1e3 * np.concatenate([t.late for t in timings])
    return {
        "period": period,
        "periods": len(timings),
        "deadline_misses": sum(t.missed for t in timings),
        "samples_per_period": {"median": _of(np.median, samples), "min": _of(np.min, samples)},
        "slack_ms": {"median": _of(np.median, slack), "min": _of(np.min, slack)},
        "late_ms": {"median": float(np.median(late)), "p99": float(np.percentile(late, 99)), "max": float(late.max())},
    }


def summary(figures: Mapping[str, Any]) -> str:
    """Sum up `figures` in a line for a person."""
    samples, slack, late = figures["samples_per_period"], figures["slack_ms"], figures["late_ms"]
    return (
        f"real time: {figures['deadline_misses']} of {figures['periods']} plans late; samples per period "
        f"{_text(samples['median'])} (least {_text(samples['min'])}), slack {_text(slack['median'])} ms "
        f"(least {_text(slack['min'])}); physics steps late by {late['median']:.2g} ms, p99 {late['p99']:.2g}, "
        f"max {late['max']:.2g}"
    )


def _of(function: Any, values: Sequence[float]) -> float | None:
    return float(function(values)) if values else None


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.0f}"


class Urgent:
    """Priority of what a clock waits for.

    Attributes:
        clocked: whether a drive runs against the clock, after which there will be more time.
    """

    def __init__(self) -> None:
        self.clocked = False
        self._idle = Event()
        self._idle.set()

    @contextmanager
    def drive(self) -> Iterator[None]:
        """A drive runs against the clock meanwhile."""
        self.clocked = True
        try:
            yield
        finally:
            self.clocked = False

    @contextmanager
    def work(self) -> Iterator[None]:
        """Everything else gives way meanwhile."""
        self._idle.clear()
        try:
            yield
        finally:
            self._idle.set()

    def give_way(self) -> None:
        """Return when nothing is urgent, or after LONGEST."""
        self._idle.wait(LONGEST)


URGENT = Urgent()  # the interpreter is one for all, too
