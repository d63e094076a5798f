"""Draw trees and plans, as `HomologyTree.plot` and `Plan.plot` do."""

from __future__ import annotations

from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree
from sim.plotting import ground, lines

ARROW = 0.5  # time that the arrow of a control spans [s]
FAINT, STRONG = 0.08, 0.6  # opacity of samples, of the least and of the greatest weight


def tree(drawn: HomologyTree, x: Array | None, axes: Any) -> Any:
    """Draw the best edge of every vertex, and the references from a state; return the axes."""
    references = [] if x is None else drawn.references(np.asarray(x, dtype=float))
    axes = lines.axes_for(axes, "tree.plot")
    scene = drawn.space.scene
    ground.draw(axes, scene)
    lines.many(axes, lines.tree_lines(drawn), lines.TREE, width=0.4, opacity=0.6, zorder=2)
    labels = [f"{formatting.turns(one.id)}: {one.cost:.3g}" for one in references]
    lines.classes(axes, [one.trajectory.points for one in references], labels, "class: cost")
    axes.set_title(f"{scene.name}: {drawn.size} vertices", fontsize=10)
    return axes


def plan(drawn: Plan, samples: int, axes: Any) -> Any:
    """Draw the state, references, samples and control of a plan on a map of its scene; return the axes."""
    if drawn.space is None:
        raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
    axes = lines.axes_for(axes, "plan.plot")
    ground.draw(axes, drawn.space.scene, drawn.time)
    ground.predicted(axes, drawn.movers, drawn.time)
    _samples(drawn, axes, samples)
    by = drawn.weights()
    labels = [f"{formatting.turns(id)}: {formatting.share(by[id]) if id in by else '-'}" for id in drawn.ids]
    pairs = list(zip(drawn.references, labels, strict=False))
    lines.classes(axes, [one.trajectory.points for one, _ in pairs], [label for _, label in pairs], "class: weight")
    axes.plot(*drawn.state[:2], "o", ms=5, color=ground.INK, zorder=6)
    if len(drawn.control) == 2:
        look = {"arrowprops": {"arrowstyle": "-|>", "lw": 1.4, "color": ground.INK}, "zorder": 6}
        axes.annotate("", tuple(drawn.state[:2] + ARROW * drawn.control), tuple(drawn.state[:2]), **look)
    axes.set_title(f"{drawn.space.scene.name} at {drawn.time:.2f} s", fontsize=10)
    return axes


def _samples(drawn: Plan, axes: Any, count: int) -> None:
    """Draw the heaviest samples, stronger the more they weigh, then as many of those that died."""
    if drawn.estimate is None or drawn.replay is None or count < 1:
        return
    rollouts, weight = drawn.estimate.rollouts, drawn.estimate.weight
    arrived = np.flatnonzero(rollouts.paths.outcome == Outcome.GOAL)
    died = np.flatnonzero(rollouts.paths.outcome == Outcome.COLLISION)[:count]
    best = arrived[np.argsort(-weight[arrived], kind="stable")[:count]]
    share = weight[best] / max(float(weight[best].max(initial=0.0)), 1e-300)
    for chosen, opacity in ((died, FAINT), (best, FAINT + (STRONG - FAINT) * share)):
        if len(chosen):
            states, steps = drawn.replay.trace(rollouts, chosen)
            paths = [path[: int(count) + 1, :2] for path, count in zip(states, steps, strict=True)]
            lines.many(axes, paths, lines.SAMPLE, width=0.7, opacity=opacity, zorder=2)
