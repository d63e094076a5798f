"""The graph on the state space and the tree that it projects into the H-augmented space (paper, Algorithms 1-3).

Every vertex keeps its K cheapest allowed classes ("nodes"). A node stores its class, its cost and the edge to its
parent; the parent's class follows from the edge. Classes and edges keep their integers as (marker, turn) pairs, of
which there are few.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.jit import kernel
from pirrht.scene import Array
from pirrht.windings import Turns, key_of_pairs, spread

ROOT = -1
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


def empty_graph(vertices: int, edges: int, nodes: int, M: int) -> Graph:
    """Room for so many vertices, edges and nodes per vertex."""
    C = min(M, PAIRS)
    return Graph(
        size=np.zeros(5, np.int64),
        pruned=np.zeros(1, np.int64),
        straight=np.zeros((vertices, M)),
        first_out=np.full(vertices, -1, np.int32),
        first_in=np.full(vertices, -1, np.int32),
        tail=np.zeros(edges, np.int32),
        head=np.zeros(edges, np.int32),
        next_out=np.full(edges, -1, np.int32),
        next_in=np.full(edges, -1, np.int32),
        edge_cost=np.zeros(edges),
        edge_first=np.zeros(edges + 1, np.int64),
        edge_marker=np.zeros(edges, np.int32),
        edge_turn=np.zeros(edges, np.int16),
        edge_key=np.zeros(edges, np.int64),
        nodes=np.zeros(vertices, np.int32),
        cost=np.zeros((vertices, nodes)),
        key=np.zeros((vertices, nodes), np.int64),
        pairs=np.zeros((vertices, nodes), np.int32),
        marker=np.zeros((vertices, nodes, C), np.int32),
        turn=np.zeros((vertices, nodes, C), np.int16),
        parent=np.full((vertices, nodes), ROOT, np.int32),
        queue_cost=np.zeros(1024),
        queue_vertex=np.zeros(1024, np.int32),
        queue_key=np.zeros(1024, np.int64),
        refill=np.zeros(vertices, np.int32),
        waiting=np.zeros(vertices, np.bool_),
    )


EDGES = ("tail", "head", "next_out", "next_in", "edge_cost", "edge_first", "edge_key")
EDGE_PAIRS = ("edge_marker", "edge_turn")
VERTICES = ("straight", "first_out", "first_in", "nodes", "refill", "waiting")
NODES = ("cost", "key", "pairs", "parent", "marker", "turn")
NODE_PAIRS = ("marker", "turn")
NONE_YET = ("first_out", "first_in", "next_out", "next_in", "parent")  # -1 where there is nothing
QUEUE = ("queue_cost", "queue_vertex", "queue_key")


def doubled(graph: Graph, names: tuple[str, ...], axis: int = 0) -> Graph:
    """The graph with twice the room along one axis of the named arrays; what is in them stays."""
    bigger = {}
    for name in names:
        old = getattr(graph, name)
        shape = list(old.shape)
        shape[axis] *= 2
        bigger[name] = np.full(shape, -1 if name in NONE_YET else 0, old.dtype)
        bigger[name][tuple(slice(0, length) for length in old.shape)] = old
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


@kernel
def _add_edge(graph, tail, head, cost, turns, row, sign, key):  # type: ignore[no-untyped-def]
    """Append a directed edge and link it into both of its lists."""
    e, used = graph.size[1], graph.size[4]
    graph.size[1] = e + 1
    graph.tail[e], graph.head[e], graph.edge_cost[e], graph.edge_key[e] = tail, head, cost, sign * key
    for i in range(turns.first[row], turns.first[row + 1]):
        graph.edge_marker[used], graph.edge_turn[used] = turns.marker[i], sign * turns.turn[i]
        used += 1
    graph.edge_first[e + 1], graph.size[4] = used, used
    graph.next_out[e], graph.first_out[tail] = graph.first_out[tail], e
    graph.next_in[e], graph.first_in[head] = graph.first_in[head], e


@kernel
def add_edges(graph, tails, heads, costs, turns, rows, sign, weights):  # type: ignore[no-untyped-def]
    """Append many edges, whose turns are `sign` times those in `rows`; `weights` make the additive keys."""
    for i in range(tails.shape[0]):
        row = rows[i]
        key = key_of_pairs(turns.marker, turns.turn, turns.first[row], turns.first[row + 1], weights)
        _add_edge(graph, tails[i], heads[i], costs[i], turns, row, sign, key)


@kernel
def find(graph, vertex, key):  # type: ignore[no-untyped-def]
    """Slot of a class at a vertex, -1 if it has none."""
    keys = graph.key[vertex]
    for slot in range(graph.nodes[vertex]):
        if keys[slot] == key:
            return slot
    return -1


@kernel
def _remove(graph, vertex, slot):  # type: ignore[no-untyped-def]
    last = graph.nodes[vertex] - 1
    graph.cost[vertex, slot] = graph.cost[vertex, last]
    graph.key[vertex, slot] = graph.key[vertex, last]
    graph.parent[vertex, slot] = graph.parent[vertex, last]
    graph.pairs[vertex, slot] = graph.pairs[vertex, last]
    for k in range(graph.pairs[vertex, last]):
        graph.marker[vertex, slot, k] = graph.marker[vertex, last, k]
        graph.turn[vertex, slot, k] = graph.turn[vertex, last, k]
    graph.nodes[vertex] = last


@kernel
def evict(graph, vertex, slot):  # type: ignore[no-untyped-def]
    """Drop a node and every node that descends from it; their vertices will ask their successors again."""
    stack = [(np.int64(vertex), graph.key[vertex, slot])]
    _remove(graph, vertex, slot)
    while len(stack) > 0:
        v, key = stack.pop()
        e = graph.first_in[v]
        while e >= 0:
            u = graph.tail[e]
            child = find(graph, u, key + graph.edge_key[e])
            if child >= 0 and graph.parent[u, child] == e:
                stack.append((np.int64(u), graph.key[u, child]))
                _remove(graph, u, child)
                if not graph.waiting[u]:
                    graph.waiting[u] = True
                    graph.refill[graph.size[3]] = u
                    graph.size[3] += 1
            e = graph.next_in[e]
