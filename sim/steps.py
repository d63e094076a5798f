"""A control step in a recording, and the table that all of them make: what its columns mean, in which unit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import inf
from typing import Any

import numpy as np
import rerun as rr

from pirrht.outcome import Outcome
from pirrht.plan import Plan
from pirrht.scene import Array
from sim.episode import Frame
from sim.truth import Truth


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column of the table of steps."""

    name: str
    unit: str
    text: str


COLUMNS = (
    Column(name="step", unit="1", text="number of the control step, from 0"),
    Column(name="sim_time", unit="s", text="simulated time at its start"),
    Column(name="state", unit="m, m, rad", text="where it began: x, y and, of a car, heading"),
    Column(name="control", unit="control", text="u chosen there"),
    Column(name="noise", unit="sqrt(s)", text="sum of the Brownian increments over the step"),
    Column(name="duration", unit="s", text="simulated time the step took"),
    Column(name="cost", unit="cost", text="integral of q + u'Ru/2 up to the end of the step"),
    Column(name="length", unit="m", text="driven up to the end of the step"),
    Column(name="clearance", unit="m", text="room around the robot at the start of the step"),
    Column(name="vertices", unit="1", text="vertices of the tree that the plan was made with"),
    Column(name="value", unit="cost", text="estimate of v = -lambda log psi; infinite without surviving samples"),
    Column(name="value_error", unit="cost", text="its standard error; 0 for a value that is exact"),
    Column(name="control_error", unit="control", text="standard error of u; infinite where it is not known"),
    Column(name="classes", unit="id", text='homology classes of the samples, "other" for those without a reference'),
    Column(name="weights", unit="1", text="share of psi of each of these classes"),
    Column(name="ess", unit="1", text="effective sample size of each of these classes"),
    Column(name="exact_value", unit="cost", text="v, solved for on a grid (only with --truth)"),
    Column(name="exact_control", unit="control", text="the optimal control u* (only with --truth)"),
)


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
    truth: Truth | None  # where a grid was solved
    favourite: str | None  # class of greatest weight, None in a fallback
    plan_seconds: float
    outcome: Outcome | None
    plan: Plan | None  # where a picture is due
    news: str | None

    @classmethod
    def of(cls, frame: Frame, drawn: bool, news: str | None, truth: Truth | None = None) -> Row:
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
            truth=truth,
            favourite=plan.favourite if estimate else None,
            plan_seconds=frame.plan_seconds,
            outcome=frame.outcome,
            plan=plan if drawn else None,
            news=news,
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
        *_ragged("classes", [list(r.weights) for r in rows]),
        *_ragged("weights", [list(r.weights.values()) for r in rows]),
        *_ragged("ess", [list(r.sizes.values()) for r in rows]),
        *(_values(exact_value=[t.value for t in truths]) if truths else ()),
        *(_values(exact_control=[t.control for t in truths]) if truths else ()),
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
