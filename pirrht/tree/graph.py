"""The graph on the state space and the tree that it projects into the H-augmented space (paper, Algorithms 1-3).

Every vertex keeps its K cheapest allowed classes ("nodes"). A node stores its class, its cost and the edge to its
parent; the parent's class follows from the edge. Classes and edges keep their integers as (marker, turn) pairs, of
which there are few.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
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
from pirrht.topology.turns import Turns, spread
from pirrht.tree.layout import (
    COUNT,
    EDGE,
    EDGE_COST,
    EDGE_COUNT,
    EDGE_KEY,
    FIRST_IN,
    FIRST_OUT,
    HEAD,
    KEY,
    LINE,
    NEXT_IN,
    NEXT_OUT,
    NODE,
    NODE_PAIR_COUNT,
    PAIR_COUNT,
    PARENT,
    REFILL_COUNT,
    ROOT,
    TAIL,
    edge_at,
    node_at,
    places,
    slot_of,
    vertex_at,
)

PAIRS = 16  # room for so many (marker, turn) pairs of a class, to begin with


class Graph(NamedTuple):
    """Plain arrays with room to grow; the first `size` entries count. Kernels change them in place."""

    size: NDArray[np.int64]  # (5,) vertices, edges, queue entries, vertices to refill, pairs of edges
    pruned: NDArray[np.int64]  # (1,) classes refused or dropped because K cheaper ones were known
    straight: Array  # (V, M) H of the straight line to the goal point [turns]
    first_out: NDArray[np.int32]  # (V,) first edge that leaves a vertex, -1 if none
    first_in: NDArray[np.int32]  # (V,) first edge that enters it
    tail: NDArray[np.int32]  # (E,) vertices an edge leads from and to
    head: NDArray[np.int32]
    next_out: NDArray[np.int32]  # (E,) next edge with the same tail, and with the same head
    next_in: NDArray[np.int32]
    edge_cost: Array  # (E,)
    edge_first: NDArray[np.int64]  # (E+1,) first pair of each edge: whole turns that prepending it adds
    edge_marker: NDArray[np.int32]  # (P,)
    edge_turn: NDArray[np.int16]  # (P,)
    edge_key: NDArray[np.int64]  # (E,) those turns as an additive key
    nodes: NDArray[np.int32]  # (V,) number of nodes at a vertex
    cost: Array  # (V, K)
    key: NDArray[np.int64]  # (V, K) additive key of the class
    pairs: NDArray[np.int32]  # (V, K) number of pairs of the class itself
    marker: NDArray[np.int32]  # (V, K, C)
    turn: NDArray[np.int16]  # (V, K, C)
    parent: NDArray[np.int32]  # (V, K) edge to the parent, ROOT at a root
    queue_cost: Array  # (Q,) binary heap of nodes to propagate
    queue_vertex: NDArray[np.int32]
    queue_key: NDArray[np.int64]
    refill: NDArray[np.int32]  # (V,) vertices that lost nodes and must ask their successors again
    waiting: NDArray[np.bool_]  # (V,) whether a vertex is in that list


def _records(count: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Zeros that begin where a line does."""
    raw = np.zeros(count * dtype.itemsize + LINE, np.uint8)
    begin = -raw.ctypes.data % LINE
    return raw[begin : begin + count * dtype.itemsize].view(dtype)


def _edge_room(count: int) -> dict[str, NDArray[Any]]:
    """The arrays that lie together in the records of so many edges."""
    edge = _records(count, EDGE)
    edge["next_in"] = edge["next_out"] = -1
    return {name: edge[name] for name in EDGE.fields or ()}


def _vertex_room(count: int, nodes: int) -> dict[str, NDArray[Any]]:
    """The arrays that lie together in the records of so many vertices."""
    head = [("nodes", "i4"), ("first_out", "i4"), ("first_in", "i4"), ("", "i4")]
    vertex = _records(count, np.dtype([*head, ("node", NODE, (nodes,))]))
    vertex["first_out"] = vertex["first_in"] = -1
    vertex["node"]["parent"] = ROOT
    room = {name: vertex[name] for name in ("nodes", "first_out", "first_in")}
    return room | {name: vertex["node"][name] for name in NODE.fields or ()}


