"""Columns of every control step: one table from which recordings are written, exported and explained.

A row is a column of the table that `pirrht export` makes: its value of a step, and the component at `/steps` of a
recording that holds it. To keep one more number of every step is to add one row here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.recording.step_row import Row

Values = Callable[["Row"], Iterable[Any]]


@dataclass(frozen=True, slots=True)
class Column:
    """A column, or several of one kind."""

    name: str  # in the table; K stands for 1, 2, ... and ID for a class
    unit: str
    text: str
    values: Values | None = None  # of a step, none where it has none; None: it follows from something else
    component: str = ""  # that holds them; by default the name up to K or ID
    at: int = 0  # place of the first value that belongs here
    kind: type[float] | type[int] | type[str] = float
    optional: bool = False  # whether the column is left out where no step has a value

    def __post_init__(self) -> None:
        object.__setattr__(self, "component", self.component or re.split("_K|:ID", self.name)[0])

    @property
    def many(self) -> bool:
        """Return whether it stands for one column per number K."""
        return self.name.endswith("_K")

    @property
    def by_class(self) -> bool:
        """Return whether it stands for one column per class."""
        return self.name.endswith(":ID")

    def describes(self, name: str) -> bool:
        """Return whether a column of the table is of this kind."""
        return re.fullmatch(self.name.replace("_K", r"_\d+").replace(":ID", ":.+"), name) is not None


def _end(r: Row) -> Iterable[float]:
    """Return the last state of the run; other steps end where the next one begins."""
    return r.states[-1] if r.outcome is not None and len(r.states) else ()


CONTROL = "m/s, m/s^2 or 1"
WHERE = (  # entries of the state, at the start of a step and at its end
    ("x", "m", "position {}", 0),
    ("y", "m", "position {}", 1),
    ("heading", "rad", "heading of a car {}", 2),
    ("vx", "m/s", "velocity along x of a mass {}", 2),
    ("vy", "m/s", "velocity along y of a mass {}", 3),
    ("speed", "m/s", "speed of a car ahead {}, where that is state", 3),
    ("state_K", "", "entry K of the state {}, from 1, where it has no name here", 3),
)
HEADING = {"at its start": "at its start, counter-clockwise from x"}


def _where(when: str, stem: str, values: Values, component: str) -> list[Column]:
    texts = [text.format(HEADING.get(when, when) if name == "heading" else when) for name, _, text, _ in WHERE]
    return [
        Column(stem + name, unit, text, values, component, at)
        for (name, unit, _, at), text in zip(WHERE, texts, strict=True)
    ]


COLUMNS = (
    Column("step", "1", "number of the control step, from 0", kind=int),
    Column("time", "s", "simulated time at its start"),
    Column("duration", "s", "simulated time it took", lambda r: [r.duration]),
    *_where("at its start", "", lambda r: r.state, "state"),
    Column(
        "control_K", CONTROL,
        "u at its start: velocity of a point, steering of a car, acceleration of a mass, speed and turn rate "
        "of a rover",
        lambda r: r.control,
    ),
    Column("noise_K", "sqrt(s)", "sum of the Brownian increments over the step", lambda r: r.noise.sum(axis=0)),
    *_where("at its end", "end_", _end, "end"),
    Column(
        "cost", "cost", "integral of q + u'Ru/2 from the start of the run to the end of the step", lambda r: [r.cost]
    ),
    Column(
        "length", "m", "driven up to the end of the step, without the path's noise (path_length)", lambda r: [r.length]
    ),
    Column("clearance", "m", "clearance of the footprint at the start of the step", lambda r: [r.clearance]),
    Column("value", "cost", "estimate of v = -lambda log psi; infinite if no sample survived", lambda r: [r.value]),
    Column("value_error", "cost", "its standard error; 0 if exact, infinite if unknown", lambda r: [r.value_error]),
    Column(
        "control_error_K", CONTROL, "standard error of u; 0 if exact, infinite if unknown", lambda r: r.control_error
    ),
    Column(
        "doubtful", "1", "1 where v and u rest on fewer than 10 effective samples", lambda r: [r.doubtful], kind=int
    ),
    Column(
        "exact_value", "cost", "v, solved for on a grid (`run --truth`)",
        lambda r: [] if r.truth is None else [r.truth.value], optional=True,
    ),
    Column(
        "exact_control_K", CONTROL, "the optimal control u* (`run --truth`)",
        lambda r: [] if r.truth is None else r.truth.control, optional=True,
    ),
    Column(
        "weight:ID", "1", "share of psi of a homology class; NaN if no sample survived", lambda r: r.weights.values(),
        "weights",
    ),
    Column("ess:ID", "1", "effective sample size of a homology class", lambda r: r.sizes.values()),
    Column("vertices", "1", "of the tree that the plan was made with", lambda r: [r.vertices], kind=int),
    Column("plan_ms", "ms", "wall time of the plan"),
    Column(
        "outcome", "", "goal, collision or timeout in the last row, empty before",
        lambda r: [] if r.outcome is None else [r.outcome.name.lower()], kind=str,
    ),
)  # fmt: skip
CLASSES = Column("classes", "", "ids of the classes that weights and sizes belong to", lambda r: r.weights, kind=str)


def components() -> dict[str, Column]:
    """Return the components written at `/steps`, each by one of its columns."""
    return {c.component: c for c in (CLASSES, *COLUMNS) if c.values is not None}


def of_states(columns: Sequence[Column], states: Sequence[str]) -> tuple[Column, ...]:
    """Those columns that a system has whose states have these names (n,), each at its place in the state."""
    named = {column.name for column in columns if column.component == "state"}
    found: list[Column] = []
    for column in columns:
        if column.component not in ("state", "end"):
            found.append(column)
        elif column.many:
            stem = column.name.removesuffix("K")
            rest = [i for i, name in enumerate(states) if name not in named]
            found += [replace(column, name=f"{stem}{i + 1}", at=i) for i in rest]
        elif (name := column.name.removeprefix("end_")) in states:
            found.append(replace(column, at=states.index(name)))
    return tuple(found)


def described(name: str) -> Column:
    """The description of a column of the table."""
    return next((c for c in COLUMNS if c.describes(name)), Column(name, "", ""))


def explained() -> str:
    """All columns as text, one per line."""
    width, unit = (max(len(text) for text in texts) for texts in zip(*((c.name, c.unit) for c in COLUMNS), strict=True))
    lines = (f"  {c.name:{width}}  {f'[{c.unit}]' if c.unit else '':{unit + 2}}  {c.text}" for c in COLUMNS)
    return "\n".join(lines)
