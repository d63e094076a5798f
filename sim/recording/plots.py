"""The plots of the tab Why: class weights, value, effective sample size and, with a truth, distance from the optimum.

Plots have one line for all other classes, then one for each of a few classes as they gain weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, log

import numpy as np
import rerun as rr

from pirrht.arrays import Array
from pirrht.estimation.estimate import OTHER
from sim.drawing.colors import ClassColors, title
from sim.recording.static import CONTROL, OPTIMUM
from sim.recording.step_row import Row
from sim.recording.stream import Stream

LINES, CHEAPEST, HEAVY = 8, 6, 0.01  # classes in the plots: at most, from the start, from this weight on
BAND = "one standard error"
STROKE, THINNEST = 0.01, 0.002  # time between strokes that fill an area [s], the least share that is drawn
PRECISION = 2**15
DIM = (120, 122, 128)


class Plots:
    """Logs the numbers behind the control into one recording stream."""

    def __init__(self, stream: Stream, temperature: float, colors: ClassColors, *, truth: bool) -> None:
        self._stream, self._temperature, self._colors = stream, temperature, colors
        self._truth = truth  # whether steps come with the exact value and the optimal control
        self._favourite: str | None = None
        self._lines: list[str] = []  # classes that have a line of their own
        self._named = False

    def begin(self) -> None:
        """Names and colours that do not change."""
        if not self._truth:
            return
        for path, names, colors, widths in (
            ("/why/optimum/control", [BAND, "|u - u*|"], [DIM, OPTIMUM], [1.0, 2.0]),
            (
                "/why/optimum/value",
                [BAND, BAND, "all paths", "exact"],
                [DIM, DIM, CONTROL, OPTIMUM],
                [1.0, 1.0, 1.2, 2.0],
            ),
        ):
            self._stream.static(path, rr.SeriesLines(names=names, colors=colors, widths=widths))

    def draw(self, rows: Sequence[Row]) -> None:
        """Log some steps."""
        self._name_classes(rows)
        self._classes(rows)
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
        self._stream.static(
            "/why/weight", rr.SeriesLines(**lines, widths=[3.5] * len(titles), aggregation_policy="Off")
        )
        self._stream.static("/why/ess", rr.SeriesLines(**lines, widths=widths))
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [CONTROL if color == self._colors[OTHER] else color for color in colors]
        titles[1:1], colors[1:1], widths[1:1] = [BAND] * 2, [CONTROL] * 2, [0.8] * 2
        if self._truth:
            titles, colors, widths = [*titles, "exact"], [*colors, OPTIMUM], [*widths, 1.2]
        self._stream.static("/why/value", rr.SeriesLines(names=titles, colors=colors, widths=widths))

    def _classes(self, rows: Sequence[Row]) -> None:
        names, spare = self._lines, [inf] * (LINES - len(self._lines))
        sizes, values = [], []
        for r in rows:
            share = [r.weights.get(name, 0.0) for name in names]
            sizes.append([r.sizes.get(OTHER, 0.0), *(r.sizes.get(name, 0.0) for name in names), *spare])
            # Infinite where no path was found: NaN would make equal recordings compare unequal.
            by_class = [r.value - self._temperature * log(w) if w > 0 else inf for w in share]
            band = [r.value - r.value_error, r.value + r.value_error] if r.value < inf else [inf, inf]
            exact = [] if r.truth is None else [r.truth.value]
            values.append([r.value, *band, *by_class, *spare, *exact])
        self._lines_of("/why/ess", rows, sizes)
        self._lines_of("/why/value", rows, values)
        self._stack(rows)

    def _stack(self, rows: Sequence[Row]) -> None:
        """Class weights on top of each other: the viewer fills no areas, so strokes up and down cover them."""
        at: list[tuple[int, float]] = []
        table: list[Array] = []
        for r in rows:
            share = np.zeros(LINES + 1)
            share[1 : 1 + len(self._lines)] = [r.weights.get(name, 0.0) for name in self._lines]
            upper = np.cumsum(share)
            share[0] = sum(r.weights.values()) - upper[-1]  # all other classes are on top
            upper[0] = upper[-1] + share[0]
            seen = share > THINNEST
            edges = [np.where(seen, upper - share, inf), np.where(seen, upper, inf)]
            strokes = 2 * max(1, round(r.duration / STROKE))
            at += [(r.step, r.time + r.duration * k / strokes) for k in range(strokes)]
            table += edges * (strokes // 2)
        columns = rr.Scalars.columns(scalars=_short(np.ravel(table))).partition([LINES + 1] * len(table))
        self._stream.columns("/why/weight", [step for step, _ in at], [time for _, time in at], columns)

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

    def _lines_of(self, path: str, rows: Sequence[Row], table: Sequence[Sequence[float]]) -> None:
        flat = _short(np.array(table))
        columns = rr.Scalars.columns(scalars=flat.ravel()).partition([flat.shape[1]] * len(rows))
        self._stream.columns(path, [r.step for r in rows], [r.time for r in rows], columns)


def _short(values: Array) -> Array:
    """Values to one part in 2^15: what a plot can show; the zero bytes left behind take no room in a file."""
    mantissa, exponent = np.frexp(values)
    short: Array = np.ldexp(np.rint(mantissa * PRECISION) / PRECISION, exponent)
    return short
