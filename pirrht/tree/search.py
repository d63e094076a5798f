"""Relaxation of the graph, a uniform-cost search over plain arrays, and the best classes at a state.

The paper's allowed set is |1 - H_i| <= H_limit for every obstacle; H comes without the 1 here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.addresses import (
    load_float64,
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
from pirrht.geometry.certify import FREE
from pirrht.topology.turns import key_of_pairs, summed
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
    slot_of,
    vertex_at,
)
from pirrht.tree.queue import pop, push
from pirrht.tree.status import DONE, NEW, NODES_FULL, PAIRS_FULL, QUEUE_FULL

TIE = 1e-12  # costs closer than this are equal: rounding must not make two nodes replace each other forever


class SearchRules(NamedTuple):
    """Which classes a tree keeps, and whether its edges lead both ways."""

    limit: float  # H_limit of the allowed set |1 - H_i| <= H_limit, asked at every vertex [turns]
    classes: int  # K: the most classes of a vertex, the cheapest; 0 keeps all
    mirrored: bool  # whether every edge may be driven the other way round at the same cost


class Offer(NamedTuple):
    """What an edge makes of a node for the vertex it leaves; numbers only."""

    cost: float
    key: int  # of the class
    source: int  # vertex and slot of the node
    slot: int
    edge: int


class Best(NamedTuple):
    """The best classes over candidate edges; rows beyond their number are empty."""

    cost: Array  # (c,)
    key: NDArray[np.int64]  # (c,)
    edge: NDArray[np.int64]  # (c,) candidate
    slot: NDArray[np.int64]  # (c,) node at its head

    @classmethod
    def room(cls, count: int) -> Best:
        """Room for so many."""
        return cls(np.full(count, np.inf), *np.zeros((3, count), np.int64))


@inlined
def _exceeds(at, v, offer, limit):  # type: ignore[no-untyped-def]
    """Whether a class breaks the limit around some marker that it turns around at v.

    Most classes are refused here, before anything is written down.
    """
    straight, begin = at.straight + 8 * at.M * v, (offer.source * at.K + offer.slot) * at.C
    first, end = load_int64(at.edge_first, offer.edge), load_int64(at.edge_first, offer.edge + 1)
    count = load_int32(node_at(vertex_at(at, offer.source), offer.slot), NODE_PAIR_COUNT)
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
def _joined(at, source, slot, edge_marker, edge_turn, first, end):  # type: ignore[no-untyped-def]
    """Pairs of node `slot` of vertex `source` and those of an edge, from `first` to `end` at two addresses, summed."""
    count, begin = load_int32(node_at(vertex_at(at, source), slot), NODE_PAIR_COUNT), (source * at.K + slot) * at.C
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
def _admits(straight, M, marker, turn, count, limit):  # type: ignore[no-untyped-def]
    """Whether a class is allowed where straight lines have the signature at an address (M,)."""
    if limit >= 0.5:  # a straight line turns at most half: only what turns more can break the limit
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


@kernel
def _insert(at, v, offer, rules):  # type: ignore[no-untyped-def]
    """The part of AppendNode that concerns a class which the vertex does not know: NEW, DONE or what must grow."""
    e = offer.edge
    marker, turn, many = _joined(
        at, offer.source, offer.slot, at.edge_marker, at.edge_turn, load_int64(at.edge_first, e),
        load_int64(at.edge_first, e + 1),
    )  # fmt: skip
    if not _admits(at.straight + 8 * at.M * v, at.M, marker, turn, many, rules.limit):
        return DONE
    vertex, K = vertex_at(at, v), rules.classes
    count = load_int32(vertex, COUNT)
    full, worst = K > 0 and count >= K, 0
    for i in range(1, count if full else 0):
        if load_float64(node_at(vertex, i), COST) > load_float64(node_at(vertex, worst), COST):
            worst = i
    if full and offer.cost >= load_float64(node_at(vertex, worst), COST) - TIE:
        store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
        return DONE
    if many > at.C:
        return PAIRS_FULL
    if full:
        store_int64(at.pruned, 0, load_int64(at.pruned, 0) + 1)
        evict(at, v, worst)
        count = load_int32(vertex, COUNT)
    node = node_at(vertex, count)
    store_float64(node, COST, offer.cost)
    store_int64(node, KEY, offer.key)
    store_int32(node, PARENT, e)
    store_int32(node, NODE_PAIR_COUNT, many)
    begin = (v * at.K + count) * at.C
    for k in range(many):
        store_int32(at.marker, begin + k, marker[k])
        store_int16(at.turn, begin + k, turn[k])
    store_int32(vertex, COUNT, count + 1)
    return NEW


@inlined
def _append(at, v, offer, rules):  # type: ignore[no-untyped-def]
    """AppendNode: give vertex v a node if it is new or cheaper, and queue it.

    What must grow first, or DONE, also if the node is dominated, blocked or pruned.
    """
    vertex = vertex_at(at, v)
    if rules.classes == 0 and load_int32(vertex, COUNT) >= at.K:
        return NODES_FULL
    if load_int64(at.size, QUEUE_COUNT) + 1 >= at.queue_room:
        return QUEUE_FULL
    known = slot_of(vertex, offer.key)
    if known >= 0:
        node = node_at(vertex, known)
        if offer.cost >= load_float64(node, COST) - TIE:
            return DONE
        store_float64(node, COST, offer.cost)
        store_int32(node, PARENT, offer.edge)
    else:
        if rules.limit >= 0.5 and _exceeds(at, v, offer, rules.limit):
            return DONE
        result = _insert(at, v, offer, rules)
        if result != NEW:
            return result
    push(at, offer.cost, v, offer.key)
    return DONE


@kernel
def _fill(at, v, rules):  # type: ignore[no-untyped-def]
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
                status = _append(at, v, Offer(cost, key, h, slot, e), rules)
                if status != DONE:
                    return status
                slot += 1
            e = load_int32(edge, NEXT_OUT)
    return DONE


@inlined
def _expand(at, cost, v, key, rules):  # type: ignore[no-untyped-def]
    """Offer a node to all predecessors of its vertex; what must grow first, or DONE."""
    vertex = vertex_at(at, v)
    e = load_int32(vertex, FIRST_IN)
    while e >= 0:
        edge = edge_at(at, e)
        u = load_int32(edge, TAIL)
        if not is_root(vertex_at(at, u)):
            new_key, new_cost = key + load_int64(edge, EDGE_KEY), cost + load_float64(edge, EDGE_COST)
            slot = slot_of(vertex, key)  # an eviction may have moved it
            status = _append(at, u, Offer(new_cost, new_key, v, slot, e), rules)
            if status != DONE:
                return status
        e = load_int32(edge, NEXT_IN)
    return DONE


@inlined
def settle(at, rules):  # type: ignore[no-untyped-def]
    """Rewire, lines 9-17: uniform-cost search until nothing improves; says what must grow if room runs out."""
    while load_int64(at.size, QUEUE_COUNT) > 0 or load_int64(at.size, REFILL_COUNT) > 0:
        pruned = load_int64(at.pruned, 0)
        while load_int64(at.size, REFILL_COUNT) > 0:
            last = load_int64(at.size, REFILL_COUNT) - 1
            v = load_int32(at.refill, last)
            status = _fill(at, v, rules)
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
        status = _expand(at, cost, v, key, rules)
        if status != DONE:
            if status == PAIRS_FULL:
                store_int64(at.pruned, 0, pruned)
            push(at, cost, v, key)
            return status
    return DONE


@kernel
def relax(at, rules):  # type: ignore[no-untyped-def]
    """The same, asked from Python."""
    return settle(at, rules)


@kernel
def best_classes(at, straight, edges, weights, rules, best):  # type: ignore[no-untyped-def]
    """Algorithm 5: the cheapest way into each allowed class over candidate edges; number of classes found."""
    count, near, turns = 0, edges.near, edges.turns
    pair_marker, pair_turn = turns.marker.ctypes.data, turns.turn.ctypes.data
    for i in range(near.shape[0]):
        if edges.status[i] != FREE:
            continue
        h, first, end = near[i], turns.first[i], turns.first[i + 1]
        edge_key = key_of_pairs(turns.marker, turns.turn, first, end, weights)
        vertex = vertex_at(at, h)
        for slot in range(load_int32(vertex, COUNT)):
            node = node_at(vertex, slot)
            cost, key = edges.cost[i] + load_float64(node, COST), load_int64(node, KEY) + edge_key
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
                marker, turn, many = _joined(at, h, slot, pair_marker, pair_turn, first, end)
                if not _admits(straight.ctypes.data, at.M, marker, turn, many, rules.limit):
                    continue
                count = max(count, row + 1)
            elif cost >= best.cost[row]:
                continue
            best.cost[row], best.key[row], best.edge[row], best.slot[row] = cost, key, i, slot
    return count


@kernel
def reaches(at, straight, edges, rules):  # type: ignore[no-untyped-def]
    """Whether an allowed class leads to the goal over any of the edges."""
    near, turns = edges.near, edges.turns
    pair_marker, pair_turn = turns.marker.ctypes.data, turns.turn.ctypes.data
    for i in range(near.shape[0]):
        if edges.status[i] != FREE:
            continue
        first, end = turns.first[i], turns.first[i + 1]
        for slot in range(load_int32(vertex_at(at, near[i]), COUNT)):
            marker, turn, many = _joined(at, near[i], slot, pair_marker, pair_turn, first, end)
            if _admits(straight.ctypes.data, at.M, marker, turn, many, rules.limit):
                return True
    return False
