"""Algorithm 1: states become vertices of the graph with their edges, in compiled code as far as it can decide."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.space import BLOCKED, FREE
from pirrht.jit.jit import (
    as_tuple,
    caller,
    kernel,
    load_int32,
    load_int64,
    part,
    store_float64,
    store_int16,
    store_int32,
    store_int64,
)  # fmt: skip
from pirrht.jit.vectors import copy_row
from pirrht.planner import graph as g
from pirrht.planner.graph import STATUS
from pirrht.planner.rewire import ask_again, reaches, relaxed
from pirrht.planner.tuning import TUNING
from pirrht.steering.edges import NO_EDGES, Edges, judge_with
from pirrht.steering.motion import MotionKernels
from pirrht.topology.signature import SignatureKernels


class PassageSampler:
    """Offers states (k, n) in passages until they are vertices, between uniform draws; `waiting` has them as bytes.

    The number of a draw and the vertices decide what is offered: a tree that is grown in several steps, or read from a
    file in between, is the tree that is grown at once. At least every second draw is uniform, so paths converge.
    """

    def __init__(self, states: Array) -> None:
        self.states, self.waiting, self._seen = states, {state.tobytes() for state in states}, 0
        self._period = max(TUNING.offer_period, 2 * len(states))

    def note(self, states: Array) -> None:
        """Take the states (V, n) of all vertices from the list of those that are waited for."""
        if self.waiting:
            self.waiting.difference_update(state.tobytes() for state in states[self._seen :])
        self._seen = len(states)

    def at(self, draw: int) -> Array | None:
        """The state (n,) that is offered as a draw of some number; None: this draw is uniform."""
        place, uniform = divmod(draw % self._period, 2)
        if uniform or place >= len(self.states):
            return None
        offered: Array = self.states[place]
        return offered if offered.tobytes() in self.waiting else None

    def together(self, draw: int) -> int:
        """Number of draws from this one on that need no `note` in between: none of them is offered twice."""
        return self._period - draw % self._period if self.waiting else TUNING.batch


@kernel
def near_count(size, n):  # type: ignore[no-untyped-def]
    """The RRG's k = e (1 + 1/n) log |V|, rounded up, for `size` vertices and the new one (section IV-B)."""
    return math.ceil(math.e * (1.0 + 1.0 / n) * math.log(size + 1))


@part
def _link(at, e):  # type: ignore[no-untyped-def]
    """Put edge e at the head of the lists of both of its vertices."""
    edge = g.edge_at(at, e)
    first_out = g.vertex_at(at, load_int32(edge, g.TAIL))
    first_in = g.vertex_at(at, load_int32(edge, g.HEAD))
    store_int32(edge, g.NEXT_OUT, load_int32(first_out, g.FIRST_OUT))
    store_int32(edge, g.NEXT_IN, load_int32(first_in, g.FIRST_IN))
    store_int32(first_out, g.FIRST_OUT, e)
    store_int32(first_in, g.FIRST_IN, e)


@part
def _add_edge(at, tail, head, edges, i, sign, weights):  # type: ignore[no-untyped-def]
    """Append a directed edge and link it into both of its lists.

    It costs what edge i of `edges` does and has `sign` times its turns; `weights` (M,) make the additive key.
    """
    e = load_int64(at.size, g.SIZE.edges)
    used = load_int64(at.size, g.SIZE.pairs)
    key = np.int64(0)

    turns = edges.turns
    for j in range(turns.first[i], turns.first[i + 1]):
        marker = turns.marker[j]
        turn = sign * turns.turn[j]
        store_int32(at.edge_marker, used, marker)
        store_int16(at.edge_turn, used, turn)
        key += turn * weights[marker]
        used += 1
    edge = g.edge_at(at, e)
    store_int32(edge, g.TAIL, tail)
    store_int32(edge, g.HEAD, head)
    store_float64(edge, g.EDGE_COST, edges.cost[i])
    store_int64(edge, g.EDGE_KEY, key)
    _link(at, e)
    store_int64(at.edge_first, e + 1, used)
    store_int64(at.size, g.SIZE.edges, e + 1)
    store_int64(at.size, g.SIZE.pairs, used)


@kernel
def insert(at, vertices, straight, out, back, around, rules):  # type: ignore[no-untyped-def]
    """Make the state that stands at the end of `vertices` a vertex: edges leave it, and where it is no root enter it.

    `straight` (M,) [turns] is the H of the straight line from it; `out` and `back` are `Edges` to and from vertices
    near it, and with `rules.mirrored` the same but for a root. There must be room. Costs settle later.
    """
    v = load_int64(at.size, g.SIZE.vertices)
    root, sign = vertices.in_goal[v], 1
    for k in range(at.M):
        store_float64(at.straight, v * at.M + k, straight[k])
    store_int64(at.size, g.SIZE.vertices, v + 1)
    if root:
        store_int32(g.vertex_at(at, v), g.COUNT, 1)
    else:
        for i in range(out.near.shape[0]):
            if out.status[i] == FREE:
                _add_edge(at, v, out.near[i], out, i, 1, around.weights)
        ask_again(at, v)
        sign = -1 if rules.mirrored else 1
    for i in range(back.near.shape[0]):
        u = back.near[i]
        if back.status[i] == FREE and u != v and not vertices.in_goal[u]:
            _add_edge(at, u, v, back, i, sign, around.weights)
            if root:
                ask_again(at, u)


