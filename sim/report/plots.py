"""The pictures of a report, with matplotlib (extra `figures`), in colours that stay apart for colour-blind eyes."""

import io
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pirrht.control.settings import METHODS
from sim.drawing.colors import OTHER_COLOR, ClassColors, method_color, rgb, title
from sim.plotting import pyplot
from sim.report.summary import ALL, Row

MOST = 6  # scenes with pictures of their own; of more, all together
SHOWN = 6  # classes with a colour of their own
MARKS = "osD^vP"


def pictures(report: Row) -> dict[str, str]:
    """PNGs in base64 by what they show: success, cost, classes, step times; OptionError if matplotlib is missing."""
    plt, scenes = pyplot("report.html"), list(dict.fromkeys(p["scene"] for p in report["points"]))
    scenes = [ALL] if len(scenes) > MOST + 1 else [scene for scene in scenes if scene != ALL]
    shown, drawn = [p for p in report["points"] if p["scene"] in scenes], {}
    for what, label, field, scale in (
        ("Success", "runs that reach the goal [%]", "success", 100.0),
        ("Cost", "cost of runs that reach the goal", "cost", 1.0),
        ("Cost over optimal", "cost over optimal", "cost_over_optimal", 1.0),
        ("Step times", "median step [ms]", "step_ms", 1.0),
    ):
        if known := [p for p in shown if np.isfinite(p[field]["value"])]:
            draw = partial(_levels, label=label, field=field, scale=scale)
            drawn[f"{what} against noise, with 95 % intervals"] = _png(plt, known, draw)
    if known := [p for p in shown if p["classes"]]:
        drawn["Homology classes of the driven paths"] = _png(plt, known, _shares)
    return drawn


def _png(plt: Any, points: Sequence[Row], draw: Callable[[Any, list[Row]], None]) -> str:
    """A figure with a panel per scene, as base64."""
    scenes = list(dict.fromkeys(p["scene"] for p in points))
    height = max(3.6, 0.24 * len(points) / len(scenes) + 1.2)
    size = max(6.5, 3.6 * len(scenes) + 1.4), height
    figure = plt.Figure(figsize=size, layout="constrained")
    for axes, scene in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes, strict=True):
        draw(axes, [p for p in points if p["scene"] == scene])
        axes.set_title(scene, fontsize=10)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=120)
    return b64encode(stream.getvalue()).decode()


def _levels(axes: Any, points: Sequence[Row], label: str, field: str, scale: float) -> None:
    """A line with intervals per method."""
    noises, methods = sorted({p["noise"] for p in points}), list(dict.fromkeys(p["method"] for p in points))
    for i, method in enumerate(methods):
        own, rank = [p for p in points if p["method"] == method], [*METHODS, method].index(method)
        x = [noises.index(p["noise"]) + 0.08 * (i - (len(methods) - 1) / 2) for p in own]
        y, low, high = scale * np.array([[p[field][name] for name in ("value", "low", "high")] for p in own]).T
        off = np.nan_to_num(np.clip([y - low, high - y], 0.0, None))
        look = {"fmt": MARKS[rank % len(MARKS)], "color": rgb(method_color(rank)), "label": method}
        axes.errorbar(x, y, yerr=off, ls="-", lw=1.0, ms=5, capsize=3, **look)
    axes.set_xticks(range(len(noises)), [f"{b:g}" for b in noises])
    axes.set(xlabel="noise b", ylabel=label, xlim=(-0.5, len(noises) - 0.5))
    axes.set_yscale("log" if "[ms]" in label else "linear")
    axes.grid(alpha=0.25, axis="y")


def _shares(axes: Any, points: Sequence[Row]) -> None:
    """A bar of class shares per noise level and method, the first on top."""
    rows, colors, left = points[::-1], ClassColors(), np.zeros(len(points))
    shares = [{name: 100 * share["value"] for name, share in p["classes"].items()} for p in rows]
    total = Counter({name: sum(own.get(name, 0.0) for own in shares) for own in shares for name in own})
    for name, _ in total.most_common(SHOWN):
        share = np.array([own.get(name, 0.0) for own in shares])
        axes.barh(range(len(rows)), share, left=left, color=rgb(colors[name]), label=f"class {title(name)}")
        left = left + share
    if len(total) > SHOWN:
        axes.barh(range(len(rows)), 100 - left, left=left, color=rgb(OTHER_COLOR), label="other")
    names = [f"b = {p['noise']:g}  {p['method']}  (n = {p['arrived']})" for p in rows]
    axes.set_yticks(range(len(rows)), names, fontsize=8)
    axes.set(xlim=(0, 100), xlabel="share of the runs that reached the goal [%]")
