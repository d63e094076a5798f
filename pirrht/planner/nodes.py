"""Nodes of the H-augmented space: which classes a vertex keeps (AppendNode of the paper's Algorithms 2 and 3).

The paper's allowed set is |1 - H_i| <= H_limit for every obstacle; H comes without the 1 here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
)
from pirrht.planner import graph as g
from pirrht.planner.graph import STATUS
from pirrht.planner.tuning import TUNING
from pirrht.topology.crossings import summed


class SearchRules(NamedTuple):
    """Rules of the search: classes that a tree keeps, and edges that lead both ways."""

    limit: float  # H_limit of the allowed set |1 - H_i| <= H_limit, asked at every vertex [turns]
    classes: int  # K: the most classes of a vertex, the cheapest; 0 keeps all
    bases_allowed: bool  # whether no base breaks the limit: then only obstacles that a class turns around can
    mirrored: bool  # whether every edge may be driven the other way round at the same cost


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
    node, end = g.node_at(vertex, slot), g.node_at(vertex, last)
    for i in range(g.NODE_BYTES // 8):
        store_int64(node, i, load_int64(end, i))
    to, start = (v * at.K + slot) * at.C, (v * at.K + last) * at.C
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
def _exceeds(at, v, offer, limit):  # type: ignore[no-untyped-def]
    """Return whether a class breaks the limit around some marker that it turns around at v.

    Most classes are refused here, before anything is written down.
    """
    straight, begin = at.straight + 8 * at.M * v, (offer.source * at.K + offer.slot) * at.C
    first, end = load_int64(at.edge_first, offer.edge), load_int64(at.edge_first, offer.edge + 1)
    count = load_int32(g.node_at(g.vertex_at(at, offer.source), offer.slot), g.NODE_PAIR_COUNT)
    for i in range(begin, begin + count):
        marker, total = load_int32(at.marker, i), np.int64(load_int16(at.turn, i))
        for j in range(first, end):
            if load_int32(at.edge_marker, j) == marker:
                total += load_int16(at.edge_turn, j)
        if total != 0 and abs(load_float64(straight, marker) + total) > limit:
            return True
    for j in range(first, end):
        marker, known = load_int32(at.edge_marker, j), False
        for i in range(begin, begin + count):
            known |= load_int32(at.marker, i) == marker
        if not known and abs(load_float64(straight, marker) + load_int16(at.edge_turn, j)) > limit:
            return True
    return False


@kernel
def propagated(at, source, slot, edge_marker, edge_turn, first, end):  # type: ignore[no-untyped-def]
    """Pairs of node `slot` of vertex `source` and those of an edge, from `first` to `end` at two addresses, summed."""
    begin = (source * at.K + slot) * at.C
    count = load_int32(g.node_at(g.vertex_at(at, source), slot), g.NODE_PAIR_COUNT)
    most = count + end - first
    marker, turn = np.empty(most, np.int32), np.empty(most, np.int16)
    total = np.zeros(at.M, np.int16)
    for i in range(count):
        marker[i], turn[i] = load_int32(at.marker, begin + i), load_int16(at.turn, begin + i)
    for i in range(first, end):
        marker[count], turn[count] = load_int32(edge_marker, i), load_int16(edge_turn, i)
        count += 1
    return marker, turn, summed(total, marker, turn, 0, count)


@kernel
def admits(straight, M, marker, turn, count, rules):  # type: ignore[no-untyped-def]
    """Return whether a class is allowed where bases have the signature at an address (M,)."""
    limit = rules.limit
    if rules.bases_allowed:
        for i in range(count):  # noqa: SIM110
            if abs(load_float64(straight, marker[i]) + turn[i]) > limit:
                return False
        return True
    whole = np.zeros(M, np.int64)
    for i in range(count):
        whole[marker[i]] += turn[i]
    for k in range(M):  # noqa: SIM110
        if abs(load_float64(straight, k) + whole[k]) > limit:
            return False
    return True


@inlined
def _costliest(vertex, count):  # type: ignore[no-untyped-def]
    """Slot of the costliest of so many nodes, at least one, of the vertex at an address."""
    worst = 0
    for i in range(1, count):
        if load_float64(g.node_at(vertex, i), g.COST) > load_float64(g.node_at(vertex, worst), g.COST):
            worst = i
    return worst


@inlined
def _is_outdone(at, v, offer, rules):  # type: ignore[no-untyped-def]
    """Return whether a vertex has K classes of no higher cost; counts it."""
    vertex, K = g.vertex_at(at, v), rules.classes
    count = load_int32(vertex, g.COUNT)
    if K == 0 or count < K:
        return False
    outdone = offer.cost >= load_float64(g.node_at(vertex, _costliest(vertex, count)), g.COST) - TUNING.cost_tie
    if outdone:
        store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
    return outdone


@kernel
def _insert(at, v, offer, rules):  # type: ignore[no-untyped-def]
    """Append a node of a class that the vertex does not know: new, done (refused), or what must grow first."""
    e = offer.edge
    marker, turn, many = propagated(
        at, offer.source, offer.slot, at.edge_marker, at.edge_turn, load_int64(at.edge_first, e),
        load_int64(at.edge_first, e + 1),
    )  # fmt: skip
    if not rules.bases_allowed:  # `append` has not asked
        if not admits(at.straight + 8 * at.M * v, at.M, marker, turn, many, rules):
            return STATUS.done
        if _is_outdone(at, v, offer, rules):
            return STATUS.done
    if many > at.C:
        return STATUS.pairs_full
    vertex, K = g.vertex_at(at, v), rules.classes
    count = load_int32(vertex, g.COUNT)
    if K > 0 and count >= K:
        store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
        _evict(at, v, _costliest(vertex, count))
        count = load_int32(vertex, g.COUNT)
    node = g.node_at(vertex, count)
    store_float64(node, g.COST, offer.cost)
    store_int64(node, g.KEY, offer.key)
    store_int32(node, g.PARENT, e)
    store_int32(node, g.NODE_PAIR_COUNT, many)
    begin = (v * at.K + count) * at.C
    for k in range(many):
        store_int32(at.marker, begin + k, marker[k])
        store_int16(at.turn, begin + k, turn[k])
    store_int32(vertex, g.COUNT, count + 1)
    return STATUS.new


@inlined
def push(at, cost, vertex, key):  # type: ignore[no-untyped-def]
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
def pop(at):  # type: ignore[no-untyped-def]
    """Take the cheapest node out of a queue that has one: cost [cost], vertex, key of its class."""
    cost, vertex, key = load_float64(at.queue_cost, 0), load_int32(at.queue_vertex, 0), load_int64(at.queue_key, 0)
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
    """AppendNode: give vertex v a node if it is new or cheaper, and queue it.

    Returns what must grow first, or done, also if the node is dominated, blocked or pruned.
    """
    vertex = g.vertex_at(at, v)
    if rules.classes == 0 and load_int32(vertex, g.COUNT) >= at.K:
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
        if rules.bases_allowed and (_exceeds(at, v, offer, rules.limit) or _is_outdone(at, v, offer, rules)):
            return STATUS.done
        result = _insert(at, v, offer, rules)
        if result != STATUS.new:
            return result
    push(at, offer.cost, v, offer.key)
    return STATUS.done
