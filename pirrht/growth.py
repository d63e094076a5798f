"""One state becomes a vertex of the graph: its edges, its classes and their propagation in one compiled call."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from pirrht.graph import add_edges
from pirrht.jit import kernel
from pirrht.relaxation import DONE, Kernels

REJECTED = -1  # no allowed class reaches the goal from the state


@cache
def attach_with(kernels: Kernels) -> Callable[..., int]:
    """The kernel for one allowed set (compiled once, cached on disk for the default)."""
    best_classes, relax = kernels.best_classes, kernels.relax

    @kernel
    def attach(graph, straight, near, near_in_goal, edges, weights, limit, K, mirrored):  # type: ignore[no-untyped-def]
        """Add a vertex that has the edges (free, cost, turns) to those `near`; there must be room.

        With `mirrored` the same edges lead back, and all costs are settled.
        Returns REJECTED, DONE, or what must grow before costs can be settled.
        """
        free, costs, turns = edges
        rows = np.flatnonzero(free)
        heads, cost = near[rows], costs[rows]
        one = np.empty(1, np.int64)
        if best_classes(
            graph, straight, heads, cost, turns, rows, weights, limit, np.empty(1), one, np.empty(1, np.int64),
            np.empty(1, np.int64),
        ) == 0:  # fmt: skip
            return REJECTED
        v = graph.size[0]
        graph.straight[v] = straight
        graph.size[0] = v + 1
        here = np.full(len(rows), v)
        add_edges(graph, here, heads, cost, turns, rows, 1, weights)
        graph.waiting[v] = True
        graph.refill[graph.size[3]] = v
        graph.size[3] += 1
        if not mirrored:
            return DONE
        back = rows[~near_in_goal[rows]]
        add_edges(graph, near[back], here[: len(back)], costs[back], turns, back, -1, weights)
        return relax(graph, limit, K)

    attach_kernel: Callable[..., int] = attach
    return attach_kernel
