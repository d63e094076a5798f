"""The graph on the state space and the tree that it projects into the H-augmented space (paper, Algorithms 1-3).

Every vertex keeps its K cheapest allowed classes ("nodes"). A node stores its class, its cost and the edge to its
parent; the parent's class follows from the edge. Relaxation is a uniform-cost search over plain arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit, objmode
from numpy.typing import NDArray

from pirrht.jit import jitable, kernel
from pirrht.scene import Array

DONE, NODES_FULL, QUEUE_FULL = 0, 1, 2
ROOT = -1
TIE = 1e-12  # costs closer than this are equal: rounding must not make two nodes replace each other forever


class Graph(NamedTuple):
    """Plain arrays with room to grow; the first `size` entries count. Kernels change them in place."""

    size: NDArray[np.int64]  # (4,) vertices, edges, queue entries, vertices to refill
    pruned: NDArray[np.int64]  # (1,) classes refused or dropped because K cheaper ones were known
    straight: Array  # (V, M) H of the straight line to the goal point [turns]
    first_out: NDArray[np.int32]  # (V,) first edge that leaves a vertex, -1 if none
    first_in: NDArray[np.int32]  # (V,) first edge that enters it
    tail: NDArray[np.int32]  # (E,) vertices an edge leads from and to
    head: NDArray[np.int32]
    next_out: NDArray[np.int32]  # (E,) next edge with the same tail, and with the same head
    next_in: NDArray[np.int32]
    edge_cost: Array  # (E,)
    edge_turns: NDArray[np.int32]  # (E, M) whole turns that prepending the edge adds
    edge_key: NDArray[np.int64]  # (E,) the same as an additive key
    nodes: NDArray[np.int32]  # (V,) number of nodes at a vertex
    cost: Array  # (V, K)
    key: NDArray[np.int64]  # (V, K) additive key of the class
    turns: NDArray[np.int32]  # (V, K, M) the class itself
    parent: NDArray[np.int32]  # (V, K) edge to the parent, ROOT at a root
    queue_cost: Array  # (Q,) binary heap of nodes to propagate
    queue_vertex: NDArray[np.int32]
    queue_key: NDArray[np.int64]
    refill: NDArray[np.int32]  # (V,) vertices that lost nodes and must ask their successors again
    waiting: NDArray[np.bool_]  # (V,) whether a vertex is in that list


def empty_graph(vertices: int, edges: int, nodes: int, M: int) -> Graph:
    """Room for so many vertices, edges and nodes per vertex."""
    return Graph(
        size=np.zeros(4, np.int64),
        pruned=np.zeros(1, np.int64),
        straight=np.zeros((vertices, M)),
        first_out=np.full(vertices, -1, np.int32),
        first_in=np.full(vertices, -1, np.int32),
        tail=np.zeros(edges, np.int32),
        head=np.zeros(edges, np.int32),
        next_out=np.full(edges, -1, np.int32),
        next_in=np.full(edges, -1, np.int32),
        edge_cost=np.zeros(edges),
        edge_turns=np.zeros((edges, M), np.int32),
        edge_key=np.zeros(edges, np.int64),
        nodes=np.zeros(vertices, np.int32),
        cost=np.zeros((vertices, nodes)),
        key=np.zeros((vertices, nodes), np.int64),
        turns=np.zeros((vertices, nodes, M), np.int32),
        parent=np.full((vertices, nodes), ROOT, np.int32),
        queue_cost=np.zeros(1024),
        queue_vertex=np.zeros(1024, np.int32),
        queue_key=np.zeros(1024, np.int64),
        refill=np.zeros(vertices, np.int32),
        waiting=np.zeros(vertices, np.bool_),
    )


def enlarged(graph: Graph, vertices: int, edges: int, nodes: int, queue: int) -> Graph:
    """A copy with more room; every array keeps its content."""
    M = graph.straight.shape[1]
    bigger = empty_graph(vertices, edges, nodes, M)._replace(
        queue_cost=np.zeros(queue),
        queue_vertex=np.zeros(queue, np.int32),
        queue_key=np.zeros(queue, np.int64),
    )
    arrays: list[tuple[NDArray[Any], NDArray[Any]]] = list(zip(graph, bigger, strict=True))  # type: ignore[arg-type]
    for old, new in arrays:
        new[tuple(slice(0, length) for length in old.shape)] = old
    return bigger


@kernel
def _add_edge(graph, tail, head, cost, turns, row, key):  # type: ignore[no-untyped-def]
    """Append a directed edge and link it into both of its lists."""
    e = graph.size[1]
    graph.size[1] = e + 1
    graph.tail[e], graph.head[e], graph.edge_cost[e], graph.edge_key[e] = tail, head, cost, key
    for k in range(turns.shape[1]):
        graph.edge_turns[e, k] = turns[row, k]
    graph.next_out[e], graph.first_out[tail] = graph.first_out[tail], e
    graph.next_in[e], graph.first_in[head] = graph.first_in[head], e


@kernel
def add_edges(graph, tails, heads, costs, turns, weights):  # type: ignore[no-untyped-def]
    """Append many edges; `weights` make the additive keys."""
    for i in range(tails.shape[0]):
        key = np.int64(0)
        for k in range(weights.shape[0]):
            key += np.int64(turns[i, k]) * weights[k]
        _add_edge(graph, tails[i], heads[i], costs[i], turns, i, key)


@kernel
def find(graph, vertex, key):  # type: ignore[no-untyped-def]
    """Slot of a class at a vertex, -1 if it has none."""
    for slot in range(graph.nodes[vertex]):
        if graph.key[vertex, slot] == key:
            return slot
    return -1


@kernel
def _push(graph, cost, vertex, key):  # type: ignore[no-untyped-def]
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
def _pop(graph):  # type: ignore[no-untyped-def]
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


@kernel
def _remove(graph, vertex, slot):  # type: ignore[no-untyped-def]
    last = graph.nodes[vertex] - 1
    graph.cost[vertex, slot] = graph.cost[vertex, last]
    graph.key[vertex, slot] = graph.key[vertex, last]
    graph.parent[vertex, slot] = graph.parent[vertex, last]
    for k in range(graph.turns.shape[2]):
        graph.turns[vertex, slot, k] = graph.turns[vertex, last, k]
    graph.nodes[vertex] = last


@kernel
def _evict(graph, vertex, slot):  # type: ignore[no-untyped-def]
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


@jitable
def within_limit(signature, limit):  # type: ignore[no-untyped-def]
    """The paper's allowed set: |1 - H_i| <= limit for every obstacle; the signature (M,) comes without the 1."""
    for k in range(signature.shape[0]):  # noqa: SIM110
        if abs(signature[k]) > limit:
            return False
    return True


