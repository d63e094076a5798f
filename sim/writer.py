"""What a recording holds of a drive, batch by batch: numbers at every step, pictures where they are due.

/steps        a row per control step. At its start: state [m, m, rad], control, clearance [m]; over it:
              duration [s], noise (sum of the Brownian increments) [sqrt(s)]; up to its end: cost, length [m];
              value, value_error and control_error (one standard error); and class by class in the same
              order: classes (ids and "other"), weights, ess
/world/robot  pose, and as an arrow where the control would take it; one row more for where the drive ended
/world/path   position after every physics step
/why/weight   one line for all other classes, then one for each of a few classes as they gain weight; so `ess`
/why/value    -lambda log psi of all paths, one standard error below and above it, then of each of those classes
/log          what happened
/timing/plan  wall time of a plan [ms]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import inf, log
from typing import Any

import numpy as np
import rerun as rr

from pirrht.outcome import Outcome
from pirrht.path_integral import OTHER
from pirrht.plan import Plan
from pirrht.scene import Array
from sim.colors import ClassColors, title
from sim.drawing import lift
from sim.episode import Frame
from sim.pictures import Pictures
from sim.stage import CONTROL, Subject, properties, stage
from sim.stream import Stream

BATCH_STEPS = 32  # rows per chunk: a chunk costs 1 to 3 kB whatever it holds
BATCH_LEAST, BATCH_TIME = 8, 0.32  # fewer will do once they span so much simulated time [s]
LINES, CHEAPEST, HEAVY = 8, 6, 0.01  # classes in the plots: at most, from the start, from this weight on
BAND = "one standard error"
AHEAD = 0.5  # the arrow reaches where the control would take the robot in this time [s]


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
    ids: tuple[str, ...]  # classes of the references
    weights: dict[str, float]  # by class; empty in a fallback
    sizes: dict[str, float]  # effective sample size by class
    value: float  # infinite in a fallback
    value_error: float  # infinite where it is not known; 0 for a value that is exact
    control_error: Array  # (m,)
    favourite: str | None  # class of greatest weight, None in a fallback
    plan_seconds: float
    outcome: Outcome | None
    plan: Plan | None  # where a picture is due
    news: str | None

    @classmethod
    def of(cls, frame: Frame, drawn: bool, news: str | None) -> Row:
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
            ids=plan.ids,
            weights=estimate.class_weights if estimate else {},
            sizes=estimate.class_ess if estimate else {},
            value=value,
            value_error=value_error,
            control_error=estimate.control_error if estimate else np.full(advance.noise.shape[1], value_error),
            favourite=plan.favourite if estimate else None,
            plan_seconds=frame.plan_seconds,
            outcome=frame.outcome,
            plan=plan if drawn else None,
            news=news,
        )


class Writer:
    """Writes one recording into a stream; runs on one thread."""

    def __init__(self, stream: Stream, subject: Subject) -> None:
        self.stream, self._subject = stream, subject
        self._colors = ClassColors()
        self._pictures = Pictures(stream, subject, self._colors)
        self._favourite: str | None = None
        self._lines: list[str] = []  # classes that have a line of their own in the plots
        self._batch: list[Row] = []

    def begin(self) -> None:
        """Everything that stays as it is."""
        subject = self._subject
        self.stream.properties(properties(subject.settings), name=subject.name)
        stage(subject, self.stream.static)

    def add(self, row: Row) -> bool:
        """Take in a step; whether its batch was written, which depends on steps and simulated time alone."""
        self._batch.append(row)
        count, span = len(self._batch), row.time + row.duration - self._batch[0].time
        long_enough = count >= BATCH_LEAST and span >= BATCH_TIME - 1e-9
        if count < BATCH_STEPS and not long_enough and row.outcome is None:
            return False
        self._write()
        return True

    def end(self) -> None:
        """Write what is left and close the stream."""
        if self._batch:
            self._write()
        self.stream.close()

    def _write(self) -> None:
        rows, self._batch = self._batch, []
        self._name_classes(rows)
        self._numbers(rows)
        self._robot(rows)
        self._why(rows)
        self._columns("/timing/plan", rows, rr.Scalars.columns(scalars=[1e3 * r.plan_seconds for r in rows]))
        for row in rows:
            self._mark_switch(row)
            if row.news is not None:
                self.stream.log("/log", row.step, row.time, rr.TextLog(row.news, level="INFO"))
            if row.plan is not None:
                self._pictures.draw(row.plan, row.step, row.time)

    def _name_classes(self, rows: Sequence[Row]) -> None:
        """Give colours to new classes, and lines in the plots: to the cheapest at first, then to the heavy."""
        before = list(self._lines)
        for row in rows:
            self._colors.meet(row.ids)
            heavy = [name for name, w in row.weights.items() if w >= HEAVY and name != OTHER]
            for name in [*(row.ids[:CHEAPEST] if not self._lines else ()), *heavy]:
                if name not in self._lines and len(self._lines) < LINES:
                    self._lines.append(name)
        if self._lines != before:
            self._name_lines()

    def _name_lines(self) -> None:
        # The viewer wants the same number of lines at all times; those of equal name share a place in its legend.
        spare = LINES - len(self._lines)
        titles = [OTHER, *(f"class {title(name)}" for name in self._lines), *[OTHER] * spare]
        colors = [self._colors[name] for name in [OTHER, *self._lines, *[OTHER] * spare]]
        widths = [2.5] * len(titles)
        for path in ("/why/weight", "/why/ess"):
            self.stream.static(path, rr.SeriesLines(names=titles, colors=colors, widths=widths))
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [CONTROL if color == self._colors[OTHER] else color for color in colors]
        titles[1:1], colors[1:1], widths[1:1] = [BAND] * 2, [CONTROL] * 2, [0.8] * 2
        self.stream.static("/why/value", rr.SeriesLines(names=titles, colors=colors, widths=widths))

    def _numbers(self, rows: Sequence[Row]) -> None:
        self._columns(
            "/steps",
            rows,
            [
                *_values(state=[r.state for r in rows]),
                *_values(control=[r.control for r in rows]),
                *_values(noise=[r.noise.sum(axis=0) for r in rows]),
                *_values(duration=[r.duration for r in rows]),
                *_values(cost=[r.cost for r in rows]),
                *_values(length=[r.length for r in rows]),
                *_values(clearance=[r.clearance for r in rows]),
                *_values(value=[r.value for r in rows]),
                *_values(value_error=[r.value_error for r in rows]),
                *_values(control_error=[r.control_error for r in rows]),
                *_ragged("classes", [list(r.weights) for r in rows]),
                *_ragged("weights", [list(r.weights.values()) for r in rows]),
                *_ragged("ess", [list(r.sizes.values()) for r in rows]),
            ],
        )

    def _robot(self, rows: Sequence[Row]) -> None:
        states = np.array([r.state for r in rows])
        arrows = [self._ahead(r.state, r.control) for r in rows]
        pose = rr.Transform3D.columns(translation=_spatial(states), quaternion=_turned(states))
        self._columns("/world/robot", rows, [*pose, *rr.Arrows3D.columns(vectors=arrows)])
        pieces = [lift(np.vstack([r.state[:2], r.states[:, :2]]), 0.06) for r in rows]
        self._columns("/world/path", rows, rr.LineStrips3D.columns(strips=pieces))
        last = rows[-1]
        if last.outcome is not None and len(last.states):
            end = last.states[-1:]
            pose = rr.Transform3D(translation=_spatial(end)[0], quaternion=_turned(end)[0])
            self.stream.log("/world/robot", last.step + 1, last.time + last.duration, pose)

    def _ahead(self, x: Array, u: Array) -> Array:
        """Where the control would take the robot in a short while without noise, in the robot's frame, (3,)."""
        dynamics = self._subject.path_integral.problem.dynamics
        start, still = x, np.zeros(dynamics.m)
        for _ in range(5):
            x = dynamics.step(x, u, still, AHEAD / 5)
        dx, dy = x[:2] - start[:2]
        c, s = (np.cos(start[2]), np.sin(start[2])) if len(start) > 2 else (1.0, 0.0)
        return np.array([c * dx + s * dy, c * dy - s * dx, 0.0])

    def _why(self, rows: Sequence[Row]) -> None:
        names, spare = self._lines, [inf] * (LINES - len(self._lines))
        weights, sizes, values = [], [], []
        temperature = self._subject.path_integral.temperature
        for r in rows:
            share = [r.weights.get(name, 0.0) for name in names]
            other = sum(r.weights.values()) - sum(share)
            weights.append([other, *share, *spare])
            sizes.append([r.sizes.get(OTHER, 0.0), *(r.sizes.get(name, 0.0) for name in names), *spare])
            # Infinite where no path was found: NaN would make equal recordings compare unequal.
            by_class = [r.value - temperature * log(w) if w > 0 else inf for w in share]
            band = [r.value - r.value_error, r.value + r.value_error] if r.value < inf else [inf, inf]
            values.append([r.value, *band, *by_class, *spare])
        for path, table in (("/why/weight", weights), ("/why/ess", sizes), ("/why/value", values)):
            flat = np.array(table)
            columns = rr.Scalars.columns(scalars=flat.ravel()).partition([flat.shape[1]] * len(rows))
            self._columns(path, rows, columns)

    def _mark_switch(self, row: Row) -> None:
        if row.favourite is None:
            return
        if self._favourite not in (None, row.favourite):
            self.stream.log("/why/weight/switch", row.step, row.time, rr.Scalars(1.03))
        self._favourite = row.favourite

    def _columns(self, path: str, rows: Sequence[Row], columns: Iterable[Any]) -> None:
        self.stream.columns(path, [r.step for r in rows], [r.time for r in rows], columns)


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


def _spatial(states: Array) -> Array:
    return np.column_stack([states[:, :2], np.zeros(len(states))])


def _turned(states: Array) -> Array:
    """Headings as quaternions (k, 4), scalar part last."""
    heading = states[:, 2] if states.shape[1] > 2 else np.zeros(len(states))
    zero = np.zeros(len(states))
    return np.column_stack([zero, zero, np.sin(0.5 * heading), np.cos(0.5 * heading)])
