"""States become vertices of the graph, their edges, classes and the propagation of these in compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.certify import BLOCKED, FREE, certify_point
from pirrht.steering.steering import Compiled
from pirrht.topology.cuts import straight_turns
from pirrht.topology.turns import Turns
from pirrht.tree.edges import judge
from pirrht.tree.graph import add_edge, ask_again
from pirrht.tree.layout import places
from pirrht.tree.search import DONE, Kernels

REJECTED = -1  # no allowed class reaches the goal from the state
ASK = -2  # what comes next takes FCL, a root or more room


class Surroundings(NamedTuple):
    """What growth knows of a scene."""

    field: Any
    cuts: Any
    markers: Any  # (M, 2) [m]
    goal: Any  # (2,) [m]
    goal_radius: float  # [m]


@cache
def attach_with(kernels: Kernels) -> Callable[..., int]:
    """The kernel for one allowed set (compiled once, cached on disk for the default)."""
    reaches, settle = kernels.reaches, kernels.settle

    @kernel
    def attach(graph, straight, near, near_in_goal, edges, weights, limit, K, mirrored):  # type: ignore[no-untyped-def]
        """Add a vertex that has the edges (free, cost, turns) to those `near`; there must be room.

        With `mirrored` the same edges lead back, and all costs are settled.
        Returns REJECTED, DONE, or what must grow before costs can be settled.
        """
        at = places(graph)
        free, costs, turns = edges
        rows = np.flatnonzero(free)
        heads, cost = near[rows], costs[rows]
        if not reaches(at, straight, heads, turns, rows, limit):
            return REJECTED
        v = graph.size[0]
        graph.straight[v] = straight
        graph.size[0] = v + 1
        for i in range(rows.shape[0]):
            add_edge(at, v, heads[i], cost[i], turns, rows[i], 1, weights)
        ask_again(at, v)
        if not mirrored:
            return DONE
        for i in range(rows.shape[0]):
            if not near_in_goal[rows[i]]:
                add_edge(at, heads[i], v, cost[i], turns, rows[i], -1, weights)
        return settle(at, limit, K)

    attach_kernel: Callable[..., int] = attach
    return attach_kernel


@cache
def grow_with(kernels: Kernels, steering: Compiled) -> Callable[..., tuple[int, int]]:
    """The kernel that turns draws into vertices by one steering method."""
    nearest, connect, P = steering
    reaches, settle = kernels.reaches, kernels.settle

    @inlined
    def proposed(space, states, size, x, in_goal, radius, price, forward):  # type: ignore[no-untyped-def]
        """Edges between x and the vertices near it: those, whether they are roots, free, cost, turns, number unsure."""
        n = states.shape[1]
        count = min(math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1)), size)
        near = np.empty(count, np.int64)
        nearest(states[:size], x, radius, forward, near, np.empty(count))
        others, here = states[near], np.empty((count, n))
        here[:] = x
        into_goal = in_goal[near]
        if not forward:
            into_goal[:] = False
        tails, heads = (here, others) if forward else (others, here)
        start, curvature, length = np.empty((count, 3)), np.empty((count, P)), np.empty((count, P))
        connect(tails, heads, radius, start, curvature, length)
        status, first = np.empty(count, np.int8), np.empty(count + 1, np.int64)
        full, cost = np.empty(count), np.empty(count)
        for i in range(count):
            full[i] = price * length[i].sum()
        marker, turn, unsure = judge(
            space.field, start, curvature, length, full, heads, into_goal, space.cuts, space.goal, space.goal_radius,
            status, first, np.empty((count, P)), cost,
        )  # fmt: skip
        return near, status, cost, Turns(first, marker, turn), unsure

    @kernel
    def grow(graph, states, in_goal, space, draws, i, radius, price, weights, limit, K, mirrored):  # type: ignore[no-untyped-def] # fmt: skip
        """Make vertices of the draws from i on: how many have been dealt with, and DONE, ASK or what must grow."""
        at = places(graph)
        straight = np.empty(at.M)
        while i < draws.shape[0]:
            x, v = draws[i], graph.size[0]
            status = certify_point(space.field, x[0], x[1])
            if status == BLOCKED:
                i += 1
                continue
            if (
                status != FREE
                or v >= states.shape[0]
                or math.hypot(x[0] - space.goal[0], x[1] - space.goal[1]) <= 1.001 * space.goal_radius
            ):
                return i, ASK
            near, free, cost, turns, unsure = proposed(space, states, v, x, in_goal, radius, price, True)
            rows = np.flatnonzero(free == FREE)
            edges, pairs = 2 * len(near), 2 * len(turns.marker)
            if unsure > 0:
                return i, ASK
            for k in range(at.M):
                straight[k] = straight_turns(
                    x[0], x[1], space.markers[k, 0], space.markers[k, 1], space.goal[0], space.goal[1]
                )
            heads, there = near[rows], rows
            if not reaches(at, straight, heads, turns, rows, limit):
                i += 1
                continue
            states[v], in_goal[v] = x, False
            back = turns
            tails, price_back = heads, cost
            if not mirrored:
                near, free, price_back, back, unsure = proposed(space, states, v + 1, x, in_goal, radius, price, False)
                if unsure > 0:
                    return i, ASK
                there = np.flatnonzero(free == FREE)
                tails, pairs = near[there], pairs + len(back.marker)
                edges += len(near)
            if graph.size[1] + edges > graph.tail.shape[0] or graph.size[4] + pairs > graph.edge_marker.shape[0]:
                return i, ASK
            graph.straight[v] = straight
            graph.size[0] = v + 1
            for j in range(rows.shape[0]):
                add_edge(at, v, heads[j], cost[rows[j]], turns, rows[j], 1, weights)
            ask_again(at, v)
            for j in range(there.shape[0]):
                if tails[j] != v and not in_goal[tails[j]]:
                    add_edge(at, tails[j], v, price_back[there[j]], back, there[j], -1 if mirrored else 1, weights)
            i += 1
            status = settle(at, limit, K)
            if status != DONE:
                return i, status
        return i, DONE

    grow_kernel: Callable[..., tuple[int, int]] = grow
    return grow_kernel
