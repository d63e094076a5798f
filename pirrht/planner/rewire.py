"""Algorithms 2 and 3 in kernels: classes that a vertex keeps (AppendNode), and the search over the queue.

The paper's allowed set is |1 - H_i| <= H_limit for every obstacle; H comes without the 1 here.
"""

from typing import NamedTuple

import numpy as np

from pirrht.geometry.space import FREE
from pirrht.jit.jit import (
    inlined,
    kernel,
    load_float64,
    load_int8,
    load_int16,
    load_int32,
    load_int64,
    store_float64,
    store_int8,
    store_int16,
    store_int32,
    store_int64,
)  # fmt: skip
from pirrht.planner import graph as g
from pirrht.planner.graph import STATUS
from pirrht.planner.tuning import TUNING
from pirrht.topology.pairs import summed


class SearchRules(NamedTuple):
    """Rules of the search: classes that a tree keeps, and edges that lead both ways."""

    limit: float  # H_limit of the allowed set |1 - H_i| <= H_limit, asked at every vertex [turns]
    classes: int  # K: the most classes of a vertex, the cheapest; 0 keeps all
    bases_allowed: bool  # whether no base breaks the limit: then only obstacles that a class turns around can
    mirrored: bool  # whether every edge may be driven the other way round at the same cost
    asks: bool  # whether FCL judges what certificates cannot tell; else that is not free


class Candidate(NamedTuple):
    """Node that an edge propagates to the vertex that it leaves (Propagate); numbers of 64 bits."""

    cost: float  # [cost]
    key: int  # of the class
    source: int | np.int64  # vertex and slot of the node
    slot: int | np.int64
    edge: int | np.int64


@inlined
def ask_again(at, v):  # type: ignore[no-untyped-def]
    """Note, in `refill` and `waiting` (V,), that vertex v must ask its successors for their nodes."""
    if load_int8(at.waiting, v) == 0:
        count = load_int64(at.size, g.SIZE.refill)
        store_int8(at.waiting, v, 1)
        store_int32(at.refill, count, v)
        store_int64(at.size, g.SIZE.refill, count + 1)


