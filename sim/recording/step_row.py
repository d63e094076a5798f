"""A control step as a recording sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.outcome import Outcome
from sim.drive.episode import Frame
from sim.drive.metrics import Truth
from sim.recording.columns import cells
from sim.recording.reasons import arriving


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Row:
    """One control step; it holds on to samples, of which there may be many, only where they are drawn."""

    step: int
    time: float  # simulated time at its start [s]
    duration: float  # [s]
    states: Array  # (k + 1, n) at its start and after each physics step
    cells: dict[str, list[Any]]  # its values at `/steps`, by component
    arriving: dict[str, float]  # share of the samples drawn around each reference that arrive
    ids: tuple[str, ...]  # classes of the references
    plan_seconds: float
    outcome: Outcome | None
    plan: Plan | None  # where a picture is due
    news: str | None

    @classmethod
    def of(cls, frame: Frame, drawn: bool, news: str | None, truth: Truth | None) -> Row:
        """The row of a frame."""
        plan, advance, estimate = frame.plan, frame.advance, frame.plan.estimate
        return cls(
            step=frame.step, time=frame.time, duration=advance.time, states=np.vstack([plan.state, advance.states]),
            cells=cells(frame, truth),
            arriving=arriving(estimate, plan.ids) if estimate else {},
            ids=plan.ids, plan_seconds=frame.plan_seconds, outcome=frame.outcome, plan=plan if drawn else None,
            news=news,
        )  # fmt: skip

    def __getitem__(self, component: str) -> float:
        return float(self.cells[component][0])
