"""A tree as a picture: the best edge of every vertex, and the references from a state."""

from __future__ import annotations

from typing import Any

import numpy as np

from pirrht import shown
from pirrht.arrays import Array
from pirrht.plotting import axes as axes_of
from pirrht.plotting import ground, lines

SPACING = 0.15  # of points on edges that turn [m]


def draw(tree: Any, x: Array | None, axes: Any) -> Any:
    """The axes, drawn on; see `HomologyTree.plot`."""
    references = [] if x is None else tree.references(np.asarray(x, dtype=float))
    axes = axes_of.on(axes, "tree.plot")
    scene = tree.space.scene
    ground.draw(axes, scene)
    lines.many(axes, edges(tree), lines.TREE, width=0.4, opacity=0.6, zorder=2)
    labels = [f"{shown.turns(one.id)}: {one.cost:.3g}" for one in references]
    lines.classes(axes, [one.trajectory.points for one in references], labels, "class: cost")
    axes.set_title(f"{scene.name}: {tree.size} vertices", fontsize=10)
    return axes


def edges(tree: Any) -> list[Array]:
    """The edge that each vertex' cheapest node takes, as polylines (k, 2) [m]."""
    graph, tails, heads = tree.graph, [], []
    for v in range(tree.size):
        count = int(graph.nodes[v])
        e = int(graph.parent[v, int(np.argmin(graph.cost[v, :count]))]) if count else -1
        if e >= 0:
            tails.append(v)
            heads.append(int(graph.head[e]))
    if not tails:
        return []
    found: list[Array] = tree.steering.connect(tree.states[tails], tree.states[heads]).points(SPACING)
    return found
