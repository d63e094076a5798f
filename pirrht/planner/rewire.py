"""Algorithms 2 and 3 in kernels: nodes of a new vertex, the search over the queue, and the classes at a state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.arcs import FREE
from pirrht.jit.jit import (
    inlined,
    kernel,
    load_float64,
    load_int32,
    load_int64,
    store_int8,
    store_int64,
)
from pirrht.planner import graph as g
from pirrht.planner.graph import STATUS
from pirrht.planner.nodes import Candidate, admits, append, pop, propagated, push
from pirrht.topology.crossings import key_of_pairs


class Best(NamedTuple):
    """The best classes over candidate edges; rows beyond their number are empty."""

    cost: Array  # (c,) [cost]
    key: NDArray[np.int64]  # (c,) of the class
    edge: NDArray[np.int64]  # (c,) candidate
    slot: NDArray[np.int64]  # (c,) node at its head

    @classmethod
    def empty(cls, count: int) -> Best:
        """Allocate so many classes, (c,) each, at infinite cost."""
        return cls(np.full(count, np.inf), *np.zeros((3, count), np.int64))


@kernel
def _fill(at, v, rules):  # type: ignore[no-untyped-def]
    """Offer a vertex the nodes of all its successors (Algorithm 2, lines 2 to 8); what must grow first, or done."""
    vertex = g.vertex_at(at, v)
    if g.is_root(vertex):
        return STATUS.done
    evicted = -1
    while evicted != load_int64(at.size, g.SIZE.refill):  # an eviction moves nodes about: look until none happens
        evicted = load_int64(at.size, g.SIZE.refill)
        e = load_int32(vertex, g.FIRST_OUT)
        while e >= 0:
            edge = g.edge_at(at, e)
            h = load_int32(edge, g.HEAD)
            head, slot = g.vertex_at(at, h), 0
            while slot < load_int32(head, g.COUNT):
                node = g.node_at(head, slot)
                key = load_int64(node, g.KEY) + load_int64(edge, g.EDGE_KEY)
                cost = load_float64(node, g.COST) + load_float64(edge, g.EDGE_COST)
                status = append(at, v, Candidate(cost, key, np.int64(h), np.int64(slot), np.int64(e)), rules)
                if status != STATUS.done:
                    return status
                slot += 1
            e = load_int32(edge, g.NEXT_OUT)
    return STATUS.done


@inlined
def _expand(at, cost, v, key, rules):  # type: ignore[no-untyped-def]
    """Offer a node to all predecessors of its vertex (Algorithm 3, lines 11 to 16); what must grow first, or done."""
    vertex = g.vertex_at(at, v)
    e = load_int32(vertex, g.FIRST_IN)
    while e >= 0:
        edge = g.edge_at(at, e)
        u = load_int32(edge, g.TAIL)
        if not g.is_root(g.vertex_at(at, u)):
            new_key, new_cost = key + load_int64(edge, g.EDGE_KEY), cost + load_float64(edge, g.EDGE_COST)
            slot = g.slot_of(vertex, key)  # an eviction may have moved it
            status = append(at, u, Candidate(new_cost, new_key, np.int64(v), np.int64(slot), np.int64(e)), rules)
            if status != STATUS.done:
                return status
        e = load_int32(edge, g.NEXT_IN)
    return STATUS.done


@inlined
def relaxed(at, rules):  # type: ignore[no-untyped-def]
    """Search by uniform cost until no node improves (Algorithm 3, lines 8 to 17); what must grow first, or done."""
    while load_int64(at.size, g.SIZE.queue) > 0 or load_int64(at.size, g.SIZE.refill) > 0:
        pruned = load_int64(at.pruned, 0)
        while load_int64(at.size, g.SIZE.refill) > 0:
            last = load_int64(at.size, g.SIZE.refill) - 1
            v = load_int32(at.refill, last)
            status = _fill(at, v, rules)
            if status == STATUS.pairs_full:
                store_int64(at.pruned, 0, pruned)  # what was refused will be refused, and counted, again
            if status != STATUS.done:
                return status
            last = load_int64(at.size, g.SIZE.refill) - 1
            if load_int32(at.refill, last) == v:
                store_int64(at.size, g.SIZE.refill, last)
                store_int8(at.waiting, v, 0)
            pruned = load_int64(at.pruned, 0)
        if load_int64(at.size, g.SIZE.queue) == 0:
            break
        cost, v, key = pop(at)
        vertex = g.vertex_at(at, v)
        slot = g.slot_of(vertex, key)
        if slot < 0 or load_float64(g.node_at(vertex, slot), g.COST) != cost:
            continue
        status = _expand(at, cost, v, key, rules)
        if status != STATUS.done:
            if status == STATUS.pairs_full:
                store_int64(at.pruned, 0, pruned)
            push(at, cost, v, key)
            return status
    return STATUS.done


@kernel
def relax(at, rules):  # type: ignore[no-untyped-def]
    """Run `relaxed` from Python."""
    return relaxed(at, rules)


@kernel
def best_classes(at, straight, edges, weights, rules, best):  # type: ignore[no-untyped-def]
    """Algorithm 5: the cheapest way into each allowed class over k candidate `Edges`; number of classes found.

    `straight` (M,) [turns] is the state's, `weights` (M,) make the keys; `best` (c,) keeps the c cheapest, in no order.
    """
    count, near, turns = 0, edges.near, edges.turns
    pair_marker, pair_turn = np.int64(turns.marker.ctypes.data), np.int64(turns.turn.ctypes.data)
    for i in range(near.shape[0]):
        if edges.status[i] != FREE:
            continue
        h, first, end = near[i], turns.first[i], turns.first[i + 1]
        edge_key = key_of_pairs(turns.marker, turns.turn, first, end, weights)
        vertex = g.vertex_at(at, h)
        for slot in range(load_int32(vertex, g.COUNT)):
            node = g.node_at(vertex, slot)
            cost, key = edges.cost[i] + load_float64(node, g.COST), load_int64(node, g.KEY) + edge_key
            row = -1
            for j in range(count):
                if best.key[j] == key:
                    row = j
                    break
            if row < 0:
                row = count
                if count == best.cost.shape[0]:
                    row = 0
                    for j in range(1, count):
                        if best.cost[j] > best.cost[row]:
                            row = j
                    if cost >= best.cost[row]:
                        continue
                marker, turn, many = propagated(at, h, slot, pair_marker, pair_turn, first, end)
                if not admits(np.int64(straight.ctypes.data), at.M, marker, turn, many, rules):
                    continue
                count = max(count, row + 1)
            elif cost >= best.cost[row]:
                continue
            best.cost[row], best.key[row], best.edge[row], best.slot[row] = cost, key, i, slot
    return count


@kernel
def reaches(at, straight, edges, rules):  # type: ignore[no-untyped-def]
    """Return whether an allowed class leads over one of k `Edges` to the goal; the base has H `straight` (M,)."""
    near, turns = edges.near, edges.turns
    pair_marker, pair_turn = np.int64(turns.marker.ctypes.data), np.int64(turns.turn.ctypes.data)
    for i in range(near.shape[0]):
        if edges.status[i] != FREE:
            continue
        first, end = turns.first[i], turns.first[i + 1]
        for slot in range(load_int32(g.vertex_at(at, near[i]), g.COUNT)):
            marker, turn, many = propagated(at, near[i], slot, pair_marker, pair_turn, first, end)
            if admits(np.int64(straight.ctypes.data), at.M, marker, turn, many, rules):
                return True
    return False
