"""A control step in a recording, and the numbers that are kept of it at `/steps`.

At its start: state [m, m, rad], control, clearance [m], vertices of the tree, value, value_error and control_error
(one standard error), doubtful (1 where the plan rests on fewer than 10 effective samples), where a grid was solved
exact_value and exact_control, and class by class in the same order classes (ids and "other"), weights, ess. Over it:
duration [s], noise (sum of the Brownian increments) [sqrt(s)]. Up to its end: cost, length [m]. The last one has the
state where the drive ended, and the outcome. `columns.py` has them as a table.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import inf
from typing import Any

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.outcome import Outcome
from sim.drive.episode import Frame
from sim.drive.truth import Truth

Edges = tuple[Array, Array]  # ends (k, 2, 3) [m, m, turns] and heights of their middles (k,) [turns]


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

    @classmethod
    def of(
        cls,
        frame: Frame,
        drawn: bool,
        news: str | None,
        truth: Truth | None = None,
        growth: tuple[Edges, ...] = (),
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


def columns(rows: Sequence[Row]) -> list[Any]:
    """The table's columns for some steps; step and time are its index."""
    truths = [r.truth for r in rows if r.truth is not None]
    return [
        *_values(state=[r.state for r in rows]),
        *_values(control=[r.control for r in rows]),
        *_values(noise=[r.noise.sum(axis=0) for r in rows]),
        *_values(duration=[r.duration for r in rows]),
        *_values(cost=[r.cost for r in rows]),
        *_values(length=[r.length for r in rows]),
        *_values(clearance=[r.clearance for r in rows]),
        *_values(vertices=[r.vertices for r in rows]),
        *_values(value=[r.value for r in rows]),
        *_values(value_error=[r.value_error for r in rows]),
        *_values(control_error=[r.control_error for r in rows]),
        *_values(doubtful=[r.doubtful for r in rows]),
        *_ragged("classes", [list(r.weights) for r in rows]),
        *_ragged("weights", [list(r.weights.values()) for r in rows]),
        *_ragged("ess", [list(r.sizes.values()) for r in rows]),
        *(_values(exact_value=[t.value for t in truths]) if truths else ()),
        *(_values(exact_control=[t.control for t in truths]) if truths else ()),
        *_ragged("end", [r.states[-1].tolist() if r.outcome is not None and len(r.states) else [] for r in rows]),
        *_ragged("outcome", [[] if r.outcome is None else [r.outcome.name.lower()] for r in rows]),
    ]


def _values(**named: Sequence[Any]) -> Iterable[Any]:
    """One named component with equally many numbers per step."""
    ((name, rows),) = named.items()
    return _ragged(name, np.asarray(rows, dtype=float).reshape(len(rows), -1).tolist())


def _ragged(name: str, rows: Sequence[list[Any]]) -> Iterable[Any]:
    """One named component with any number of values per step."""
    flat = list(chain.from_iterable(rows))
    if not flat:
        return ()
    columns: Iterable[Any] = rr.AnyValues.columns(**{name: flat}).partition([len(row) for row in rows])
    return columns
