"""A control step as a recording sees it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.outcome import Outcome
from sim.drive.episode import Frame
from sim.drive.metrics import Truth
from sim.recording.reasons import arriving


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

    @property
    def size(self) -> int:
        """About how much memory it holds on to [bytes]: samples and tables, where a picture is to be made of them."""
        estimate = None if self.plan is None else self.plan.estimate
        if estimate is None:
            return self.states.nbytes
        arrays = [array for part in estimate.parts for array in (*part.paths, part.tables.law, part.tables.control)]
        return sum(array.nbytes for array in arrays)

    @classmethod
    def of(cls, frame: Frame, drawn: bool, news: str | None, truth: Truth | None = None) -> Row:
        """The row of a frame."""
        plan, advance, estimate = frame.plan, frame.advance, frame.plan.estimate
        value, value_error = (inf, inf) if plan.exact is None else (plan.exact, 0.0)
        if estimate is not None:
            value, value_error = estimate.value, estimate.value_error
        return cls(
            step=frame.step, time=frame.time, duration=advance.time, state=plan.state, control=plan.control.copy(),
            states=advance.states, noise=advance.noise, cost=frame.cost, length=frame.length,
            clearance=frame.clearance, vertices=frame.vertices, ids=plan.ids,
            weights=estimate.class_weights if estimate else {}, sizes=estimate.class_ess if estimate else {},
            arriving=arriving(estimate, plan.ids) if estimate else {}, value=value, value_error=value_error,
            control_error=estimate.control_error if estimate else np.full(advance.noise.shape[1], value_error),
            doubtful=estimate is not None and estimate.doubtful, truth=truth,
            favourite=plan.favourite if estimate else None, plan_seconds=frame.plan_seconds, outcome=frame.outcome,
            plan=plan if drawn else None, news=news,
        )  # fmt: skip
