"""Ways of one class over a tree in space and time that lie apart: shortened, they may end in different valleys.

To hurry past a body's end or to let it go by may both be of one class, and no way between the two be free. Of the two a
tree keeps the cheaper at every vertex; before they are shortened that need not be the one that is cheaper then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.certify import FREE
from pirrht.jit.addresses import load_float64, load_int32, load_int64
from pirrht.jit.copies import copy_row, copy_rows
from pirrht.jit.jit import inlined, kernel
from pirrht.planner import graph as g
from pirrht.steering.along_legs import Legs
from pirrht.topology.crossings import key_of_pairs

STATIONS = 16  # times at which ways are compared, from now until the cheapest one arrives


@inlined
def _over(at, edges, i, weights, key):  # type: ignore[no-untyped-def]
    """Cost and slot of the cheapest way into a class over a candidate edge; infinite if there is none."""
    if edges.status[i] != FREE:
        return np.inf, -1
    turns = edges.turns
    wanted = key - key_of_pairs(turns.marker, turns.turn, turns.first[i], turns.first[i + 1], weights)
    vertex = g.vertex_at(at, edges.near[i])
    slot = g.slot_of(vertex, wanted)
    return (np.inf, -1) if slot < 0 else (edges.cost[i] + load_float64(g.node_at(vertex, slot), g.COST), slot)


@kernel
def _follow(at, states, pace, x, vertex, slot, times, places):  # type: ignore[no-untyped-def]
    """Where the way from x (3,) over a node is at times (T,), into places (T, 2); the time at which it arrives.

    It waits where it arrives. The last leg, into a state without a time, is gone at a pace [m/s].
    """
    key = load_int64(g.node_at(g.vertex_at(at, vertex), slot), g.KEY)
    ax, ay, s, k, T = x[0], x[1], x[2], 0, times.shape[0]
    while True:
        bx, by, t = states[vertex, 0], states[vertex, 1], states[vertex, 2]
        if math.isnan(t):
            t = s + math.hypot(bx - ax, by - ay) / pace
        while k < T and times[k] <= t:
            share = (times[k] - s) / max(t - s, 1e-300)
            places[k, 0], places[k, 1] = ax + share * (bx - ax), ay + share * (by - ay)
            k += 1
        ax, ay, s = bx, by, t
        node = g.node_at(g.vertex_at(at, vertex), g.slot_of(g.vertex_at(at, vertex), key))
        e = load_int32(node, g.PARENT)
        if e == g.ROOT:
            break
        edge = g.edge_at(at, e)
        key -= load_int64(edge, g.EDGE_KEY)
        vertex = np.int64(load_int32(edge, g.HEAD))
    while k < T:
        places[k, 0], places[k, 1] = ax, ay
        k += 1
    return s


@kernel
def choose(at, states, edges, weights, key, x, pace, rules, chosen):  # type: ignore[no-untyped-def]
    """Choose ways of a class from x (3,) over k `Edges`: each apart from all that are cheaper; how many there are.

    Args:
        key: of the class.
        pace: at which one arrives [m/s].
        rules: how far apart at some time at least [m], and how much dearer than the cheapest at most, as a share.
        chosen: (c, 2) edges and slots, cheapest first; filled up to the number that is returned.
    """
    k, (far, dearer) = edges.near.shape[0], rules
    cost, slot = np.empty(k), np.empty(k, np.int64)
    for i in range(k):
        cost[i], slot[i] = _over(at, edges, i, weights, key)
    order = np.argsort(cost, kind="mergesort")
    count, most = 0, chosen.shape[0]
    times, places, here = np.zeros(STATIONS), np.empty((most, STATIONS, 2)), np.empty((STATIONS, 2))
    for i in order:
        if count == most or not cost[i] <= (1.0 + dearer) * cost[order[0]]:
            break
        if count == 0:
            end = _follow(at, states, pace, x, np.int64(edges.near[i]), slot[i], times[:0], here)
            copy_row(np.linspace(x[2], end, STATIONS), times)
        _follow(at, states, pace, x, np.int64(edges.near[i]), slot[i], times, here)
        new = True
        for j in range(count):
            widest = 0.0
            for p in range(STATIONS):
                widest = max(widest, math.hypot(here[p, 0] - places[j, p, 0], here[p, 1] - places[j, p, 1]))
            new = new and widest > far
        if new:
            copy_rows(here, places[count])
            chosen[count, 0], chosen[count, 1] = i, slot[i]
            count += 1
    return count


def apart_of(ways: Sequence[Legs], far: float) -> tuple[Legs, ...]:
    """Of ways from one place and time, those that at some time lie so far [m] from the first and from each other."""
    times = np.linspace(ways[0].knots[0, 2], ways[0].knots[-1, 2], STATIONS)
    kept: list[tuple[Legs, Array]] = []
    for way in ways:
        places = way.places(times)
        if all(np.hypot(*(places - other).T).max() > far for _, other in kept):
            kept.append((way, places))
    return tuple(way for way, _ in kept[1:])
