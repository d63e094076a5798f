"""Relaxation of the graph, a uniform-cost search over plain arrays, and the best classes at a state."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.compiled.addresses import (
    load_float64,
    load_int32,
    load_int64,
    store_float64,
    store_int8,
    store_int16,
    store_int32,
    store_int64,
)
from pirrht.compiled.jit import inlined, kernel
from pirrht.topology.turns import key_of_pairs
from pirrht.tree.allowed import exceeds, joined, within_limit
from pirrht.tree.graph import evict
from pirrht.tree.layout import (
    COST,
    COUNT,
    EDGE_COST,
    EDGE_KEY,
    FIRST_IN,
    FIRST_OUT,
    HEAD,
    KEY,
    NEXT_IN,
    NEXT_OUT,
    NODE_PAIR_COUNT,
    PARENT,
    QUEUE_COUNT,
    REFILL_COUNT,
    TAIL,
    edge_at,
    is_root,
    node_at,
    places,
    slot_of,
    vertex_at,
)
from pirrht.tree.queue import pop, push

DONE, NODES_FULL, QUEUE_FULL, PAIRS_FULL = 0, 1, 2, 3
NEW = 4  # a node has been added
TIE = 1e-12  # costs closer than this are equal: rounding must not make two nodes replace each other forever


class Kernels(NamedTuple):
    """The compiled parts that depend on the allowed set."""

    settle: Callable[..., int]
    relax: Callable[..., int]
    reaches: Callable[..., bool]
    best_classes: Callable[..., int]


@cache
def kernels(allowed: Callable[..., Any] = within_limit) -> Kernels:
    """Relaxation and look-up for one allowed set (compiled once, cached on disk for the default)."""

    default = allowed is within_limit

    @kernel
    def admits(straight, M, marker, turn, count, limit):  # type: ignore[no-untyped-def]
        """Whether a class is allowed where straight lines have the signature at an address (M,)."""
        if default and limit >= 0.5:  # a straight line turns at most half: only what turns more can break the limit
            for i in range(count):  # noqa: SIM110
                if abs(load_float64(straight, marker[i]) + turn[i]) > limit:
                    return False
            return True
        signature = np.empty(M)
        for k in range(M):
            signature[k] = load_float64(straight, k)
        for i in range(count):
            signature[marker[i]] += turn[i]
        return allowed(signature, limit)

    @kernel
    def insert(at, v, cost, key, source, slot, e, limit, K):  # type: ignore[no-untyped-def]
        """The part of AppendNode that concerns a class which the vertex does not know: NEW, DONE or what must grow."""
        marker, turn, many = joined(
            at, source, slot, at.edge_marker, at.edge_turn, load_int64(at.edge_first, e),
            load_int64(at.edge_first, e + 1),
        )  # fmt: skip
        if not admits(at.straight + 8 * at.M * v, at.M, marker, turn, many, limit):
            return DONE
        vertex = vertex_at(at, v)
        count = load_int32(vertex, COUNT)
        full, worst = K > 0 and count >= K, 0
        for i in range(1, count if full else 0):
            if load_float64(node_at(vertex, i), COST) > load_float64(node_at(vertex, worst), COST):
                worst = i
        if full and cost >= load_float64(node_at(vertex, worst), COST) - TIE:
            store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
            return DONE
        if many > at.C:
            return PAIRS_FULL
        if full:
            store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
            evict(at, v, worst)
            count = load_int32(vertex, COUNT)
        node = node_at(vertex, count)
        store_float64(node, COST, cost)
        store_int64(node, KEY, key)
        store_int32(node, PARENT, e)
        store_int32(node, NODE_PAIR_COUNT, many)
        begin = (v * at.K + count) * at.C
        for k in range(many):
            store_int32(at.marker, begin + k, marker[k])
            store_int16(at.turn, begin + k, turn[k])
        store_int32(vertex, COUNT, count + 1)
        return NEW

    @inlined
    def append(at, v, cost, key, source, slot, e, limit, K):  # type: ignore[no-untyped-def]
        """AppendNode for the class that edge e makes of node `slot` of vertex `source`; queues what is new or cheaper.

        What must grow first, or DONE, also if the node is dominated, blocked or pruned.
        """
        vertex = vertex_at(at, v)
        if K == 0 and load_int32(vertex, COUNT) >= at.K:
            return NODES_FULL
        if load_int64(at.size, QUEUE_COUNT) + 1 >= at.queue:
            return QUEUE_FULL
        known = slot_of(vertex, key)
        if known >= 0:
            node = node_at(vertex, known)
            if cost >= load_float64(node, COST) - TIE:
                return DONE
            store_float64(node, COST, cost)
            store_int32(node, PARENT, e)
        else:
            if default and limit >= 0.5 and exceeds(at, v, source, slot, e, limit):
                return DONE
            result = insert(at, v, cost, key, source, slot, e, limit, K)
            if result != NEW:
                return result
        push(at, cost, v, key)
        return DONE

    @kernel
    def fill(at, v, limit, K):  # type: ignore[no-untyped-def]
        """ChooseParent: offer a vertex the nodes of all its successors; what must grow first, or DONE."""
        vertex = vertex_at(at, v)
        if is_root(vertex):
            return DONE
        evicted = -1
        while evicted != load_int64(at.size, REFILL_COUNT):  # an eviction moves nodes about: look until none happens
            evicted = load_int64(at.size, REFILL_COUNT)
            e = load_int32(vertex, FIRST_OUT)
            while e >= 0:
                edge = edge_at(at, e)
                h = load_int32(edge, HEAD)
                head, slot = vertex_at(at, h), 0
                while slot < load_int32(head, COUNT):
                    node = node_at(head, slot)
                    key = load_int64(node, KEY) + load_int64(edge, EDGE_KEY)
                    cost = load_float64(node, COST) + load_float64(edge, EDGE_COST)
                    status = append(at, v, cost, key, h, slot, e, limit, K)
                    if status != DONE:
                        return status
                    slot += 1
                e = load_int32(edge, NEXT_OUT)
        return DONE

    @inlined
    def expand(at, cost, v, key, limit, K):  # type: ignore[no-untyped-def]
        """Offer a node to all predecessors of its vertex; what must grow first, or DONE."""
        vertex = vertex_at(at, v)
        e = load_int32(vertex, FIRST_IN)
        while e >= 0:
            edge = edge_at(at, e)
            u = load_int32(edge, TAIL)
            if not is_root(vertex_at(at, u)):
                new_key, new_cost = key + load_int64(edge, EDGE_KEY), cost + load_float64(edge, EDGE_COST)
                slot = slot_of(vertex, key)  # an eviction may have moved it
                status = append(at, u, new_cost, new_key, v, slot, e, limit, K)
                if status != DONE:
                    return status
            e = load_int32(edge, NEXT_IN)
        return DONE

    @inlined
    def settle(at, limit, K):  # type: ignore[no-untyped-def]
        """Rewire, lines 9-17: uniform-cost search until nothing improves; says what must grow if room runs out."""
        while load_int64(at.size, QUEUE_COUNT) > 0 or load_int64(at.size, REFILL_COUNT) > 0:
            pruned = load_int64(at.pruned, 0)
            while load_int64(at.size, REFILL_COUNT) > 0:
                last = load_int64(at.size, REFILL_COUNT) - 1
                v = load_int32(at.refill, last)
                status = fill(at, v, limit, K)
                if status == PAIRS_FULL:
                    store_int64(at.pruned, 0, pruned)  # what was refused will be refused, and counted, again
                if status != DONE:
                    return status
                last = load_int64(at.size, REFILL_COUNT) - 1
                if load_int32(at.refill, last) == v:
                    store_int64(at.size, REFILL_COUNT, last)
                    store_int8(at.waiting, v, 0)
                pruned = load_int64(at.pruned, 0)
            if load_int64(at.size, QUEUE_COUNT) == 0:
                break
            cost, v, key = pop(at)
            vertex = vertex_at(at, v)
            slot = slot_of(vertex, key)
            if slot < 0 or load_float64(node_at(vertex, slot), COST) != cost:
                continue
            status = expand(at, cost, v, key, limit, K)
            if status != DONE:
                if status == PAIRS_FULL:
                    store_int64(at.pruned, 0, pruned)
                push(at, cost, v, key)
                return status
        return DONE

    @kernel
    def relax(graph, limit, K):  # type: ignore[no-untyped-def]
        """The same, asked with a graph."""
        return settle(places(graph), limit, K)

    @kernel
    def best_classes(graph, straight, heads, costs, turns, rows, weights, limit, out_cost, out_key, out_edge, out_slot):  # type: ignore[no-untyped-def] # fmt: skip
        """Algorithm 5: the cheapest way into each allowed class over candidate edges; number of classes found."""
        at, count = places(graph), 0
        pair_marker, pair_turn = turns.marker.ctypes.data, turns.turn.ctypes.data
        for i in range(heads.shape[0]):
            h, first, end = heads[i], turns.first[rows[i]], turns.first[rows[i] + 1]
            edge_key = key_of_pairs(turns.marker, turns.turn, first, end, weights)
            vertex = vertex_at(at, h)
            for slot in range(load_int32(vertex, COUNT)):
                node = node_at(vertex, slot)
                cost, key = costs[i] + load_float64(node, COST), load_int64(node, KEY) + edge_key
                place = -1
                for j in range(count):
                    if out_key[j] == key:
                        place = j
                        break
                if place < 0:
                    place = count
                    if count == out_cost.shape[0]:
                        place = 0
                        for j in range(1, count):
                            if out_cost[j] > out_cost[place]:
                                place = j
                        if cost >= out_cost[place]:
                            continue
                    marker, turn, many = joined(at, h, slot, pair_marker, pair_turn, first, end)
                    if not admits(straight.ctypes.data, at.M, marker, turn, many, limit):
                        continue
                    count = max(count, place + 1)
                elif cost >= out_cost[place]:
                    continue
                out_cost[place], out_key[place], out_edge[place], out_slot[place] = cost, key, i, slot
        return count

    @kernel
    def reaches(at, straight, heads, turns, rows, limit):  # type: ignore[no-untyped-def]
        """Whether an allowed class leads to the goal over any of the edges in `rows` to `heads`."""
        pair_marker, pair_turn = turns.marker.ctypes.data, turns.turn.ctypes.data
        for i in range(heads.shape[0]):
            first, end = turns.first[rows[i]], turns.first[rows[i] + 1]
            for slot in range(load_int32(vertex_at(at, heads[i]), COUNT)):
                marker, turn, many = joined(at, heads[i], slot, pair_marker, pair_turn, first, end)
                if admits(straight.ctypes.data, at.M, marker, turn, many, limit):
                    return True
        return False

    return Kernels(settle, relax, reaches, best_classes)
