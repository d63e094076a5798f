"""The queue of nodes to propagate: a binary heap by cost in the arrays of the graph, which are given by address."""

from __future__ import annotations

from pirrht.jit.addresses import load_float64, load_int32, load_int64, store_float64, store_int32, store_int64
from pirrht.jit.jit import inlined
from pirrht.planner.graph import QUEUE_COUNT


@inlined
def push(at, cost, vertex, key):  # type: ignore[no-untyped-def]
    """Add a node that is to be propagated by its cost [cost], vertex and key of its class; there must be room."""
    i = load_int64(at.size, QUEUE_COUNT)
    store_int64(at.size, QUEUE_COUNT, i + 1)
    while i > 0:
        up = (i - 1) // 2
        if load_float64(at.queue_cost, up) <= cost:
            break
        _move(at, up, i)
        i = up
    store_float64(at.queue_cost, i, cost)
    store_int32(at.queue_vertex, i, vertex)
    store_int64(at.queue_key, i, key)


@inlined
def _move(at, source, target):  # type: ignore[no-untyped-def]
    store_float64(at.queue_cost, target, load_float64(at.queue_cost, source))
    store_int32(at.queue_vertex, target, load_int32(at.queue_vertex, source))
    store_int64(at.queue_key, target, load_int64(at.queue_key, source))


@inlined
def pop(at):  # type: ignore[no-untyped-def]
    """Take the cheapest node out of a queue that has one: cost [cost], vertex, key of its class."""
    cost, vertex, key = load_float64(at.queue_cost, 0), load_int32(at.queue_vertex, 0), load_int64(at.queue_key, 0)
    last = load_int64(at.size, QUEUE_COUNT) - 1
    store_int64(at.size, QUEUE_COUNT, last)
    moved = load_float64(at.queue_cost, last)
    i = 0
    while 2 * i + 1 < last:
        child = 2 * i + 1
        if child + 1 < last and load_float64(at.queue_cost, child + 1) < load_float64(at.queue_cost, child):
            child += 1
        if load_float64(at.queue_cost, child) >= moved:
            break
        _move(at, child, i)
        i = child
    _move(at, last, i)
    return cost, vertex, key
