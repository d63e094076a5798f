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
        self._controls, self._truth = problem.dynamics.m, truth
        self._names: list[str] | None = None  # classes that have a line of their own

    def begin(self) -> None:
        """Names and colours that do not change."""
        m = self._controls
        self._style("clearance", ["clearance"], [PLAIN], [1.6])
        self._style("control", [f"u{k + 1}" for k in range(m)], [PLAIN, DRIVEN, OPTIMUM, DIM][:m], [1.6] * m)
        self._style("cost", ["so far", "with the value of what is left"], [DRIVEN, PLAIN], [2.0, 1.2])
        if self._truth:
            self._style("optimum/control", [BAND, "|u - u*|"], [DIM, OPTIMUM], [1.0, 2.0])
            names, colors = [BAND, BAND, "all paths", "exact"], [DIM, DIM, PLAIN, OPTIMUM]
            self._style("optimum/value", names, colors, [1.0, 1.0, 1.2, 2.0])

    def draw(self, rows: Sequence[Row]) -> None:
        """Log some steps."""
        names = self._name_classes(rows)
        spare = [inf] * (LINES - len(names))  # NaN would make equal recordings unequal
        lines: dict[str, list[list[float]]] = {}
        for r in rows:
            weights, sizes = (dict(zip(r.cells["classes"], r.cells[kind], strict=True)) for kind in ("weights", "ess"))
            share, value = [weights.get(name, 0.0) for name in names], r["value"]
            by_class = [value - self._temperature * log(w) if w > 0 else inf for w in share]
            exact, band = r.cells["exact_value"], _band(value, r["value_error"])
            for path, line in (
                ("weight", [max(0.0, sum(weights.values()) - sum(share)), *share, *spare]),
                ("ess", [sizes.get(OTHER, 0.0), *(sizes.get(name, 0.0) for name in names), *spare]),
                ("arriving", [inf, *(r.arriving.get(name, inf) for name in names), *spare]),
                ("value", [value, *band, *by_class, *spare, *exact]),
                ("clearance", r.cells["clearance"]),
                ("control", r.cells["control"]),
                ("cost", [r["cost"], r["cost"] + value]),
            ):
                lines.setdefault(path, []).append(line)
            if exact:
                off = float(np.linalg.norm(np.subtract(r.cells["control"], r.cells["exact_control"])))
                error = value - exact[0] if value < inf and exact[0] < inf else inf
                lines.setdefault("optimum/control", []).append([float(np.linalg.norm(r.cells["control_error"])), off])
                lines.setdefault("optimum/value", []).append([*_band(error, r["value_error"]), error, 0.0])
        for path, table in lines.items():
            columns = rr.Scalars.columns(scalars=_short(table)).partition([len(line) for line in table])
            self._stream.columns(f"/why/{path}", [r.step for r in rows], [r.time for r in rows], columns)

    def _name_classes(self, rows: Sequence[Row]) -> list[str]:
        """Give colours to new classes, and return those with lines: the cheapest at first, then the heavy."""
        names = list(self._names or ())
        for row in rows:
            self._colors.meet(row.ids)
            weights = zip(row.cells["classes"], row.cells["weights"], strict=True)
            heavy = [name for name, w in weights if w >= HEAVY and name != OTHER]
            for name in [*(row.ids[:CHEAPEST] if not names else ()), *heavy]:
                if name not in names and len(names) < LINES:
                    names.append(name)
        if names == self._names:
            return names
        self._names = names
        # The viewer requires equal numbers of lines at all times; those of equal name share a place in its legend.
        every = [OTHER, *names, *[OTHER] * (LINES - len(names))]
        titles = [OTHER if name == OTHER else f"class {title(name)}" for name in every]
        colors, widths = [self._colors[name] for name in every], [2.5] * len(every)
        for path in ("weight", "ess", "arriving"):
            self._style(path, titles, colors, widths)
        titles = ["all paths" if name == OTHER else name for name in titles]
        colors = [PLAIN if name == OTHER else color for name, color in zip(every, colors, strict=True)]
        exact = int(self._truth)
        self._style(
            "value", [titles[0], BAND, BAND, *titles[1:], *["exact"] * exact],
            [colors[0], PLAIN, PLAIN, *colors[1:], *[OPTIMUM] * exact], [2.5, 0.8, 0.8, *widths[1:], *[1.2] * exact],
        )  # fmt: skip
        return names

    def _style(self, path: str, names: Sequence[str], colors: Sequence[Color], widths: Sequence[float]) -> None:
        self._stream.static(f"/why/{path}", rr.SeriesLines(names=names, colors=colors, widths=widths))


def _short(table: Sequence[Sequence[float]]) -> Array:
    """Values to one part in 2^15, which a plot can show; the zero bytes left behind cost nothing in a file."""
    mantissa, exponent = np.frexp(np.concatenate(table))
    short: Array = np.ldexp(np.rint(mantissa * PRECISION) / PRECISION, exponent)
    return short


def _band(value: float, error: float) -> list[float]:
    """One standard error below and above a value, infinite if that is."""
    return [value - error, value + error] if value < inf else [inf, inf]
