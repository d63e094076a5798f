"""The picture of `calibration`: coverage and errors over room, and a scene with its states; v above, u below."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.calibration_table import EDGES, scores
from benchmarks.plots import COLORS, plain

from pirrht.plotting.maps import pyplot
from sim.plotting import draw_scene
from sim.scenario import Scenario

NOMINAL = 0.9545  # of errors within two standard errors
LEAST, MOST = 0.5, 8.0  # of the colours of the map: error over standard error
ROOMS = 0.02, 30.0  # axis of room
SCORES = 0.05, 300.0  # axis of errors over standard errors
AXIS = r"room: clearance / (b $\sqrt{1\,\mathrm{s}}$)"


def draw(path: Path, states: list[dict[str, Any]], scenario_of: Callable[[dict[str, Any]], Scenario]) -> None:
    """Write the picture of what `calibration` found at some states, of each of which one can tell the scenario."""
    plt = pyplot("--png")
    figure, panels = plt.subplots(2, 3, figsize=(14.0, 8.0), layout="constrained", width_ratios=(1.0, 1.15, 1.0))
    known = [s for s in states if s["plans"]]
    picked = _picked(known)
    for which, row in zip(("v", "u"), panels, strict=True):
        _coverage(row[0], known, which)
        _scatter(row[1], known, which)
        _map(figure, row[2], picked, which, scenario_of(picked[0]))
    panels[0, 0].legend(fontsize=8, frameon=False, loc="lower right")
    panels[1, 1].legend(fontsize=8, frameon=False, loc="upper right", markerscale=3.0)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _coverage(axes: Any, states: list[dict[str, Any]], which: str) -> None:
    """Share of plans within 2 standard errors by bin of room; bars are errors over states, the band over plans."""
    noises = sorted({s["noise"] for s in states})
    bins = list(zip(EDGES[:-1], EDGES[1:], strict=True))
    fewest = np.full(len(bins), np.inf)
    for i, noise in enumerate(noises):
        for j, (low, high) in enumerate(bins):
            own = [s for s in states if s["noise"] == noise and low <= s["room"] < high]
            if not own:
                continue
            shares = np.array([np.mean(scores(s)[which] <= 2.0) for s in own])
            fewest[j] = min(fewest[j], sum(len(s["plans"]) for s in own))
            error = shares.std(ddof=1) / np.sqrt(len(shares)) if len(shares) > 1 else 0.0
            at = j + 0.2 * (i - 0.5 * (len(noises) - 1))
            axes.errorbar(
                at, 100 * shares.mean(), 100 * error, fmt="o", color=COLORS[i], ms=6, capsize=3,
                label=f"b = {noise:g}" if not axes.get_legend_handles_labels()[1].count(f"b = {noise:g}") else None,
            )  # fmt: skip
    spread = 196.0 * np.sqrt(NOMINAL * (1.0 - NOMINAL) / np.where(np.isfinite(fewest), fewest, np.nan))
    for j, half in enumerate(spread):
        axes.fill_between(
            [j - 0.45, j + 0.45], 100 * NOMINAL - half, np.minimum(100 * NOMINAL + half, 100), color="#dddddd"
        )
    axes.axhline(100 * NOMINAL, color="#333333", lw=1.0)
    names = [f"{low:g} - {high:g}" if np.isfinite(high) else f">= {low:g}" for low, high in bins]
    axes.set_xticks(range(len(bins)), names)
    axes.set_title(f"coverage of {which}; line: {100 * NOMINAL:.1f} %, grey: its 95 % band", fontsize=10)
    plain(axes, ylim=(0.0, 101.0), xlabel=AXIS, ylabel=f"{which} within 2 s.e. [% of plans]")


def _scatter(axes: Any, states: list[dict[str, Any]], which: str) -> None:
    """Errors of single plans over the standard errors that they claim, and the 95 % quantile of each state."""
    for i, noise in enumerate(sorted({s["noise"] for s in states})):
        own = [s for s in states if s["noise"] == noise]
        room = np.concatenate([np.full(len(s["plans"]), s["room"]) for s in own])
        score = np.concatenate([scores(s)[which].reshape(len(s["plans"]), -1).max(axis=1) for s in own])
        axes.plot(
            room, np.clip(score, *SCORES), ".", color=COLORS[i], ms=3.5, alpha=0.35, mew=0, label=f"b = {noise:g}"
        )
        tops = [np.quantile(scores(s)[which], 0.95) for s in own]
        axes.plot([s["room"] for s in own], np.clip(tops, *SCORES), "o", mfc="none", color=COLORS[i], ms=4.5, mew=1.0)
    for level in (1.0, 2.0, 3.0):
        axes.axhline(level, color="#333333", lw=0.7, ls="-" if level == 2.0 else ":")
    worst = ", the worse component" if which == "u" else ""
    axes.set_title("dots: plans; rings: 95 % quantile of a state; lines: 1, 2, 3", fontsize=10)
    labels = {"xlabel": AXIS, "ylabel": f"|error of {which}| / its s.e.{worst}"}
    plain(axes, xscale="log", yscale="log", xlim=ROOMS, ylim=SCORES, **labels)


def _map(figure: Any, axes: Any, states: list[dict[str, Any]], which: str, scenario: Scenario) -> None:
    """One scene at one noise level; states coloured by root mean squares of error over standard error."""
    first = states[0]
    draw_scene(axes, scenario)
    ratio = [np.sqrt(np.mean(scores(s)[which] ** 2)) for s in states]
    dots = axes.scatter(
        *np.array([s["x"] for s in states]).T, c=np.log2(np.clip(ratio, LEAST, MOST)), cmap="RdYlBu_r", s=70,
        vmin=np.log2(LEAST), vmax=np.log2(MOST), edgecolors="black", linewidths=0.8, zorder=10,
    )  # fmt: skip
    bar = figure.colorbar(dots, ax=axes, shrink=0.8, label=f"error of {which} / s.e., r.m.s.")
    ticks = [0.5, 1, 2, 4, 8]
    bar.set_ticks(np.log2(ticks), labels=["<= 0.5", "1", "2", "4", ">= 8"])
    axes.set_title(f"{first['scene']}, b = {first['noise']:g}: {len(states)} states", fontsize=10)


def _picked(states: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of the scene and noise level whose states are most unlike each other, for the map."""
    groups: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for s in states:
        groups.setdefault((s["scene"], s["noise"]), []).append(s)
    most = max(len(group) for group in groups.values())

    def variety(group: list[dict[str, Any]]) -> float:
        return float(np.std([np.log(np.mean(scores(s)["v"] ** 2)) for s in group]))

    return max((group for group in groups.values() if len(group) == most), key=variety)
