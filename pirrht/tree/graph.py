"""Edges and nodes of the graph on the state space, and the tree that it projects into the H-augmented space.

Every vertex keeps its K cheapest allowed classes ("nodes"). A node stores its class, its cost and the edge to its
parent; the parent's class follows from the edge. Classes and edges keep their integers as (marker, turn) pairs, of
which there are few.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pirrht.compiled.addresses import (
    load_int8,
    load_int16,
    load_int32,
    load_int64,
    store_float64,
    store_int8,
    store_int16,
    store_int32,
    store_int64,
)
from pirrht.compiled.jit import inlined, kernel
from pirrht.topology.turns import spread
from pirrht.tree.layout import (
    COUNT,
    EDGE_COST,
    EDGE_COUNT,
    EDGE_KEY,
    FIRST_IN,
    FIRST_OUT,
    HEAD,
    KEY,
    NEXT_IN,
    NEXT_OUT,
    NODE_BYTES,
    NODE_PAIR_COUNT,
    PAIR_COUNT,
    PARENT,
    REFILL_COUNT,
    TAIL,
    Graph,
    edge_at,
    node_at,
    slot_of,
    vertex_at,
)


def edge_turns_around(graph: Graph, obstacle: int) -> NDArray[np.int64]:
    """Whole turns (E,) that prepending each edge adds around one obstacle."""
    used = int(graph.size[4])
    found = np.flatnonzero(graph.edge_marker[:used] == obstacle)
    turns = np.zeros(len(graph.tail), dtype=np.int64)
    turns[np.searchsorted(graph.edge_first[: graph.size[1] + 1], found, side="right") - 1] = graph.edge_turn[found]
    return turns


def node_turns_around(
    graph: Graph, vertex: NDArray[np.int64], slot: NDArray[np.int64], obstacle: int
) -> NDArray[np.int64]:
    """The integers (k,) that the classes of nodes have around one obstacle."""
    known = np.arange(graph.marker.shape[2]) < graph.pairs[vertex, slot][:, None]
    match = known & (graph.marker[vertex, slot] == obstacle)
    turns: NDArray[np.int64] = np.sum(graph.turn[vertex, slot] * match, axis=1, dtype=np.int64)
    return turns


def class_at(graph: Graph, vertex: int, slot: int) -> NDArray[np.int64]:
    """The integers (M,) of a node's class."""
    count = graph.pairs[vertex, slot]
    return spread(graph.marker[vertex, slot, :count], graph.turn[vertex, slot, :count], graph.straight.shape[1])


@inlined
def add_edge(at, tail, head, edges, i, sign, weights):  # type: ignore[no-untyped-def]
    """Append a directed edge and link it into both of its lists.

    It costs what edge i of `edges` does and has `sign` times its turns; `weights` (M,) make the additive key.
    """
    e, used, key = load_int64(at.size, EDGE_COUNT), load_int64(at.size, PAIR_COUNT), np.int64(0)
    turns = edges.turns
    for j in range(turns.first[i], turns.first[i + 1]):
        marker, turn = turns.marker[j], sign * turns.turn[j]
        store_int32(at.edge_marker, used, marker)
        store_int16(at.edge_turn, used, turn)
        key += turn * weights[marker]
        used += 1
    edge, first_out, first_in = edge_at(at, e), vertex_at(at, tail), vertex_at(at, head)
    store_int32(edge, TAIL, tail)
    store_int32(edge, HEAD, head)
    store_float64(edge, EDGE_COST, edges.cost[i])
    store_int64(edge, EDGE_KEY, key)
    store_int32(edge, NEXT_OUT, load_int32(first_out, FIRST_OUT))
    store_int32(edge, NEXT_IN, load_int32(first_in, FIRST_IN))
    store_int32(first_out, FIRST_OUT, e)
    store_int32(first_in, FIRST_IN, e)
    store_int64(at.edge_first, e + 1, used)
    store_int64(at.size, EDGE_COUNT, e + 1)
    store_int64(at.size, PAIR_COUNT, used)


@inlined
def ask_again(at, v):  # type: ignore[no-untyped-def]
    """Note that a vertex must ask its successors for their nodes."""
    if load_int8(at.waiting, v) == 0:
        count = load_int64(at.size, REFILL_COUNT)
        store_int8(at.waiting, v, 1)
        store_int32(at.refill, count, v)
        store_int64(at.size, REFILL_COUNT, count + 1)


@kernel
def find(at, vertex, key):  # type: ignore[no-untyped-def]
    """Slot of a class at a vertex, -1 if it has none."""
    return slot_of(vertex_at(at, vertex), key)


@kernel
def _remove(at, v, slot):  # type: ignore[no-untyped-def]
    vertex = vertex_at(at, v)
    last = load_int32(vertex, COUNT) - 1
    node, end = node_at(vertex, slot), node_at(vertex, last)
    for i in range(NODE_BYTES // 8):
        store_int64(node, i, load_int64(end, i))
    to, start = (v * at.K + slot) * at.C, (v * at.K + last) * at.C
    for k in range(load_int32(end, NODE_PAIR_COUNT)):
        store_int32(at.marker, to + k, load_int32(at.marker, start + k))
        store_int16(at.turn, to + k, load_int16(at.turn, start + k))
    store_int32(vertex, COUNT, last)


@kernel
def evict(at, v, slot):  # type: ignore[no-untyped-def]
    """Drop a node and every node that descends from it; their vertices will ask their successors again."""
    stack = [(np.int64(v), load_int64(node_at(vertex_at(at, v), slot), KEY))]
    _remove(at, v, slot)
    while len(stack) > 0:
        v, key = stack.pop()
        e = load_int32(vertex_at(at, v), FIRST_IN)
        while e >= 0:
            edge = edge_at(at, e)
            u = np.int64(load_int32(edge, TAIL))
            vertex = vertex_at(at, u)
            child = slot_of(vertex, key + load_int64(edge, EDGE_KEY))
            if child >= 0 and load_int32(node_at(vertex, child), PARENT) == e:
                stack.append((u, load_int64(node_at(vertex, child), KEY)))
                _remove(at, u, child)
                ask_again(at, u)
            e = load_int32(edge, NEXT_IN)