@cache  # kernels are built once per predicate
def user_predicate(predicate: Callable[[Array], bool]) -> Callable[..., Any]:
    """Wrap any Python predicate on the paper's H (M,), leading 1 included, for use in the kernels."""

    @njit
    def allowed(signature, limit):  # type: ignore[no-untyped-def]
        with objmode(verdict="boolean"):
            verdict = bool(predicate(1.0 + signature))
        return verdict

    wrapped: Callable[..., Any] = allowed
    return wrapped


class Kernels(NamedTuple):
    """The compiled parts that depend on the allowed set."""

    relax: Callable[..., int]
    best_classes: Callable[..., int]


@cache
def kernels(allowed: Callable[..., Any] = within_limit) -> Kernels:
    """Relaxation and look-up for one allowed set (compiled once, cached on disk for the default)."""

    @kernel
    def append(graph, vertex, cost, key, source, at, e, limit, K):  # type: ignore[no-untyped-def]
        """AppendNode for the class that edge e makes of node `at` of vertex `source`.

        Whether the node is new or cheaper, and neither dominated nor blocked nor pruned.
        """
        slot = find(graph, vertex, key)
        if slot >= 0:
            if cost >= graph.cost[vertex, slot] - TIE:
                return False
            graph.cost[vertex, slot] = cost
            graph.parent[vertex, slot] = e
            return True
        M = graph.turns.shape[2]
        turns, signature = np.empty(M, np.int32), np.empty(M)
        for k in range(M):
            turns[k] = graph.turns[source, at, k] + graph.edge_turns[e, k]
            signature[k] = graph.straight[vertex, k] + turns[k]
        if not allowed(signature, limit):
            return False
        count = graph.nodes[vertex]
        if K > 0 and count >= K:
            worst = 0
            for i in range(1, count):
                if graph.cost[vertex, i] > graph.cost[vertex, worst]:
                    worst = i
            graph.pruned[0] += 1
            if cost >= graph.cost[vertex, worst] - TIE:
                return False
            _evict(graph, vertex, worst)
            count = graph.nodes[vertex]
        graph.cost[vertex, count], graph.key[vertex, count], graph.parent[vertex, count] = cost, key, e
        for k in range(M):
            graph.turns[vertex, count, k] = turns[k]
        graph.nodes[vertex] = count + 1
        return True

    @kernel
    def fill(graph, vertex, limit, K):  # type: ignore[no-untyped-def]
        """ChooseParent: offer a vertex the nodes of all its successors; False if there is no room for them."""
        if graph.nodes[vertex] > 0 and graph.parent[vertex, 0] == ROOT:
            return True
        evicted = -1
        while evicted != graph.size[3]:  # an eviction moves nodes about: look again until none happens
            evicted = graph.size[3]
            e = graph.first_out[vertex]
            while e >= 0:
                h = graph.head[e]
                for slot in range(graph.nodes[h]):
                    if graph.nodes[vertex] >= graph.cost.shape[1] and K == 0:
                        return False
                    if graph.size[2] + 1 >= graph.queue_cost.shape[0]:
                        return False
                    key = graph.key[h, slot] + graph.edge_key[e]
                    cost = graph.cost[h, slot] + graph.edge_cost[e]
                    if append(graph, vertex, cost, key, h, slot, e, limit, K):
                        _push(graph, cost, vertex, key)
                e = graph.next_out[e]
        return True

    @kernel
    def relax(graph, limit, K):  # type: ignore[no-untyped-def]
        """Rewire, lines 9-17: uniform-cost search until nothing improves; says what must grow if room runs out."""
        while graph.size[2] > 0 or graph.size[3] > 0:
            while graph.size[3] > 0:
                vertex = graph.refill[graph.size[3] - 1]
                if not fill(graph, vertex, limit, K):
                    return QUEUE_FULL if graph.size[2] + 1 >= graph.queue_cost.shape[0] else NODES_FULL
                if graph.refill[graph.size[3] - 1] == vertex:
                    graph.size[3] -= 1
                    graph.waiting[vertex] = False
            if graph.size[2] == 0:
                break
            cost, vertex, key = _pop(graph)
            slot = find(graph, vertex, key)
            if slot < 0 or graph.cost[vertex, slot] != cost:
                continue
            e = graph.first_in[vertex]
            while e >= 0:
                u = graph.tail[e]
                room = K > 0 or graph.nodes[u] < graph.cost.shape[1]
                if not room or graph.size[2] + 1 >= graph.queue_cost.shape[0]:
                    _push(graph, cost, vertex, key)
                    return NODES_FULL if not room else QUEUE_FULL
                if graph.nodes[u] == 0 or graph.parent[u, 0] != ROOT:
                    new_key, new_cost = key + graph.edge_key[e], cost + graph.edge_cost[e]
                    slot = find(graph, vertex, key)  # an eviction may have moved it
                    if append(graph, u, new_cost, new_key, vertex, slot, e, limit, K):
                        _push(graph, new_cost, u, new_key)
                e = graph.next_in[e]
        return DONE

    @kernel
    def best_classes(graph, straight, heads, costs, turns, weights, limit, out_cost, out_key, out_turns, out_edge, out_slot):  # type: ignore[no-untyped-def] # fmt: skip  # noqa: E501
        """Algorithm 5: the cheapest way into each allowed class over candidate edges; number of classes found."""
        count = 0
        M = straight.shape[0]
        whole, signature = np.empty(M, np.int32), np.empty(M)
        for i in range(heads.shape[0]):
            h = heads[i]
            for slot in range(graph.nodes[h]):
                cost = costs[i] + graph.cost[h, slot]
                key = graph.key[h, slot]
                for k in range(M):
                    whole[k] = graph.turns[h, slot, k] + turns[i, k]
                    signature[k] = straight[k] + whole[k]
                    key += np.int64(turns[i, k]) * weights[k]
                at = -1
                for j in range(count):
                    if out_key[j] == key:
                        at = j
                        break
                if at < 0:
                    if not allowed(signature, limit):
                        continue
                    at = count
                    if count == out_cost.shape[0]:
                        at = 0
                        for j in range(1, count):
                            if out_cost[j] > out_cost[at]:
                                at = j
                        if cost >= out_cost[at]:
                            continue
                    else:
                        count += 1
                elif cost >= out_cost[at]:
                    continue
                out_cost[at], out_key[at], out_edge[at], out_slot[at] = cost, key, i, slot
                for k in range(M):
                    out_turns[at, k] = whole[k]
        return count

    return Kernels(relax, best_classes)
