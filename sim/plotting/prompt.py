"""Draw trees and plans, as `HomologyTree.plot` and `Plan.plot` do, from edges, classes and samples."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree
from sim.plotting import ground

ARROW = 0.5  # time that the arrow of a control spans [s]
FAINT, STRONG = 0.08, 0.6  # opacity of samples, of the least and of the greatest weight
SPACING = 0.15  # of points on edges that turn [m]
# Six hues that stay apart for colour-blind eyes; a class has that of its rank, cheapest first.
PALETTE = ("#33bbee", "#ee3377", "#009988", "#ee7733", "#0077bb", "#cc3311")
TREE, SAMPLE = "#55aacc", "#70747a"
LEGEND = {"fontsize": 8, "title_fontsize": 8, "frameon": False, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}


def pyplot(what: str) -> Any:
    """matplotlib.pyplot; OptionError, which says what needs it, if matplotlib is not installed."""
    try:
        from matplotlib import pyplot as plt
    except ImportError:
        raise OptionError(f"{what} needs matplotlib; install it with: pip install 'pirrht[figures]'") from None
    return plt


def tree(drawn: HomologyTree, x: Array | None, axes: Any) -> Any:
    """Draw the best edge of every vertex, and the references from a state; return the axes."""
    references = [] if x is None else drawn.references(np.asarray(x, dtype=float))
    axes = axes or _axes("tree.plot")
    scene = drawn.space.scene
    ground.draw(axes, scene)
    edges(axes, drawn, TREE, width=0.4, opacity=0.6, zorder=2)
    labels = [f"{formatting.turns(one.id)}: {one.cost:.3g}" for one in references]
    classes(axes, [one.trajectory.points for one in references], labels, title="class: cost")
    axes.set_title(f"{scene.name}: {drawn.size} vertices", fontsize=10)
    return axes


def plan(drawn: Plan, samples: int, axes: Any) -> Any:
    """Draw the state, references, samples and control of a plan on a map of its scene; return the axes."""
    if drawn.space is None:
        raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
    axes = axes or _axes("plan.plot")
    ground.draw(axes, drawn.space.scene, drawn.time)
    ground.predicted(axes, drawn.movers, drawn.time)
    _samples(drawn, axes, samples)
    by = drawn.weights()
    labels = [f"{formatting.turns(id)}: {formatting.share(by[id]) if id in by else '-'}" for id in drawn.ids]
    lines = [one.trajectory.points for one in drawn.references]
    classes(axes, lines[: len(labels)], labels[: len(lines)], title="class: weight")
    axes.plot(*drawn.state[:2], "o", ms=5, color=ground.INK, zorder=6)
    if len(drawn.control) == 2:
        look = {"arrowprops": {"arrowstyle": "-|>", "lw": 1.4, "color": ground.INK}, "zorder": 6}
        axes.annotate("", tuple(drawn.state[:2] + ARROW * drawn.control), tuple(drawn.state[:2]), **look)
    axes.set_title(f"{drawn.space.scene.name} at {drawn.time:.2f} s", fontsize=10)
    return axes


def edges(axes: Any, tree: HomologyTree, color: str, *, width: float, opacity: float, zorder: float) -> None:
    """Draw the edge that each vertex' cheapest node takes."""
    graph, size = tree.graph, tree.size
    tails = np.flatnonzero(graph.nodes[:size] > 0)
    costs = np.where(np.arange(graph.cost.shape[1]) < graph.nodes[tails, None], graph.cost[tails], np.inf)
    taken = graph.parent[tails, np.argmin(costs, axis=1)]
    tails, heads = tails[taken >= 0], graph.head[taken[taken >= 0]]
    if len(tails):
        paths = tree.steering.connect(tree.states[tails], tree.states[heads])
        _lines(axes, paths.points(SPACING), color, width=width, opacity=opacity, zorder=zorder)


def classes(
    axes: Any, lines: Sequence[Array], labels: Sequence[str], colors: Sequence[Any] = PALETTE, **legend: Any
) -> None:  # fmt: skip
    """Draw one polyline (k, 2) [m] per class with a label each in a legend, the first on top."""
    for place, (line, label) in reversed(list(enumerate(zip(lines, labels, strict=True)))):
        axes.plot(line[:, 0], line[:, 1], color=colors[place % len(colors)], lw=2.2, label=label, zorder=4)
    handles, texts = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles[::-1], texts[::-1], **LEGEND, **legend)


def _axes(method: str) -> Any:
    return pyplot(method).subplots(figsize=(7.0, 5.0), layout="constrained")[1]


def _lines(axes: Any, lines: Sequence[Array], color: str, *, width: float, opacity: Any, zorder: float) -> None:
    """Draw polylines (k, 2) [m]; opacities are common or one each."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors=color, lw=width, alpha=opacity, zorder=zorder))


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
            _lines(axes, paths, SAMPLE, width=0.7, opacity=opacity, zorder=2)
