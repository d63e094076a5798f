"""Columns of every control step: one table from which recordings are written, exported and explained.

A row is a column of the table that `pirrht export` makes: its values of a step, and the component at `/steps` of a
recording that holds them. To keep one more number of every step is to add one row here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.states import ADAPTERS, Component

if TYPE_CHECKING:
    from sim.drive.metrics import Frame

Values = Callable[["Frame"], Iterable[Any]]


@dataclass(frozen=True, slots=True)
class Column:
    """A column, or several of one kind."""

    name: str  # in the table; K stands for 1, 2, ... and ID for a class
    unit: str
    text: str
    values: Values | None = None  # of a step, none where it has none; None: it follows from something else
    component: str = ""  # that holds them; by default the name up to K or ID
    kind: type[float] | type[int] | type[str] = float
    optional: bool = False  # whether the column is left out where no step has a value

    def __post_init__(self) -> None:
        object.__setattr__(self, "component", self.component or self.name.removesuffix("_K").removesuffix(":ID"))

    def places(self, states: Sequence[str], width: int) -> dict[str, int]:
        """Return the names of its columns, and the place of each among values that are `width` at most.

        Args:
            states: names of the states (n,) of the system, which columns of the state go by.
        """
        if self.component not in ("state", "end"):
            many = {self.name.replace("K", str(k + 1)): k for k in range(width)}
            return many if self.name.endswith("_K") else {self.name: 0} if width or not self.optional else {}
        bare = self.name.removeprefix("end_")
        mine = [i for i, name in enumerate(states) if (name if name in STATES else "state_K") == bare]
        return {self.name.replace("K", str(i + 1)): i for i in mine}


def _estimated(name: str) -> Values:
    """Take an attribute of the estimate; a value that is known without samples has no error."""

    def values(frame: Frame) -> Iterable[Any]:
        exact, many = frame.plan.exact, frame.advance.noise.shape[1] if name == "control_error" else 1
        if frame.plan.estimate is not None:
            return np.atleast_1d(getattr(frame.plan.estimate, name))
        return [inf if exact is None else exact * (name == "value")] * many

    return values


def _by_class(name: str) -> Values:
    return lambda f: getattr(f.plan.estimate, name).values() if f.plan.estimate else ()


CONTROL = "m/s, m/s^2 or 1"
UNNAMED = Component("", "entry K of the state {}, from 1, where it has no name here", "")
STATES = dict(chain.from_iterable(one.components.items() for one in ADAPTERS)) | {"state_K": UNNAMED}


def _states(prefix: str, when: str, turned: str, values: Values) -> list[Column]:
    return [
        Column(prefix + name, c.unit, c.text.format(turned if c.turned else when), values, prefix[:-1] or "state")
        for name, c in STATES.items()
    ]


COLUMNS = (
    Column("step", "1", "number of the control step, from 0", kind=int),
    Column("time", "s", "simulated time at its start"),
    Column("duration", "s", "simulated time it took", lambda f: [f.advance.time]),
    *_states("", "at its start", "at its start, counter-clockwise from x", lambda f: f.plan.state),
    Column("control_K", CONTROL, "u at its start: velocity of a point, steering of a car, acceleration of a mass, "
           "speed and turn rate of a rover", lambda f: f.plan.control),
    Column("noise_K", "sqrt(s)", "sum of the Brownian increments over the step",
           lambda f: f.advance.noise.sum(axis=0)),
    # Other steps end where the next one begins.
    *_states("end_", "at its end", "at its end",
             lambda f: f.state if f.outcome is not None and len(f.advance.states) else ()),
    Column("cost", "cost", "integral of q + u'Ru/2 from the start of the run to the end of the step",
           lambda f: [f.cost]),
    Column("length", "m", "driven up to the end of the step, without the path's noise (path_length)",
           lambda f: [f.length]),
    Column("clearance", "m", "free distance around the robot at the start of the step", lambda f: [f.clearance]),
    Column("value", "cost", "estimate of v = -lambda log psi; infinite if no sample survived", _estimated("value")),
    Column("value_error", "cost", "its standard error; 0 if exact, infinite if unknown", _estimated("value_error")),
    Column("control_error_K", CONTROL, "standard error of u; 0 if exact, infinite if unknown",
           _estimated("control_error")),
    Column("doubtful", "1", "1 where v and u rest on fewer than 10 effective samples",
           lambda f: [f.plan.estimate is not None and f.plan.estimate.doubtful], kind=int),
    Column("exact_value", "cost", "v, solved for on a grid (`run --truth`)",
           lambda f: [f.truth.value] if f.truth else [], optional=True),
    Column("exact_control_K", CONTROL, "the optimal control u* (`run --truth`)",
           lambda f: f.truth.control if f.truth else [], optional=True),
    Column("weight:ID", "1", "share of psi of a homology class; NaN if no sample survived", _by_class("class_weights"),
           "weights"),
    Column("ess:ID", "1", "effective sample size of a homology class", _by_class("class_ess")),
    Column("collision", "1", "predicted probability of a collision from its start on",
           lambda f: [f.collision.probability] if f.collision else [], optional=True),
    Column("collision_error", "1", "its standard error", lambda f: [f.collision.error] if f.collision else [],
           optional=True),
    Column("vertices", "1", "of the tree that the plan was made with", lambda f: [f.vertices], kind=int),
    Column("plan_ms", "ms", "wall time of the plan"),
    Column("outcome", "", "goal, collision or timeout in the last row, empty before",
           lambda f: [] if f.outcome is None else [f.outcome.name.lower()], kind=str),
)  # fmt: skip
CLASSES = Column("classes", "", "ids of the classes that weights and sizes belong to",
                 lambda f: f.plan.estimate.class_weights if f.plan.estimate else (), kind=str)  # fmt: skip
COMPONENTS = {c.component: c for c in (CLASSES, *COLUMNS) if c.values is not None}  # written at `/steps`


def cells(frame: Frame) -> dict[str, list[Any]]:
    """Return the values of a step by component."""
    return {
        name: [v if c.kind is str else float(v) for v in c.values(frame)]
        for name, c in COMPONENTS.items()
        if c.values is not None
    }


def explained() -> str:
    """All columns as text, one per line."""
    width, unit = (max(len(text) for text in texts) for texts in zip(*((c.name, c.unit) for c in COLUMNS), strict=True))
    lines = (f"  {c.name:{width}}  {f'[{c.unit}]' if c.unit else '':{unit + 2}}  {c.text}" for c in COLUMNS)
    return "\n".join(lines)
