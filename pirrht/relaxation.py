"""Relaxation of the graph, a uniform-cost search over plain arrays, and the best classes at a state."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit, objmode

from pirrht.graph import ROOT, evict, find
from pirrht.heap import pop, push
from pirrht.jit import jitable, kernel
from pirrht.scene import Array
from pirrht.windings import key_of_pairs, summed

DONE, NODES_FULL, QUEUE_FULL, PAIRS_FULL = 0, 1, 2, 3
NEW = 4  # a node has been added
TIE = 1e-12  # costs closer than this are equal: rounding must not make two nodes replace each other forever


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

    default = allowed is within_limit

    @kernel
    def admits(straight, marker, turn, count, limit):  # type: ignore[no-untyped-def]
        """Whether a class is allowed where straight lines have the signature `straight` (M,)."""
        if default and limit >= 0.5:  # a straight line turns at most half: only what turns more can break the limit
            for i in range(count):  # noqa: SIM110
                if abs(straight[marker[i]] + turn[i]) > limit:
                    return False
            return True
        signature = straight.copy()
        for i in range(count):
            signature[marker[i]] += turn[i]
        return allowed(signature, limit)

    @kernel
    def insert(graph, vertex, cost, key, source, at, e, limit, K):  # type: ignore[no-untyped-def]
        """The part of AppendNode that concerns a class which the vertex does not know: NEW, DONE or what must grow."""
        marker, turn, many = joined(
            graph, source, at, graph.edge_marker, graph.edge_turn, graph.edge_first[e], graph.edge_first[e + 1]
        )
        if not admits(graph.straight[vertex], marker, turn, many, limit):
            return DONE
        count = graph.nodes[vertex]
        full, worst, costs = K > 0 and count >= K, 0, graph.cost[vertex]
        for i in range(1, count if full else 0):
            if costs[i] > costs[worst]:
                worst = i
        if full and cost >= costs[worst] - TIE:
            graph.pruned[0] += 1
            return DONE
        if many > graph.marker.shape[2]:
            return PAIRS_FULL
        if full:
            graph.pruned[0] += 1
            evict(graph, vertex, worst)
            count = graph.nodes[vertex]
        graph.cost[vertex, count], graph.key[vertex, count], graph.parent[vertex, count] = cost, key, e
        graph.pairs[vertex, count] = many
        node_marker, node_turn = graph.marker[vertex, count], graph.turn[vertex, count]
        for k in range(many):
            node_marker[k], node_turn[k] = marker[k], turn[k]
        graph.nodes[vertex] = count + 1
        return NEW

    @kernel
    def append(graph, vertex, cost, key, source, at, e, limit, K):  # type: ignore[no-untyped-def]
        """AppendNode for the class that edge e makes of node `at` of vertex `source`; queues what is new or cheaper.

        What must grow first, or DONE, also if the node is dominated, blocked or pruned.
        """
        if graph.nodes[vertex] >= graph.cost.shape[1] and K == 0:
            return NODES_FULL
        if graph.size[2] + 1 >= graph.queue_cost.shape[0]:
            return QUEUE_FULL
        slot = find(graph, vertex, key)
        if slot < 0:
            result = insert(graph, vertex, cost, key, source, at, e, limit, K)
            if result != NEW:
                return result
        elif cost >= graph.cost[vertex, slot] - TIE:
            return DONE
        else:
            graph.cost[vertex, slot] = cost
            graph.parent[vertex, slot] = e
        push(graph, cost, vertex, key)
        return DONE

    @kernel
    def fill(graph, vertex, limit, K):  # type: ignore[no-untyped-def]
        """ChooseParent: offer a vertex the nodes of all its successors; what must grow first, or DONE."""
        if graph.nodes[vertex] > 0 and graph.parent[vertex, 0] == ROOT:
            return DONE
        evicted = -1
        while evicted != graph.size[3]:  # an eviction moves nodes about: look again until none happens
            evicted = graph.size[3]
            e = graph.first_out[vertex]
            while e >= 0:
                h = graph.head[e]
                for slot in range(graph.nodes[h]):
                    key = graph.key[h, slot] + graph.edge_key[e]
                    cost = graph.cost[h, slot] + graph.edge_cost[e]
                    status = append(graph, vertex, cost, key, h, slot, e, limit, K)
                    if status != DONE:
                        return status
                e = graph.next_out[e]
        return DONE

    @kernel
    def expand(graph, cost, vertex, key, limit, K):  # type: ignore[no-untyped-def]
        """Offer a node to all predecessors of its vertex; what must grow first, or DONE."""
        e = graph.first_in[vertex]
        while e >= 0:
            u = graph.tail[e]
            if graph.nodes[u] == 0 or graph.parent[u, 0] != ROOT:
                new_key, new_cost = key + graph.edge_key[e], cost + graph.edge_cost[e]
                slot = find(graph, vertex, key)  # an eviction may have moved it
                status = append(graph, u, new_cost, new_key, vertex, slot, e, limit, K)
                if status != DONE:
                    return status
            e = graph.next_in[e]
        return DONE

    @kernel
    def relax(graph, limit, K):  # type: ignore[no-untyped-def]
        """Rewire, lines 9-17: uniform-cost search until nothing improves; says what must grow if room runs out."""
        while graph.size[2] > 0 or graph.size[3] > 0:
            pruned = graph.pruned[0]
            while graph.size[3] > 0:
                vertex = graph.refill[graph.size[3] - 1]
                status = fill(graph, vertex, limit, K)
                if status == PAIRS_FULL:
                    graph.pruned[0] = pruned  # what was refused will be refused, and counted, again
                if status != DONE:
                    return status
                if graph.refill[graph.size[3] - 1] == vertex:
                    graph.size[3] -= 1
                    graph.waiting[vertex] = False
                pruned = graph.pruned[0]
            if graph.size[2] == 0:
                break
            cost, vertex, key = pop(graph)
            slot = find(graph, vertex, key)
            if slot < 0 or graph.cost[vertex, slot] != cost:
                continue
            status = expand(graph, cost, vertex, key, limit, K)
            if status != DONE:
                if status == PAIRS_FULL:
                    graph.pruned[0] = pruned
                push(graph, cost, vertex, key)
                return status
        return DONE

    @kernel
    def best_classes(graph, straight, heads, costs, turns, rows, weights, limit, out_cost, out_key, out_edge, out_slot):  # type: ignore[no-untyped-def] # fmt: skip
        """Algorithm 5: the cheapest way into each allowed class over candidate edges; number of classes found."""
        count = 0
        for i in range(heads.shape[0]):
            h, first, end = heads[i], turns.first[rows[i]], turns.first[rows[i] + 1]
            edge_key = key_of_pairs(turns.marker, turns.turn, first, end, weights)
            for slot in range(graph.nodes[h]):
                cost, key = costs[i] + graph.cost[h, slot], graph.key[h, slot] + edge_key
                at = -1
                for j in range(count):
                    if out_key[j] == key:
                        at = j
                        break
                if at < 0:
                    at = count
                    if count == out_cost.shape[0]:
                        at = 0
                        for j in range(1, count):
                            if out_cost[j] > out_cost[at]:
                                at = j
                        if cost >= out_cost[at]:
                            continue
                    marker, turn, many = joined(graph, h, slot, turns.marker, turns.turn, first, end)
                    if not admits(straight, marker, turn, many, limit):
                        continue
                    count = max(count, at + 1)
                elif cost >= out_cost[at]:
                    continue
                out_cost[at], out_key[at], out_edge[at], out_slot[at] = cost, key, i, slot
        return count

    return Kernels(relax, best_classes)


@kernel
def joined(graph, source, at, edge_marker, edge_turn, first, end):  # type: ignore[no-untyped-def]
    """Pairs of node `at` of vertex `source` and those of an edge from `first` to `end`, summed, and their number."""
    count = graph.pairs[source, at]
    node_marker, node_turn = graph.marker[source, at], graph.turn[source, at]
    most = count + end - first
    marker, turn = np.empty(most, np.int32), np.empty(most, np.int16)
    total = np.zeros(graph.straight.shape[1], np.int16)
    for i in range(count):
        marker[i], turn[i] = node_marker[i], node_turn[i]
    for i in range(first, end):
        marker[count], turn[count] = edge_marker[i], edge_turn[i]
        count += 1
    return marker, turn, summed(total, marker, turn, 0, count)
