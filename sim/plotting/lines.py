"""Trees, references and samples as lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.planner.tree import HomologyTree

SPACING = 0.15  # of points on edges that turn [m]
# Six hues that stay apart for colour-blind eyes; a class has that of its rank, cheapest first.
PALETTE = ("#33bbee", "#ee3377", "#009988", "#ee7733", "#0077bb", "#cc3311")
TREE, SAMPLE = "#55aacc", "#70747a"


def axes_for(axes: Any | None, method: str) -> Any:
    """Return the axes; None: those of a new figure. An OptionError names the extra if matplotlib is missing."""
    if axes is not None:
        return axes
    try:
        from matplotlib import pyplot
    except ImportError:
        raise OptionError(f"{method} needs matplotlib; install it with: pip install 'pirrht[figures]'") from None
    return pyplot.subplots(figsize=(7.0, 5.0), layout="constrained")[1]


def color(place: int) -> str:
    """Return the colour of the class of a rank, from 0."""
    return PALETTE[place % len(PALETTE)]


def many(axes: Any, lines: Sequence[Array], colors: Any, *, width: float, opacity: Any, zorder: float) -> None:
    """Draw polylines (k, 2) [m]; colours and opacities are common or one each."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors=colors, lw=width, alpha=opacity, zorder=zorder))


def tree_lines(tree: HomologyTree) -> list[Array]:
    """Return the edge that each vertex' cheapest node takes, as polylines (k, 2) [m]."""
    graph, size = tree.graph, tree.size
    tails = np.flatnonzero(graph.nodes[:size] > 0)
    costs = np.where(np.arange(graph.cost.shape[1]) < graph.nodes[tails, None], graph.cost[tails], np.inf)
    edges = graph.parent[tails, np.argmin(costs, axis=1)]
    tails, heads = tails[edges >= 0], graph.head[edges[edges >= 0]]
    if not len(tails):
        return []
    points: list[Array] = tree.steering.connect(tree.states[tails], tree.states[heads]).points(SPACING)
    return points


def classes(axes: Any, lines: Sequence[Array], labels: Sequence[str], title: str) -> None:
    """Draw one polyline (k, 2) [m] per class with a label each in a legend, the first on top."""
    rows = list(enumerate(zip(lines, labels, strict=True)))
    for place, (line, label) in reversed(rows):
        axes.plot(line[:, 0], line[:, 1], color=color(place), lw=2.2, label=label, zorder=4)
    handles, texts = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            handles[::-1], texts[::-1], title=title, fontsize=8, title_fontsize=8, frameon=False, loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
        )  # fmt: skip