@kernel
def _remove(at, v, slot):  # type: ignore[no-untyped-def]
    vertex = g.vertex_at(at, v)
    last = load_int32(vertex, g.COUNT) - 1
    node = g.node_at(vertex, slot)
    end = g.node_at(vertex, last)

    for i in range(g.NODE_BYTES // 8):
        store_int64(node, i, load_int64(end, i))
    to = (v * at.K + slot) * at.C
    start = (v * at.K + last) * at.C

    for k in range(load_int32(end, g.NODE_PAIR_COUNT)):
        store_int32(at.marker, to + k, load_int32(at.marker, start + k))
        store_int16(at.turn, to + k, load_int16(at.turn, start + k))
    store_int32(vertex, g.COUNT, last)


@kernel
def _evict(at, v, slot):  # type: ignore[no-untyped-def]
    """Drop a node and every node that descends from it; their vertices will ask their successors again."""
    stack = [(np.int64(v), load_int64(g.node_at(g.vertex_at(at, v), slot), g.KEY))]
    _remove(at, v, slot)
    while len(stack) > 0:
        v, key = stack.pop()
        e = load_int32(g.vertex_at(at, v), g.FIRST_IN)
        while e >= 0:
            edge = g.edge_at(at, e)
            u = np.int64(load_int32(edge, g.TAIL))
            vertex = g.vertex_at(at, u)
            child = g.slot_of(vertex, key + load_int64(edge, g.EDGE_KEY))
            if child >= 0 and load_int32(g.node_at(vertex, child), g.PARENT) == e:
                stack.append((u, load_int64(g.node_at(vertex, child), g.KEY)))
                _remove(at, u, child)
                ask_again(at, u)
            e = load_int32(edge, g.NEXT_IN)


@inlined
def _turns_about(k, marker, turn, first, end):  # type: ignore[no-untyped-def]
    """Sum the turns about obstacle k of the pairs from `first` to `end` at two addresses."""
    total = np.int64(0)
    for i in range(first, end):
        if load_int32(marker, i) == k:
            total += load_int16(turn, i)
    return total


@kernel
def admits(at, straight, source, slot, edge, rules):  # type: ignore[no-untyped-def]
    """Return whether the class of an edge and node `slot` of vertex `source` is allowed; nothing is written down.

    `edge` are two addresses of pairs, the first one and the end; `straight` is the address of H of the base (M,).
    """
    limit, (marker, turn, first, end), begin = rules.limit, edge, (source * at.K + slot) * at.C
    stop = begin + load_int32(g.node_at(g.vertex_at(at, source), slot), g.NODE_PAIR_COUNT)
    for i in range(begin, stop):
        k = load_int32(at.marker, i)
        total = load_int16(at.turn, i) + _turns_about(k, marker, turn, first, end)
        if abs(load_float64(straight, k) + total) > limit:
            return False
    for i in range(first, end):
        k = load_int32(marker, i)
        total = load_int16(turn, i) + _turns_about(k, at.marker, at.turn, begin, stop)
        if abs(load_float64(straight, k) + total) > limit:
            return False
    if not rules.bases_allowed:
        for k in range(at.M):
            total = _turns_about(k, marker, turn, first, end) + _turns_about(k, at.marker, at.turn, begin, stop)
            if abs(load_float64(straight, k) + total) > limit:
                return False
    return True


@kernel
def _insert(at, v, offer, worst):  # type: ignore[no-untyped-def]
    """Append a node of a class that the vertex does not know, in place of its `worst` if that is one; done, or full."""
    begin = (offer.source * at.K + offer.slot) * at.C
    e = offer.edge
    first = load_int64(at.edge_first, e)
    end = load_int64(at.edge_first, e + 1)
    count = load_int32(g.node_at(g.vertex_at(at, offer.source), offer.slot), g.NODE_PAIR_COUNT)
    marker = np.empty(count + end - first, np.int32)
    turn = np.empty(count + end - first, np.int16)

    for i in range(count):
        marker[i] = load_int32(at.marker, begin + i)
        turn[i] = load_int16(at.turn, begin + i)
    for i in range(first, end):
        marker[count] = load_int32(at.edge_marker, i)
        turn[count] = load_int16(at.edge_turn, i)
        count += 1
    many = summed(np.zeros(at.M, np.int16), marker, turn, 0, count)
    if many > at.C:
        return STATUS.pairs_full
    if worst >= 0:
        store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
        _evict(at, v, worst)
    vertex = g.vertex_at(at, v)
    slot = load_int32(vertex, g.COUNT)
    node = g.node_at(vertex, slot)
    begin = (v * at.K + slot) * at.C
    store_float64(node, g.COST, offer.cost)
    store_int64(node, g.KEY, offer.key)
    store_int32(node, g.PARENT, e)
    store_int32(node, g.NODE_PAIR_COUNT, many)
    for k in range(many):
        store_int32(at.marker, begin + k, marker[k])
        store_int16(at.turn, begin + k, turn[k])
    store_int32(vertex, g.COUNT, slot + 1)
    return STATUS.done


@inlined
def _push(at, cost, vertex, key):  # type: ignore[no-untyped-def]
    """Add a node that is to be propagated by its cost [cost], vertex and key of its class; there must be room."""
    i = load_int64(at.size, g.SIZE.queue)
    store_int64(at.size, g.SIZE.queue, i + 1)
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
def _pop(at):  # type: ignore[no-untyped-def]
    """Take the cheapest node out of a queue that has one: cost [cost], vertex, key of its class."""
    cost = load_float64(at.queue_cost, 0)
    vertex = load_int32(at.queue_vertex, 0)
    key = load_int64(at.queue_key, 0)

    last = load_int64(at.size, g.SIZE.queue) - 1
    store_int64(at.size, g.SIZE.queue, last)
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


@inlined
def append(at, v, offer, rules):  # type: ignore[no-untyped-def]
    """AppendNode: give vertex v a node if it is new or cheaper, and queue it; return what must grow first, or done."""
    vertex = g.vertex_at(at, v)
    count = load_int32(vertex, g.COUNT)
    if rules.classes == 0 and count >= at.K:
        return STATUS.nodes_full
    if load_int64(at.size, g.SIZE.queue) + 1 >= at.queue_room:
        return STATUS.queue_full
    known = g.slot_of(vertex, offer.key)
    if known >= 0:
        node = g.node_at(vertex, known)
        if offer.cost >= load_float64(node, g.COST) - TUNING.cost_tie:
            return STATUS.done
        store_float64(node, g.COST, offer.cost)
        store_int32(node, g.PARENT, offer.edge)
    else:
        e, worst = offer.edge, -1
        edge = at.edge_marker, at.edge_turn, load_int64(at.edge_first, e), load_int64(at.edge_first, e + 1)
        if not admits(at, at.straight + 8 * at.M * v, offer.source, offer.slot, edge, rules):
            return STATUS.done
        if 0 < rules.classes <= count:
            worst = 0
            for i in range(1, count):
                if load_float64(g.node_at(vertex, i), g.COST) > load_float64(g.node_at(vertex, worst), g.COST):
                    worst = i
            if offer.cost >= load_float64(g.node_at(vertex, worst), g.COST) - TUNING.cost_tie:
                store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
                return STATUS.done
        status = _insert(at, v, offer, worst)
        if status != STATUS.done:
            return status
    _push(at, offer.cost, v, offer.key)
    return STATUS.done


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
            new_key = key + load_int64(edge, g.EDGE_KEY)
            new_cost = cost + load_float64(edge, g.EDGE_COST)
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
            v = load_int32(at.refill, load_int64(at.size, g.SIZE.refill) - 1)
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
        cost, v, key = _pop(at)
        vertex = g.vertex_at(at, v)
        slot = g.slot_of(vertex, key)
        if slot < 0 or load_float64(g.node_at(vertex, slot), g.COST) != cost:
            continue
        status = _expand(at, cost, v, key, rules)
        if status != STATUS.done:
            if status == STATUS.pairs_full:
                store_int64(at.pruned, 0, pruned)
            _push(at, cost, v, key)
            return status
    return STATUS.done


@kernel
def relax(at, rules):  # type: ignore[no-untyped-def]
    """Run `relaxed` from Python."""
    return relaxed(at, rules)


@kernel
def reaches(at, straight, edges, rules):  # type: ignore[no-untyped-def]
    """Return whether an allowed class leads over one of k `Edges` to the goal; the base has H `straight` (M,)."""
    near, turns, base = edges.near, edges.turns, np.int64(straight.ctypes.data)
    marker = np.int64(turns.marker.ctypes.data)
    turn = np.int64(turns.turn.ctypes.data)

    for i in range(near.shape[0]):
        if edges.status[i] == FREE:
            pairs = marker, turn, turns.first[i], turns.first[i + 1]
            for slot in range(load_int32(g.vertex_at(at, near[i]), g.COUNT)):
                if admits(at, base, near[i], slot, pairs, rules):
                    return True
    return False
