"""The queue of nodes to propagate: a binary heap by cost in the arrays of the graph."""

from __future__ import annotations

from pirrht.jit import kernel


@kernel
def push(graph, cost, vertex, key):  # type: ignore[no-untyped-def]
    """Add a node that is to be propagated; there must be room."""
    i = graph.size[2]
    graph.size[2] = i + 1
    while i > 0 and graph.queue_cost[(i - 1) // 2] > cost:
        up = (i - 1) // 2
        _move(graph, up, i)
        i = up
    graph.queue_cost[i], graph.queue_vertex[i], graph.queue_key[i] = cost, vertex, key


@kernel
def _move(graph, source, target):  # type: ignore[no-untyped-def]
    graph.queue_cost[target] = graph.queue_cost[source]
    graph.queue_vertex[target] = graph.queue_vertex[source]
    graph.queue_key[target] = graph.queue_key[source]


@kernel
def pop(graph):  # type: ignore[no-untyped-def]
    """Take the cheapest node out: cost, vertex, key of its class."""
    cost, vertex, key = graph.queue_cost[0], graph.queue_vertex[0], graph.queue_key[0]
    last = graph.size[2] - 1
    graph.size[2] = last
    moved = graph.queue_cost[last]
    i = 0
    while 2 * i + 1 < last:
        child = 2 * i + 1
        if child + 1 < last and graph.queue_cost[child + 1] < graph.queue_cost[child]:
            child += 1
        if graph.queue_cost[child] >= moved:
            break
        _move(graph, child, i)
        i = child
    _move(graph, last, i)
    return cost, vertex, key
