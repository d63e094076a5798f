"""The expansion phase: a goal-rooted tree in the H-augmented space, and the references it gives (Algorithms 1-3, 5)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import Curves
from pirrht.shortening.shorten import polish
from pirrht.steering.steering import Steering
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.homology import class_id, integers
from pirrht.tree import extend as growth
from pirrht.tree import graph as g
from pirrht.tree import search as relaxation
from pirrht.tree.allowed import user_predicate
from pirrht.tree.edges import Edges, Inspector
from pirrht.tree.layout import ROOT

GOAL_SHARE = 0.02  # share of the draws that go to the goal's disc, which uniform draws would rarely hit
DRAWS_PER_VERTEX = 50
AT_ONCE = 256  # draws that are made and dealt with together


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """The best known path of one homology class from a state into the goal."""

    winding: tuple[int, ...]  # (M,) whole turns against the straight line from the state to the goal point
    signature: Array  # (M,) the paper's H, leading 1 included
    trajectory: Trajectory

    @property
    def path(self) -> Curves:
        """Rows are consecutive curves."""
        return self.trajectory.path

    @property
    def cost(self) -> float:
        """Steering cost; it orders references and is never mixed with psi."""
        return self.trajectory.cost

    @property
    def length(self) -> float:
        """Path length [m]."""
        return self.trajectory.length

    @property
    def id(self) -> str:
        """Public name of the class, relative to the state it was asked for."""
        return class_id(self.winding)


class HomologyTree:
    """RRG on the state space with at most one node per allowed class at each vertex.

    Args:
        space: the examined scene.
        steering: the obstacle-blind two-point optimum.
        limit: H_limit of the allowed set |1 - H_i| <= H_limit, asked at every vertex.
        allowed: a predicate on the paper's H (M,) that takes the limit's place.
        classes: keep at most so many cheapest classes per vertex; 0 keeps all.
        rng: source of the random states.
    """

    def __init__(
        self,
        space: FreeSpace,
        steering: Steering,
        *,
        limit: float = 0.6,
        allowed: Callable[[Array], bool] | None = None,
        classes: int = 16,
        rng: np.random.Generator,
    ) -> None:
        if not (np.isfinite(limit) and limit > 0):
            raise OptionError(f"the limit H_limit is {limit:g}; it must be positive (0.5 < limit < 1 is usual)")
        if classes < 0:
            raise OptionError(f"classes is {classes}; it must be 0 (all) or more")
        self.space, self.steering, self.limit, self.classes = space, steering, limit, classes
        self.rng = rng
        self.inspector = Inspector.of(space)
        predicate = () if allowed is None else (user_predicate(allowed),)
        self.kernels = relaxation.kernels(*predicate)
        self._attach_kernel = growth.attach_with(self.kernels)
        self._predicate = allowed is not None
        # A user's predicate takes Python's time anyway, and another kernel would have to be compiled for each.
        ready = None if self._predicate else steering.compiled
        self._grow_kernel = None if ready is None else growth.grow_with(self.kernels, ready)
        self._surroundings = growth.Surroundings(
            space.field, space.homology.cuts, space.homology.markers, space.scene.goal.center, space.scene.goal.radius
        )
        self.states = np.zeros((256, steering.n))
        self.in_goal = np.zeros(256, dtype=np.bool_)
        self.graph = g.empty_graph(256, 8192, max(1, classes) if classes else 8, space.homology.M)
        self.draws = 0
        self._add_roots()

    @property
    def size(self) -> int:
        """Number of vertices."""
        return int(self.graph.size[0])

    @property
    def limited_by_predicate(self) -> bool:
        """Whether a function of the caller takes the limit's place."""
        return self._predicate

    @property
    def node_count(self) -> int:
        """Number of nodes, all classes of all vertices."""
        return int(self.graph.nodes[: self.size].sum())

    def grow(self, vertices: int, *, progress: Callable[[int], None] | None = None) -> None:
        """Grow until the tree has so many vertices, with at most 50 draws for each (Algorithm 1)."""
        budget = DRAWS_PER_VERTEX * max(0, vertices - self.size)
        while self.size < vertices and budget > 0:
            count = min(vertices - self.size, budget, AT_ONCE)
            budget -= count
            self.extend_by(np.array([self._sample() for _ in range(count)]))
            if progress is not None:
                progress(self.size)

    def extend_by(self, draws: Array) -> None:
        """As many iterations of Algorithm 1 with the states (k, n), the same as `extend` one by one and faster."""
        i = 0
        while i < len(draws):
            status = growth.ASK
            if self._grow_kernel is not None:
                before = i
                i, status = self._compiled(self._grow_kernel, draws, i)
                self.draws += i - before
            if status == growth.ASK:
                if i < len(draws):
                    self.extend(draws[i])
                i += 1
            elif status != relaxation.DONE:
                self._relax()

    def _compiled(self, kernel: Callable[..., tuple[int, int]], draws: Array, i: int) -> tuple[int, int]:
        return kernel(
            self.graph, self.states, self.in_goal, self._surroundings, draws, i, self.steering.radius,
            self.steering.cost_per_meter, self._weights, self.limit, self.classes, self.steering.symmetric,
        )  # fmt: skip

    def reserve(self, vertices: int) -> None:
        """Make room for about so many vertices at once, lest growth stop for it later, or to be compiled."""
        if self._grow_kernel is not None:
            self._compiled(self._grow_kernel, self.states[:0], 0)
        more = 1.5 * vertices / self.size  # a vertex of a larger tree has more neighbours
        while len(self.states) < vertices:
            self._double_vertices()
        self._make_room(int(more * self.graph.size[1]), int(more * self.graph.size[4]))

    def extend(self, x: Array) -> bool:
        """One iteration of Algorithm 1 with the state x (n,); whether it became a vertex."""
        self.draws += 1
        if not self.inspector.point_free(x):
            return False
        straight = self.space.homology.straight(x[None, :2])[0]
        if self.space.scene.goal.contains(x[:2]):
            self._add_vertex(x, straight, root=True)
            self._link_backward(self.size - 1)
        else:
            status = self._attach(x, straight)
            if status != relaxation.DONE:
                if status == growth.REJECTED:
                    return False
                self._relax()
            if self.steering.symmetric:
                return True
            self._link_backward(self.size - 1)
        self._relax()
        return True

    def references(self, x: Array, *, polished: bool = True) -> list[Reference]:
        """The best path of every allowed class from x (n,), cheapest first; the tree is not changed (Algorithm 5).

        Raises:
            NoReference: no allowed class reaches the goal from x.
        """
        heads, count, found = self._search(x)
        if count == 0:
            raise NoReference(x.tolist(), vertices=self.size, limit=None if self._predicate else self.limit)
        best = np.argsort(found.cost[:count], kind="stable")
        references = [
            self._reference(x, int(heads[found.edge[i]]), int(found.slot[i]), found.turns[i], polished) for i in best
        ]
        return sorted(references, key=lambda reference: reference.cost)

    def lengths(self, x: Array) -> dict[tuple[int, ...], float]:
        """Length [m] of the tree's own best path of every allowed class from x (n,), by winding; empty if none."""
        _, count, found = self._search(x)
        return {integers(found.turns[i]): float(found.cost[i]) / self.steering.cost_per_meter for i in range(count)}

    def path_of(self, vertex: int, slot: int) -> list[int]:
        """Vertices from a node to its root, first to last."""
        gr = self.graph
        key, path = gr.key[vertex, slot], [vertex]
        while gr.parent[vertex, slot] != ROOT:
            e = gr.parent[vertex, slot]
            with np.errstate(over="ignore"):
                key = key - gr.edge_key[e]
            vertex = int(gr.head[e])
            slot = g.find(gr, vertex, key)
            path.append(vertex)
        return path

    # -- growing -----------------------------------------------------------------------------------------------

    def _sample(self) -> Array:
        x = self.steering.sample(self.space.scene, self.rng)
        if self.rng.random() < GOAL_SHARE:
            goal = self.space.scene.goal
            angle, radius = self.rng.uniform(-np.pi, np.pi), goal.radius * np.sqrt(self.rng.random())
            x[:2] = goal.center + radius * np.array([np.cos(angle), np.sin(angle)])
        return x

    def _add_roots(self) -> None:
        for x in self.steering.roots(self.space.scene.goal.center):
            self._add_vertex(x, self.space.homology.straight(x[None, :2])[0], root=True)

    def _add_vertex(self, x: Array, straight: Array, *, root: bool) -> None:
        v = self._place(x, root=root)
        self.graph.straight[v] = straight
        self.graph.size[0] = v + 1
        if root:
            self.graph.nodes[v] = 1

    def _place(self, x: Array, *, root: bool) -> int:
        """Write a state where the next vertex will be; its index."""
        v = self.size
        if v >= len(self.states):
            self._double_vertices()
        self.states[v], self.in_goal[v] = x, root
        return v

    def _double_vertices(self) -> None:
        self.graph = g.doubled(self.graph, g.VERTICES + g.NODES)
        self.states = np.vstack([self.states, np.zeros_like(self.states)])
        self.in_goal = np.concatenate([self.in_goal, np.zeros_like(self.in_goal)])

    def _attach(self, x: Array, straight: Array) -> int:
        """Make x (n,) a vertex if an allowed class reaches the goal from it; REJECTED, DONE or what must grow."""
        near = self._near(x, forward=True)
        edges = self._inspect(x, near, forward=True)
        self._place(x, root=False)
        self._make_room(2 * len(near), 2 * len(edges.turns.marker))
        return self._attach_kernel(
            self.graph, straight, near, self.in_goal[near], (edges.free, edges.cost, edges.turns), self._weights,
            self.limit, self.classes, self.steering.symmetric,
        )  # fmt: skip

    def _make_room(self, edges: int, pairs: int) -> None:
        while self.graph.size[1] + edges > len(self.graph.tail):
            self.graph = g.doubled(self.graph, g.EDGES)
        while self.graph.size[4] + pairs > len(self.graph.edge_marker):
            self.graph = g.doubled(self.graph, g.EDGE_PAIRS)

    def _link_backward(self, v: int) -> None:
        """Rewire, lines 1-7: edges from the vertices near v to v."""
        near = self._near(self.states[v], forward=False)
        near = near[(near != v) & ~self.in_goal[near]]
        edges = self._inspect(self.states[v], near, forward=False, root=bool(self.in_goal[v]))
        rows = np.flatnonzero(edges.free)
        self._make_room(len(rows), len(edges.turns.marker))
        tails, heads = near[rows], np.full(len(rows), v)
        g.add_edges(self.graph, tails, heads, edges.cost[rows], edges.turns, rows, 1, self._weights)
        for u in near[rows] if self.in_goal[v] else ():
            self._refill(int(u))

    def _refill(self, v: int) -> None:
        if not self.graph.waiting[v]:
            self.graph.waiting[v] = True
            self.graph.refill[self.graph.size[3]] = v
            self.graph.size[3] += 1

    def _relax(self) -> None:
        while True:
            match self.kernels.relax(self.graph, self.limit, self.classes):
                case relaxation.DONE:
                    return
                case relaxation.NODES_FULL:
                    self.graph = g.doubled(self.graph, g.NODES, axis=1)
                case relaxation.QUEUE_FULL:
                    self.graph = g.doubled(self.graph, g.QUEUE)
                case relaxation.PAIRS_FULL:
                    self.graph = g.doubled(self.graph, g.NODE_PAIRS, axis=2)

    # -- asking ------------------------------------------------------------------------------------------------

    @property
    def _weights(self) -> NDArray[np.int64]:
        return self.space.homology.hash_weights

    def _near(self, x: Array, *, forward: bool) -> NDArray[np.int64]:
        """NearForward and NearBackward: the RRG's k nearest, k = e (1 + 1/n) log |V|."""
        count = math.ceil(math.e * (1.0 + 1.0 / self.steering.n) * math.log(self.size + 1))
        return self.steering.nearest(self.states[: self.size], x, count, forward=forward)

    def _inspect(self, x: Array, near: NDArray[np.int64], *, forward: bool, root: bool = False) -> Edges:
        here = np.empty((len(near), len(x)))
        here[:] = x
        if forward:
            return self.inspector.inspect(self.steering.connect(here, self.states[near]), self.in_goal[near])
        return self.inspector.inspect(self.steering.connect(self.states[near], here), np.full(len(near), root))

    def _search(self, x: Array) -> tuple[NDArray[np.int64], int, _Found]:
        """Heads of the free edges from x (n,), and the best classes over them."""
        near = self._near(x, forward=True)
        edges = self._inspect(x, near, forward=True)
        rows = np.flatnonzero(edges.free)
        count, found = self._classes_over(self.space.homology.straight(x[None, :2])[0], near, edges, rows)
        for i in range(count):
            edge, slot = found.edge[i], found.slot[i]
            found.turns[i] = g.class_at(self.graph, near[rows[edge]], slot) + edges.turns.dense(
                rows[edge], self.space.homology.M
            )
        return near[rows], count, found

    def _classes_over(
        self, straight: Array, near: NDArray[np.int64], edges: Edges, rows: NDArray[np.int64]
    ) -> tuple[int, _Found]:
        """The best classes over the edges in `rows` to vertices near a state; the classes are not yet written out."""
        heads = near[rows]
        room = self.classes or max(1, int(self.graph.nodes[heads].sum()))
        found = _Found(
            cost=np.full(room, np.inf),
            key=np.zeros(room, np.int64),
            turns=np.zeros((room, self.space.homology.M), np.int64),
            edge=np.zeros(room, np.int64),
            slot=np.zeros(room, np.int64),
        )
        count = self.kernels.best_classes(
            self.graph, straight, heads, edges.cost[rows], edges.turns, rows, self._weights,
            self.limit, found.cost, found.key, found.edge, found.slot,
        )  # fmt: skip
        return int(count), found

    def _reference(self, x: Array, head: int, slot: int, turns: NDArray[np.int64], polished: bool) -> Reference:
        states = np.vstack([x, self.states[self.path_of(head, slot)]])
        path = self.inspector.cut_at_goal(self.steering.connect(states[:-1], states[1:]))
        if polished:
            path = polish(path, self.steering, self.space)
        winding = integers(turns)
        return Reference(
            winding=winding,
            signature=self.space.homology.signature(x, winding),
            trajectory=self.steering.trajectory(path),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """Best classes over candidate edges; rows beyond the count are empty."""

    cost: Array
    key: NDArray[np.int64]
    turns: NDArray[np.int64]
    edge: NDArray[np.int64]
    slot: NDArray[np.int64]
