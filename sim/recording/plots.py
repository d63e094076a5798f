"""The plots of the tab Why: class weights, value, samples, and what the robot does; with a truth how far that is off.

Plots of classes have one line for all other classes, then one for each of a few classes as they gain weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, log

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.estimation.estimate import OTHER
from pirrht.problem import Problem
from sim.drawing.colors import DRIVEN, ClassColors, Color, title
from sim.recording.step_row import Row
from sim.recording.stream import Stream
from sim.recording.truth_view import OPTIMUM

LINES, CHEAPEST, HEAVY = 8, 6, 0.01  # classes in the plots: at most, from the start, from this weight on
BAND = "one standard error"
PRECISION = 2**15
DIM = (120, 122, 128)
PLAIN = (164, 128, 230)  # of what belongs to no class; seen on dark ground as well as on a browser's white


class Plots:
    """Logs the numbers behind the control into one recording stream."""

    def __init__(self, stream: Stream, problem: Problem, colors: ClassColors, *, truth: bool) -> None:
        self._stream, self._temperature, self._colors = stream, problem.temperature, colors
        self._controls = problem.dynamics.m
        self._truth = truth  # whether steps come with the exact value and the optimal control
        self._favourite: str | None = None
        self._lines: list[str] | None = None  # classes that have a line of their own

    def begin(self) -> None:
        """Names and colours that do not change."""
        m = self._controls
        self._style("/why/clearance", ["clearance"], [PLAIN], [1.6])
        self._style("/why/control", [f"u{k + 1}" for k in range(m)], [PLAIN, DRIVEN, OPTIMUM, DIM][:m], [1.6] * m)
        self._style("/why/cost", ["so far", "with the value of what is left"], [DRIVEN, PLAIN], [2.0, 1.2])
        if self._truth:
            self._style("/why/optimum/control", [BAND, "|u - u*|"], [DIM, OPTIMUM], [1.0, 2.0])
            names, colors = [BAND, BAND, "all paths", "exact"], [DIM, DIM, PLAIN, OPTIMUM]
            self._style("/why/optimum/value", names, colors, [1.0, 1.0, 1.2, 2.0])

    def draw(self, rows: Sequence[Row]) -> None:
        """Log some steps."""
        names = self._name_classes(rows)
        spare = [inf] * (LINES - len(names))  # infinite: NaN would make equal recordings compare unequal
        weights, sizes, arriving, values = [], [], [], []
        for r in rows:
            share = [r.weights.get(name, 0.0) for name in names]
            weights.append([max(0.0, sum(r.weights.values()) - sum(share)), *share, *spare])
            sizes.append([r.sizes.get(OTHER, 0.0), *(r.sizes.get(name, 0.0) for name in names), *spare])
            arriving.append([inf, *(r.arriving.get(name, inf) for name in names), *spare])
            by_class = [r.value - self._temperature * log(w) if w > 0 else inf for w in share]
            exact = [] if r.truth is None else [r.truth.value]
            values.append([r.value, *_band(r.value, r.value_error), *by_class, *spare, *exact])
        for path, lines in (("weight", weights), ("ess", sizes), ("arriving", arriving), ("value", values)):
            self._log(path, rows, lines)
        self._log("clearance", rows, [[r.clearance] for r in rows])
        self._log("control", rows, [r.control for r in rows])
        self._log("cost", rows, [[r.cost, r.cost + r.value] for r in rows])
        if known := [(r, r.truth) for r in rows if r.truth is not None]:
            off, errors = [], []
            for r, truth in known:
                off.append([float(np.linalg.norm(r.control_error)), truth.distance(r.control)])
                error = r.value - truth.value if r.value < inf and truth.value < inf else inf
                errors.append([*_band(error, r.value_error), error, 0.0])
            self._log("optimum/control", [r for r, _ in known], off)
            self._log("optimum/value", [r for r, _ in known], errors)
        for row in rows:
            if row.favourite is not None:
                if self._favourite not in (None, row.favourite):
                    self._stream.log("/why/weight/switch", row.step, row.time, rr.Scalars(1.03))
                self._favourite = row.favourite

    def _name_classes(self, rows: Sequence[Row]) -> list[str]:
        """Give colours to new classes, and return those with lines: the cheapest at first, then the heavy."""
        names = list(self._lines or ())
        for row in rows:
            self._colors.meet(row.ids)
            heavy = [name for name, w in row.weights.items() if w >= HEAVY and name != OTHER]
            for name in [*(row.ids[:CHEAPEST] if not names else ()), *heavy]:
                if name not in names and len(names) < LINES:
                    names.append(name)
        if names == self._lines:
            return names
        self._lines = names
        # The viewer requires equal numbers of lines at all times; those of equal name share a place in its legend.
        every = [OTHER, *names, *[OTHER] * (LINES - len(names))]
        titles = [OTHER if name == OTHER else f"class {title(name)}" for name in every]
        colors, widths = [self._colors[name] for name in every], [2.5] * len(every)
        for path in ("/why/weight", "/why/ess", "/why/arriving"):
            self._style(path, titles, colors, widths)
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [PLAIN if name == OTHER else color for name, color in zip(every, colors, strict=True)]
        titles[1:1], colors[1:1], widths[1:1] = [BAND] * 2, [PLAIN] * 2, [0.8] * 2
        if self._truth:
            titles, colors, widths = [*titles, "exact"], [*colors, OPTIMUM], [*widths, 1.2]
        self._style("/why/value", titles, colors, widths)
        return names

    def _style(self, path: str, names: Sequence[str], colors: Sequence[Color], widths: Sequence[float]) -> None:
        self._stream.static(path, rr.SeriesLines(names=names, colors=colors, widths=widths))

    def _log(self, path: str, rows: Sequence[Row], table: Sequence[Sequence[float] | Array]) -> None:
        """Log values to one part in 2^15: what a plot can show; the zero bytes left behind cost nothing in a file."""
        mantissa, exponent = np.frexp(np.array(table))
        short = np.ldexp(np.rint(mantissa * PRECISION) / PRECISION, exponent)
        columns = rr.Scalars.columns(scalars=short.ravel()).partition([short.shape[1]] * len(rows))
        self._stream.columns(f"/why/{path}", [r.step for r in rows], [r.time for r in rows], columns)


def _band(value: float, error: float) -> list[float]:
    """One standard error below and above a value, infinite if that is."""
    return [value - error, value + error] if value < inf else [inf, inf]
