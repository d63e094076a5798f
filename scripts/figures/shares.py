"""The fifth figure: how probable it is that the optimally controlled path is of each class, against the noise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from figures import ground, style
from figures.effort import Effort, Tick
from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.exact.desirability import Desirability
from pirrht.plotting.colors import ClassColors
from sim.drawing.colors import title
from sim.scenario import Scenario

DT = 0.03  # of the samples [s]; a longer step tells turns in the slit less sharply


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shares:
    """Class shares at the start."""

    scenario: Scenario
    ids: tuple[str, ...]  # C classes, cheapest first
    lines: Sequence[Array]  # their references (k, 2)
    noises: Array  # (B,)
    sampled: Array  # (B, C) means over independent estimates
    error: Array  # (B, C) their standard errors
    exact: Array  # (B, C) of optimal paths of the grid; NaN where no grid solves the problem
    paths: int  # that those shares were counted from


def work(effort: Effort, tick: Tick) -> Shares:
    """Estimate the shares at the start of `slit`; one tree serves all noise levels."""
    base = effort.scenario("slit", samples=effort.draws, dt=DT, period=DT, between="hold", guide="feedback")
    tree = base.grown_tree()
    references = base.references(tree)
    ids = tuple(reference.id for reference in references)
    rows = []
    for noise in effort.noises:
        scenario = base.with_settings(noise=noise)
        controller = scenario.controller(tree)
        controller.begin(scenario.start)
        found = [controller.plan(scenario.start).estimate for _ in range(effort.estimates)]
        table = np.array([[e.class_weights.get(name, 0.0) for name in ids] for e in found if e is not None])
        table = table if len(table) else np.full((1, len(ids)), np.nan)
        error = table.std(axis=0, ddof=1) / len(table) ** 0.5 if len(table) > 1 else np.zeros(len(ids))
        rows.append((table.mean(axis=0), error, _exact(scenario, ids, effort)))
        tick()
    sampled, error, exact = (np.array(part) for part in zip(*rows, strict=True))
    return Shares(
        scenario=base,
        ids=ids,
        lines=[reference.trajectory.points for reference in references],
        noises=np.array(effort.noises),
        sampled=sampled,
        error=error,
        exact=exact,
        paths=effort.paths,
    )


def _exact(scenario: Scenario, ids: Sequence[str], effort: Effort) -> Array:
    """Shares of the classes among optimal paths of the grid, (C,); NaN where there is no grid."""
    try:
        law = Desirability.of(scenario.problem, scenario.space)
    except OptionError:
        return np.full(len(ids), np.nan)
    found = law.shares(scenario.start, samples=effort.paths, seed=effort.seed)
    return np.array([found.get(name, 0.0) for name in ids])


def draw(plt: Any, shown: Shares) -> Any:
    """A line per class, circles for the grid, and a key of the classes."""
    figure, axes = plt.subplots(figsize=(style.COLUMN, 2.7), layout="constrained")
    colors = ClassColors(shown.ids)
    for c, name in enumerate(shown.ids):
        color = style.rgb(colors[name])
        low, high = (shown.sampled[:, c] + k * 1.96 * shown.error[:, c] for k in (-1.0, 1.0))
        axes.fill_between(shown.noises, low, high, color=color, alpha=0.25, lw=0)
        axes.plot(shown.noises, shown.sampled[:, c], color=color, label=f"class {title(name)}")
        known = np.isfinite(shown.exact[:, c])
        share = shown.exact[known, c]
        bar = 1.96 * np.sqrt(np.maximum(share * (1.0 - share), 1.0 / shown.paths) / shown.paths)
        axes.errorbar(
            shown.noises[known], share, yerr=bar, fmt="o", ms=3.2, mfc="white", mec=color, ecolor=color,
            elinewidth=0.8, mew=0.9, zorder=4,
        )  # fmt: skip
    style.lines(
        axes, xlim=(shown.noises.min() - 0.01, shown.noises.max() + 0.01), ylim=(-0.03, 1.03),
        xlabel="noise $b$ [m/$\\sqrt{\\mathrm{s}}$]", ylabel="probability of the class",
    )  # fmt: skip
    _key(axes, shown, colors)
    return figure


def _key(axes: Any, shown: Shares, colors: ClassColors) -> None:
    """The legend, and a small map in which every class is named."""
    from matplotlib.lines import Line2D

    handles, _ = axes.get_legend_handles_labels()
    handles.append(Line2D([], [], color=style.INK, marker="o", ms=3.2, mfc="white", ls="none", label="grid's paths"))
    axes.figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), columnspacing=1.0)
    scene = shown.scenario.loaded.scene
    low, high = ground.around(shown.lines, scene, 0.3)
    inset = axes.inset_axes((0.6, 0.63, 0.39, 0.3))
    ground.draw(inset, scene)
    for line, name in zip(shown.lines, shown.ids, strict=True):
        inset.plot(*line.T, color=style.rgb(colors[name]), lw=1.1, zorder=5)
    ground.robot(inset, scene, shown.scenario.start)
    ground.frame(inset, low, high)
    inset.set(xticks=[], yticks=[])