def empty_graph(vertices: int, edges: int, nodes: int, M: int) -> Graph:
    """Room for so many vertices, edges and nodes per vertex."""
    C = min(M, PAIRS)
    return Graph(
        size=np.zeros(5, np.int64),
        pruned=np.zeros(1, np.int64),
        straight=np.zeros((vertices, M)),
        edge_first=np.zeros(edges + 1, np.int64),
        edge_marker=np.zeros(edges, np.int32),
        edge_turn=np.zeros(edges, np.int16),
        marker=np.zeros((vertices, nodes, C), np.int32),
        turn=np.zeros((vertices, nodes, C), np.int16),
        queue_cost=np.zeros(1024),
        queue_vertex=np.zeros(1024, np.int32),
        queue_key=np.zeros(1024, np.int64),
        refill=np.zeros(vertices, np.int32),
        waiting=np.zeros(vertices, np.bool_),
        **_edge_room(edges),
        **_vertex_room(vertices, nodes),
    )


EDGES = ("edge_first", *(EDGE.names or ()))
EDGE_PAIRS = ("edge_marker", "edge_turn")
VERTICES = ("straight", "refill", "waiting")
NODES = (*(NODE.names or ()), "marker", "turn")
NODE_PAIRS = ("marker", "turn")
QUEUE = ("queue_cost", "queue_vertex", "queue_key")


def doubled(graph: Graph, names: tuple[str, ...], axis: int = 0) -> Graph:
    """The graph with twice the room along one axis of the named arrays; what is in them stays."""
    V, K = graph.cost.shape
    bigger: dict[str, NDArray[Any]] = {}
    if "tail" in names:
        bigger |= _edge_room(2 * len(graph.tail))
    if "cost" in names:
        bigger |= _vertex_room(2 * V if axis == 0 else V, 2 * K if axis == 1 else K)
    for name in set(names) - set(bigger):
        shape = list(getattr(graph, name).shape)
        shape[axis] *= 2
        bigger[name] = np.zeros(shape, getattr(graph, name).dtype)
    for name, new in bigger.items():
        old = getattr(graph, name)
        new[tuple(slice(0, length) for length in old.shape)] = old
    return graph._replace(**bigger)


def edge_turns(graph: Graph, edge: int) -> NDArray[np.int64]:
    """Whole turns (M,) that prepending an edge adds."""
    return Turns(graph.edge_first, graph.edge_marker, graph.edge_turn).dense(edge, graph.straight.shape[1])


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
def add_edge(at, tail, head, cost, turns, row, sign, weights):  # type: ignore[no-untyped-def]
    """Append a directed edge and link it into both of its lists."""
    e, used, key = load_int64(at.size, EDGE_COUNT), load_int64(at.size, PAIR_COUNT), np.int64(0)
    for i in range(turns.first[row], turns.first[row + 1]):
        marker, turn = turns.marker[i], sign * turns.turn[i]
        store_int32(at.edge_marker, used, marker)
        store_int16(at.edge_turn, used, turn)
        key += turn * weights[marker]
        used += 1
    edge, first_out, first_in = edge_at(at, e), vertex_at(at, tail), vertex_at(at, head)
    store_int32(edge, TAIL, tail)
    store_int32(edge, HEAD, head)
    store_float64(edge, EDGE_COST, cost)
    store_int64(edge, EDGE_KEY, key)
    store_int32(edge, NEXT_OUT, load_int32(first_out, FIRST_OUT))
    store_int32(edge, NEXT_IN, load_int32(first_in, FIRST_IN))
    store_int32(first_out, FIRST_OUT, e)
    store_int32(first_in, FIRST_IN, e)
    store_int64(at.edge_first, e + 1, used)
    store_int64(at.size, EDGE_COUNT, e + 1)
    store_int64(at.size, PAIR_COUNT, used)


@kernel
def add_edges(graph, tails, heads, costs, turns, rows, sign, weights):  # type: ignore[no-untyped-def]
    """Append many edges, whose turns are `sign` times those in `rows`; `weights` make the additive keys."""
    at = places(graph)
    for i in range(tails.shape[0]):
        add_edge(at, tails[i], heads[i], costs[i], turns, rows[i], sign, weights)


@inlined
def ask_again(at, v):  # type: ignore[no-untyped-def]
    """Note that a vertex must ask its successors for their nodes."""
    if load_int8(at.waiting, v) == 0:
        count = load_int64(at.size, REFILL_COUNT)
        store_int8(at.waiting, v, 1)
        store_int32(at.refill, count, v)
        store_int64(at.size, REFILL_COUNT, count + 1)


@kernel
def find(graph, vertex, key):  # type: ignore[no-untyped-def]
    """Slot of a class at a vertex, -1 if it has none."""
    return slot_of(vertex_at(places(graph), vertex), key)


@kernel
def _remove(at, v, slot):  # type: ignore[no-untyped-def]
    vertex = vertex_at(at, v)
    last = load_int32(vertex, COUNT) - 1
    node, end = node_at(vertex, slot), node_at(vertex, last)
    for i in range(3):
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
