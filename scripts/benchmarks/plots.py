"""Figures of the tables of `quality`, in colours that stay apart for colour-blind eyes."""

from pathlib import Path
from typing import Any

import numpy as np

from pirrht.plotting.maps import pyplot
from sim.drawing.colors import METHODS

COLORS = [tuple(c / 255.0 for c in color) for color in METHODS]


def plain(axes: Any, *, grid: float = 0.25, which: str = "major", **properties: Any) -> None:
    """Set labels, scales and limits of a panel by name; a grid, and no frame above and at the right."""
    axes.set(**properties)
    axes.grid(alpha=grid, which=which)
    axes.spines[["top", "right"]].set_visible(False)


def samples(path: Path, values: list[dict[str, Any]]) -> None:
    """Error of u against the number of samples per class, one panel per noise level."""
    plt = pyplot("this script")
    noises = sorted({v["noise"] for v in values})
    figure, panels = plt.subplots(1, len(noises), figsize=(3.4 * len(noises), 3.2), sharey=True, layout="constrained")
    for axes, noise in zip(np.atleast_1d(panels), noises, strict=True):
        for i, name in enumerate(dict.fromkeys(v["variant"] for v in values)):
            line = [(v["samples"], v["error"]) for v in values if v["variant"] == name and v["noise"] == noise]
            axes.loglog(*zip(*line, strict=True), "o-", color=COLORS[i], lw=1.8, ms=4, label=name)
        axes.set_title(f"b = {noise:g}", fontsize=10)
        plain(axes, which="both", xlabel="samples per class")
    np.atleast_1d(panels)[0].set_ylabel("error of u [m/s]")
    np.atleast_1d(panels)[-1].legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def drives(path: Path, values: list[dict[str, Any]]) -> None:
    """Success of drives beside that of the optimal law, and their cost over its, per method and noise level."""
    plt = pyplot("this script")
    noises = sorted({v["noise"] for v in values})
    methods = list(dict.fromkeys(v["method"] for v in values))
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.4), layout="constrained")
    width = 0.8 / len(methods)
    for i, method in enumerate(methods):
        own = {v["noise"]: v for v in values if v["method"] == method}
        place = np.arange(len(noises)) + (i - 0.5 * (len(methods) - 1)) * width
        left.bar(place, [100.0 * own[b]["success"] for b in noises], width, color=COLORS[i % len(COLORS)], label=method)
        right.bar(place, [own[b]["cost_over_optimal"] for b in noises], width, color=COLORS[i % len(COLORS)])
    left.set_ylabel("reach the goal [%]")
    right.set(ylabel="cost over optimal, both arrived", ylim=(0.9, None))
    right.axhline(1.0, color="#333333", lw=0.8)
    for axes in (left, right):
        axes.set_xticks(np.arange(len(noises)), [f"b = {b:g}" for b in noises])
        axes.spines[["top", "right"]].set_visible(False)
    left.legend(fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    figure.savefig(path, dpi=120)
    plt.close(figure)