@kernel
def restore(at, in_goal):  # type: ignore[no-untyped-def]
    """Link all edges, and give nodes to the roots, where `in_goal` (V,); costs settle later."""
    for v in range(load_int64(at.size, g.SIZE.vertices)):
        store_int32(g.vertex_at(at, v), g.COUNT, np.int32(in_goal[v]))
    for e in range(load_int64(at.size, g.SIZE.edges)):
        _link(at, e)
        edge = g.edge_at(at, e)
        if in_goal[load_int32(edge, g.HEAD)]:
            ask_again(at, load_int32(edge, g.TAIL))


_propose = caller((NO_EDGES, 0))


@cache
def proposer(
    nearest: Callable[..., None],
    connect: Callable[..., Any],
    count: int,
    motion: MotionKernels,
    classes: SignatureKernels,
) -> Callable[..., tuple[Edges, int]]:
    """Make what `grow` calls of a `CompiledSteering` (`nearest_with`, optimum, `count` numbers) and its kernels."""
    judge = judge_with(motion)
    base = classes.base

    def propose(vertices, size, x, around, values, forward, root, straight):  # type: ignore[no-untyped-def]
        """Propose `Edges` between x (n,), which may be a root, and vertices near it; count those that are unsure.

        Writes H of the straight line from x to `straight` (M,).
        """
        n = vertices.states.shape[1]
        numbers = as_tuple(values, count)
        near = np.empty(min(near_count(size, n), size), np.int64)
        nearest(vertices.states[:size], x, numbers, forward, near, np.empty(near.shape[0]))
        others = vertices.states[near]
        here = np.empty((near.shape[0], n))

        for i in range(near.shape[0]):
            copy_row(x, here[i])
        into_goal = vertices.in_goal[near]
        if not forward:
            into_goal[:] = root
        tails, heads = (here, others) if forward else (others, here)
        base(around.classes, x, straight)
        return judge(around, connect(tails, heads, numbers), into_goal, near)

    return propose


@kernel
def _from_goal(around, x):  # type: ignore[no-untyped-def]
    """Return the distance of a state's place from the goal point [radii of the goal]."""
    away = 0.0
    for k in range(len(around.goal)):
        away = math.hypot(away, x[k] - around.goal[k])
    return away / around.goal_radius


@cache
def growing(certify: Any) -> Any:
    """Build the kernel `grow` by the one that certifies vertices (`StateKernels.certify`)."""

    @kernel
    def grow(propose, at, vertices, draws, i, around, values, rules):  # type: ignore[no-untyped-def]
        """Make vertices of the draws (k, n) from i on, by a `proposer`; the first not dealt with, and its status."""
        straight = np.empty(at.M)
        while i < draws.shape[0]:
            x = draws[i]
            v = load_int64(at.size, g.SIZE.vertices)
            status = certify(around.static, x)
            if status == BLOCKED or (status != FREE and not rules.asks):
                i += 1
                continue
            away = _from_goal(around, x)
            if status != FREE or v >= vertices.states.shape[0] or abs(away - 1.0) <= TUNING.goal_rim:
                return i, STATUS.ask
            root = away < 1.0
            forward = away >= 1.0
            copy_row(x, vertices.states[v])  # whether or not it becomes a vertex
            vertices.in_goal[v] = root
            out, unsure = _propose(
                propose, (vertices, v if forward else v + 1, x, around, values, forward, root, straight)
            )
            if unsure > 0 and rules.asks:
                return i, STATUS.ask
            if forward and not reaches(at, straight, out, rules):
                i += 1
                continue
            back = out
            if forward and not rules.mirrored:
                back, unsure = _propose(propose, (vertices, v + 1, x, around, values, False, False, straight))
            edges = load_int64(at.size, g.SIZE.edges) + len(out.near) + len(back.near)
            pairs = load_int64(at.size, g.SIZE.pairs) + len(out.turns.marker) + len(back.turns.marker)
            if (unsure > 0 and rules.asks) or edges > at.edge_room or pairs > at.pair_room:
                return i, STATUS.ask
            insert(at, vertices, straight, out, back, around, rules)
            i += 1
            status = relaxed(at, rules)
            if status != STATUS.done:
                return i, status
        return i, STATUS.done

    return grow
