"""The pictures of a report, with matplotlib (extra `figures`), in colours that stay apart for colour-blind eyes."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from pirrht.control.settings import METHODS
from sim.drawing.colors import OTHER_COLOR, ClassColors, method_color, rgb, title
from sim.report.statistics import Interval
from sim.report.summary import ALL, Point, Report

MOST = 6  # scenes with pictures of their own; of more, all together
SHOWN = 6  # classes with a colour of their own
MARKS = "osD^vP"


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A PNG in base64 and what it shows."""

    text: str
    png: str


class Curve(NamedTuple):
    """A figure of points that is drawn against the noise level."""

    what: str
    label: str  # of its axis
    of: Callable[[Point], Interval]
    scale: float = 1.0
    log: bool = False


def pictures(report: Report) -> list[Picture]:
    """Success, cost, classes and step times; OptionError if matplotlib is missing."""
    from sim.figures import pyplot

    plt = pyplot("report.html")
    if not report.points:
        return []
    scenes = [ALL] if len(report.scenes) > MOST + 1 else [scene for scene in report.scenes if scene != ALL]
    percent, cost = "runs that reach the goal [%]", "cost of runs that reach the goal"
    curves = [
        Curve("success", percent, lambda p: p.success, 100.0),
        Curve("cost", cost, lambda p: p.cost),
        Curve("cost over optimal", "cost over optimal", lambda p: p.cost_over_optimal),
        Curve("step times", "median step [ms]", lambda p: p.step_ms, log=True),
    ]
    levels = [_levels(plt, report, scenes, curve) for curve in curves]
    drawn = [*levels[:3], _shares(plt, report, scenes), levels[3]]
    return [picture for picture in drawn if picture is not None]


def _levels(plt: Any, report: Report, scenes: Sequence[str], curve: Curve) -> Picture | None:
    """A figure against the noise level, a line per method and a panel per scene; None without a value."""
    what, label, of, scale, log = curve
    if not any(isfinite(of(p).value) for p in report.points if p.scene in scenes):
        return None
    figure, panels = _panels(plt, len(scenes))
    methods = list(dict.fromkeys(p.method for p in report.points))
    for axes, scene in zip(panels, scenes, strict=True):
        noises = sorted({p.noise for p in report.points if p.scene == scene})
        for i, method in enumerate(methods):
            shown = [p for p in report.points if (p.scene, p.method) == (scene, method) and isfinite(of(p).value)]
            shift = 0.08 * (i - (len(methods) - 1) / 2)
            x = [noises.index(p.noise) + shift for p in shown]
            known = [of(p) for p in shown]
            y = [scale * k.value for k in known]
            low = [scale * max(0.0, k.value - (k.low if isfinite(k.low) else k.value)) for k in known]
            high = [scale * max(0.0, (k.high if isfinite(k.high) else k.value) - k.value) for k in known]
            color, mark = rgb(method_color(_rank(method))), MARKS[_rank(method) % len(MARKS)]
            axes.errorbar(x, y, yerr=[low, high], fmt=mark, ls="-", lw=1.0, ms=5, capsize=3, color=color, label=method)
        axes.set_xticks(range(len(noises)), [f"{b:g}" for b in noises])
        axes.set_xlim(-0.5, len(noises) - 0.5)
        axes.set_xlabel("noise b")
        axes.set_title(scene, fontsize=10)
        axes.grid(alpha=0.25, axis="y")
        axes.spines[["top", "right"]].set_visible(False)
        if log and any(isfinite(of(p).value) for p in report.points if p.scene == scene):
            _logarithmic(axes)
    panels[0].set_ylabel(label)
    panels[-1].legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    return Picture(text=f"{what.capitalize()} against noise, with 95 % intervals", png=_png(plt, figure))


def _logarithmic(axes: Any) -> None:
    """A logarithmic scale whose ticks are plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def _shares(plt: Any, report: Report, scenes: Sequence[str]) -> Picture | None:
    """Bars of class shares, one per noise level and method; None if no run has a class."""
    points = [p for p in report.points if p.scene in scenes and p.classes]
    if not points:
        return None
    figure, panels = _panels(plt, len(scenes), height=max(3.2, 0.24 * len(points) / len(scenes) + 1.2))
    for axes, scene in zip(panels, scenes, strict=True):
        rows = [p for p in points if p.scene == scene][::-1]
        colors = ClassColors()
        total: dict[str, float] = {}
        for p in rows:
            for name, share in p.classes.items():
                total[name] = total.get(name, 0.0) + share.value
        named = sorted(total, key=lambda name: -total[name])[:SHOWN]
        colors.meet(named)
        left = [0.0] * len(rows)
        for name in named:
            width = [100 * p.classes[name].value if name in p.classes else 0.0 for p in rows]
            axes.barh(range(len(rows)), width, left=left, color=rgb(colors[name]), label=title(name))
            left = [a + b for a, b in zip(left, width, strict=True)]
        if len(total) > len(named):
            axes.barh(range(len(rows)), [100 - x for x in left], left=left, color=rgb(OTHER_COLOR), label="other")
        axes.set_yticks(range(len(rows)), [f"b = {p.noise:g}  {p.method}  (n = {p.arrived})" for p in rows], fontsize=8)
        axes.set_xlim(0, 100)
        axes.set_xlabel("share of the runs that reached the goal [%]")
        axes.set_title(scene, fontsize=10)
        axes.spines[["top", "right"]].set_visible(False)
        if named:
            axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), title="class")
    return Picture(text="Homology classes of the driven paths", png=_png(plt, figure))


def _panels(plt: Any, count: int, height: float = 3.6) -> tuple[Any, list[Any]]:
    figure, axes = plt.subplots(
        1, count, figsize=(max(6.5, 3.6 * count + 1.4), height), layout="constrained", squeeze=False
    )
    return figure, list(axes[0])


def _png(plt: Any, figure: Any) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=120)
    plt.close(figure)
    return b64encode(stream.getvalue()).decode()


def _rank(method: str) -> int:
    return [*METHODS, method].index(method)
