"""Where the parts of a graph lie in memory, for searches that must neither count references nor wait for it.

What a search needs of an edge, or of a vertex and its first nodes, lies together in a record: it asks for them at
random, and whatever lies apart is fetched apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pirrht.compiled.addresses import load_int32, load_int64
from pirrht.compiled.jit import inlined

ROOT = -1


class Places(NamedTuple):
    """Where a graph's arrays lie that long searches read and write, until it is given more room; addresses."""

    size: int
    pruned: int
    straight: int
    edges: int  # EDGE records
    edge_first: int
    edge_marker: int
    edge_turn: int
    vertices: int  # records of a vertex and its nodes
    marker: int
    turn: int
    queue_cost: int
    queue_vertex: int
    queue_key: int
    refill: int
    waiting: int
    M: int  # markers
    stride: int  # bytes from one vertex to the next
    K: int  # nodes that there is room for at each
    C: int  # pairs that there is room for in each of these
    queue: int  # entries that there is room for in the queue


EDGE = np.dtype(
    [("next_in", "i4"), ("tail", "i4"), ("edge_cost", "f8"), ("edge_key", "i8"), ("next_out", "i4"), ("head", "i4")]
)
NEXT_IN, TAIL, NEXT_OUT, HEAD = 0, 1, 6, 7  # places in an edge, in units of 4 bytes
EDGE_COST, EDGE_KEY = 1, 2  # and of 8
VERTEX_COUNT, EDGE_COUNT, QUEUE_COUNT, REFILL_COUNT, PAIR_COUNT = range(5)  # places in `size`
NODE = np.dtype([("cost", "f8"), ("key", "i8"), ("parent", "i4"), ("pairs", "i4")])
COST, KEY, PARENT, NODE_PAIR_COUNT = 0, 1, 4, 5  # places in a node
COUNT, FIRST_OUT, FIRST_IN = 0, 1, 2  # and in a vertex, whose nodes come after
HEADER = 16  # bytes
LINE = 64  # bytes that a processor fetches at once


@inlined
def places(graph):  # type: ignore[no-untyped-def]
    """The addresses of a graph's arrays; the graph must outlive them."""
    return Places(
        graph.size.ctypes.data, graph.pruned.ctypes.data, graph.straight.ctypes.data, graph.next_in.ctypes.data,
        graph.edge_first.ctypes.data, graph.edge_marker.ctypes.data, graph.edge_turn.ctypes.data,
        graph.nodes.ctypes.data, graph.marker.ctypes.data, graph.turn.ctypes.data, graph.queue_cost.ctypes.data,
        graph.queue_vertex.ctypes.data, graph.queue_key.ctypes.data, graph.refill.ctypes.data,
        graph.waiting.ctypes.data, graph.straight.shape[1], graph.nodes.strides[0], graph.cost.shape[1],
        graph.marker.shape[2], graph.queue_cost.shape[0],
    )  # fmt: skip


@inlined
def edge_at(at, e):  # type: ignore[no-untyped-def]
    """Address of an edge."""
    return at.edges + 32 * e


@inlined
def vertex_at(at, v):  # type: ignore[no-untyped-def]
    """Address of a vertex."""
    return at.vertices + at.stride * v


@inlined
def node_at(vertex, slot):  # type: ignore[no-untyped-def]
    """Address of a node of the vertex at an address."""
    return vertex + HEADER + 24 * slot


@inlined
def slot_of(vertex, key):  # type: ignore[no-untyped-def]
    """Slot of a class at the vertex at an address, -1 if it has none."""
    for slot in range(load_int32(vertex, COUNT)):
        if load_int64(node_at(vertex, slot), KEY) == key:
            return slot
    return -1


@inlined
def is_root(vertex):  # type: ignore[no-untyped-def]
    """Whether the vertex at an address lies in the goal's disc."""
    return load_int32(vertex, COUNT) > 0 and load_int32(node_at(vertex, 0), PARENT) == ROOT
