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
from sim.drawing.colors import DRIVEN, ClassColors, title
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
        self._lines: list[str] = []  # classes that have a line of their own
        self._named = False

    def begin(self) -> None:
        """Names and colours that do not change."""
        controls = [f"u{k + 1}" for k in range(self._controls)]
        plain = (
            ("/why/clearance", ["clearance"], [PLAIN], [1.6]),
            ("/why/control", controls, [PLAIN, DRIVEN, OPTIMUM, DIM][: len(controls)], [1.6] * len(controls)),
            ("/why/cost", ["so far", "with the value of what is left"], [DRIVEN, PLAIN], [2.0, 1.2]),
        )
        of_truth = (
            ("/why/optimum/control", [BAND, "|u - u*|"], [DIM, OPTIMUM], [1.0, 2.0]),
            (
                "/why/optimum/value",
                [BAND, BAND, "all paths", "exact"],
                [DIM, DIM, PLAIN, OPTIMUM],
                [1.0, 1.0, 1.2, 2.0],
            ),
        )
        for path, names, colors, widths in (*plain, *(of_truth if self._truth else ())):
            self._stream.static(path, rr.SeriesLines(names=names, colors=colors, widths=widths))

    def draw(self, rows: Sequence[Row]) -> None:
        """Log some steps."""
        self._name_classes(rows)
        self._classes(rows)
        self._robot(rows)
        self._optimum(rows)
        for row in rows:
            self._mark_switch(row)

    def _name_classes(self, rows: Sequence[Row]) -> None:
        """Give colours to new classes, and lines in the plots: to the cheapest at first, then to the heavy."""
        before = list(self._lines)
        for row in rows:
            self._colors.meet(row.ids)
            heavy = [name for name, w in row.weights.items() if w >= HEAVY and name != OTHER]
            for name in [*(row.ids[:CHEAPEST] if not self._lines else ()), *heavy]:
                if name not in self._lines and len(self._lines) < LINES:
                    self._lines.append(name)
        if self._lines != before or not self._named:
            self._name_lines()
            self._named = True

    def _name_lines(self) -> None:
        # The viewer wants the same number of lines at all times; those of equal name share a place in its legend.
        spare = LINES - len(self._lines)
        titles = [OTHER, *(f"class {title(name)}" for name in self._lines), *[OTHER] * spare]
        colors = [self._colors[name] for name in [OTHER, *self._lines, *[OTHER] * spare]]
        widths = [2.5] * len(titles)
        lines = {"names": titles, "colors": colors}
        for path in ("/why/weight", "/why/ess", "/why/arriving"):
            self._stream.static(path, rr.SeriesLines(**lines, widths=widths))
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [PLAIN if color == self._colors[OTHER] else color for color in colors]
        titles[1:1], colors[1:1], widths[1:1] = [BAND] * 2, [PLAIN] * 2, [0.8] * 2
        if self._truth:
            titles, colors, widths = [*titles, "exact"], [*colors, OPTIMUM], [*widths, 1.2]
        self._stream.static("/why/value", rr.SeriesLines(names=titles, colors=colors, widths=widths))

    def _classes(self, rows: Sequence[Row]) -> None:
        names, spare = self._lines, [inf] * (LINES - len(self._lines))
        weights, sizes, arriving, values = [], [], [], []
        for r in rows:
            share = [r.weights.get(name, 0.0) for name in names]
            weights.append([max(0.0, sum(r.weights.values()) - sum(share)), *share, *spare])
            sizes.append([r.sizes.get(OTHER, 0.0), *(r.sizes.get(name, 0.0) for name in names), *spare])
            arriving.append([inf, *(r.arriving.get(name, inf) for name in names), *spare])
            # Infinite where no path was found: NaN would make equal recordings compare unequal.
            by_class = [r.value - self._temperature * log(w) if w > 0 else inf for w in share]
            band = [r.value - r.value_error, r.value + r.value_error] if r.value < inf else [inf, inf]
            exact = [] if r.truth is None else [r.truth.value]
            values.append([r.value, *band, *by_class, *spare, *exact])
        for path, lines in (("weight", weights), ("ess", sizes), ("arriving", arriving), ("value", values)):
            self._lines_of(f"/why/{path}", rows, lines)

    def _robot(self, rows: Sequence[Row]) -> None:
        self._lines_of("/why/clearance", rows, [[r.clearance] for r in rows])
        self._lines_of("/why/control", rows, [r.control for r in rows])
        self._lines_of("/why/cost", rows, [[r.cost, r.cost + r.value] for r in rows])

    def _optimum(self, rows: Sequence[Row]) -> None:
        known = [(r, r.truth) for r in rows if r.truth is not None]
        if not known:
            return
        told, off, values = [r for r, _ in known], [], []
        for r, truth in known:
            off.append([float(np.linalg.norm(r.control_error)), truth.distance(r.control)])
            finite = r.value < inf and truth.value < inf
            error = r.value - truth.value if finite else inf
            band = [error - r.value_error, error + r.value_error] if finite else [inf, inf]
            values.append([*band, error, 0.0])
        self._lines_of("/why/optimum/control", told, off)
        self._lines_of("/why/optimum/value", told, values)

    def _mark_switch(self, row: Row) -> None:
        if row.favourite is None:
            return
        if self._favourite not in (None, row.favourite):
            self._stream.log("/why/weight/switch", row.step, row.time, rr.Scalars(1.03))
        self._favourite = row.favourite

    def _lines_of(self, path: str, rows: Sequence[Row], table: Sequence[Sequence[float] | Array]) -> None:
        flat = _short(np.array(table))
        columns = rr.Scalars.columns(scalars=flat.ravel()).partition([flat.shape[1]] * len(rows))
        self._stream.columns(path, [r.step for r in rows], [r.time for r in rows], columns)


def _short(values: Array) -> Array:
    """Values to one part in 2^15: what a plot can show; the zero bytes left behind take no room in a file."""
    mantissa, exponent = np.frexp(values)
    short: Array = np.ldexp(np.rint(mantissa * PRECISION) / PRECISION, exponent)
    return short
