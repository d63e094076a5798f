"""Algorithm 5, ExtractReference: the best path of every class from a state, shortened.

A path leads over the tree, or follows what is left of an earlier one. In space and time a class may have several local
optima: to pass in front of a moving obstacle's end or to wait for it may both be of one class, and no path between the
two be free. A tree keeps the cheaper at every vertex, which need not be the cheaper once both are shortened.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.geometry.arcs import FREE
from pirrht.jit.jit import inlined, kernel, load_float64, load_int32, load_int64, mapped
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.planner import graph as g
from pirrht.planner.rewire import Best, best_classes
from pirrht.planner.tuning import TUNING
from pirrht.shortening.shorten import resume, resumes, shorten
from pirrht.steering.edges import Edges
from pirrht.steering.motion import Motions, Trajectory
from pirrht.topology.crossings import key_of_pairs
from pirrht.topology.signature import class_id, integers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """The best known path of one homology class from a state into the goal."""

    winding: tuple[int, ...]  # (M,) whole turns against the straight line from the state to the goal point
    signature: Array  # (M,) the paper's H, leading 1 included [turns]
    trajectory: Trajectory  # controls (l, m), durations (l,) [s] and path
    named: int | None = None  # turns that its name gives at least, as `Signature.named`

    @property
    def path(self) -> Any:
        """Consecutive motions: along arcs, `Curves`."""
        return self.trajectory.path

    @property
    def cost(self) -> float:
        """Steering cost [cost]; it orders references and is never mixed with psi."""
        return self.trajectory.cost

    @property
    def length(self) -> float:
        """Path length [m]."""
        return self.trajectory.length

    @property
    def id(self) -> str:
        """Public name of the class, relative to the state that it starts from."""
        return class_id(self.winding, self.named)

    def __repr__(self) -> str:
        return f"Reference(class {formatting.turns(self.id)}: cost {self.cost:.4g}, {self.length:.3g} m)"


class _Path(NamedTuple):
    """Path of a class from a state into the goal."""

    winding: tuple[int, ...]
    motions: Any
    resumed: bool  # whether it goes on from an earlier one that has been shortened
    others: tuple[Any, ...] = ()  # paths of the class apart from it, which may be shorter once all are shortened


class ReferenceQuery(NamedTuple):
    """One query of a tree as it is now; the fields after it are those of `HomologyTree.references`."""

    tree: Any  # `HomologyTree`
    shortened: bool
    before: Mapping[tuple[int, ...], Motions]
    over_budget: Callable[[], bool]
    threads: int
    most: int | None

    def extract(self, x: Array) -> list[Reference]:
        """References from x (n,), a state as vertices are, least [cost] first (ExtractReference).

        Raises:
            NoReference: no allowed class reaches the goal from x.
        """
        steering = self.tree.steering
        known = self.before if self.shortened and resumes(steering) else {}
        paths = self._paths(x, known)
        if self.shortened:
            fresh = [i for i, path in enumerate(paths) if not path.resumed]
            if known and steering.timed:
                fresh = [] if self.over_budget() else fresh[: TUNING.new_classes]
            self._shorten(paths, fresh)
        return sorted((self._reference(x, path) for path in paths), key=lambda reference: reference.cost)

    def _paths(self, x: Array, known: Mapping[tuple[int, ...], Motions]) -> list[_Path]:
        """Path of every allowed class, cheapest of the tree's own first.

        Of more than `most` classes those are evaluated that seem cheapest, by these and by earlier paths.
        """
        tree = self.tree
        steering, storage, weights = tree.steering, tree.storage, tree.homology.hash_weights
        edges = tree.choose_parent(x, steering.min_neighbours, self.threads)  # line 1
        several = self.shortened and not known and steering.timed
        best = Best.empty(tree.classes or max(1, int(tree.graph.nodes[edges.near[edges.free]].sum())))
        count = best_classes(storage.places, tree.homology.base(x), edges, weights, tree.rules, best)
        if count == 0:
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit)
        cost = best.cost[:count]
        order = np.argsort(cost, kind="stable")
        if self.most is not None and self.most < count:
            earlier = [known.get(self._winding(edges, int(best.edge[i]), int(best.slot[i]))) for i in range(count)]
            least = [c if path is None else min(c, path.cost.sum()) for c, path in zip(cost, earlier, strict=True)]
            order = order[np.isin(order, np.argsort(least, kind="stable")[: self.most])]

        def path(i: int) -> _Path:
            found = self._path(x, edges, int(best.edge[i]), int(best.slot[i]), known)
            if found.resumed or not several:
                return found
            return found._replace(others=self._others(x, edges, int(best.key[i])))

        return mapped(path, order, self.threads)

    def _path(self, x: Array, edges: Edges, edge: int, slot: int, known: Mapping[tuple[int, ...], Motions]) -> _Path:
        """Path from x (n,) over one of the edges and on from a node at its head, or what is left of an earlier one."""
        path, winding = self._motions(x, edges, edge, slot), self._winding(edges, edge, slot)
        again = self._resumed(x, known[winding], winding) if winding in known else None
        taken = again is not None and again.cost.sum() <= path.cost.sum() * (1.0 + TUNING.resumed_excess)
        return _Path(winding, again if taken else path, taken)

    def _motions(self, x: Array, edges: Edges, edge: int, slot: int) -> Any:
        """Path from x (n,) over one of the edges and on from a node at its head, into the goal (line 3)."""
        tree = self.tree
        states = np.vstack([x, tree.states[tree.path_of(int(edges.near[edge]), slot)]])
        return tree.checker.until_goal(tree.steering.connect(states[:-1], states[1:]))

    def _winding(self, edges: Edges, edge: int, slot: int) -> tuple[int, ...]:
        """Class of the path over one of the edges and on from a node at its head."""
        turns = edges.turns.dense(edge, self.tree.homology.M)
        return integers(g.class_at(self.tree.graph, int(edges.near[edge]), slot) + turns)

    def _resumed(self, x: Array, path: Motions, winding: tuple[int, ...]) -> Any:
        """Cheapest path of the class from x (n,) over corners of an earlier one; None if there is none."""
        checker, M = self.tree.checker, self.tree.homology.M
        found = resume(x, path, self.tree.steering, checker)
        if found is None:
            return None
        count = len(found.cost)
        edges = checker.inspect(found, np.arange(count) == count - 1)
        turns = np.sum([edges.turns.dense(i, M) for i in range(count)], axis=0)
        return found if integers(turns) == winding else None

    def _others(self, x: Array, edges: Edges, key: int) -> tuple[Any, ...]:
        """Paths of a class apart from the cheapest, which may end in other local optima."""
        tree, chosen = self.tree, np.empty((TUNING.optima, 2), np.int64)
        steering: Any = tree.steering  # in time
        far = TUNING.optima_apart * float(np.hypot(*(x[:2] - tree.space.scene.goal.center)))
        rules = (far, TUNING.optima_excess, float(steering.pace))
        weights, storage = tree.homology.hash_weights, tree.storage
        count = choose(storage.places, storage.vertices.states, edges, weights, key, x, rules, chosen)
        return tuple(self._motions(x, edges, int(edge), int(slot)) for edge, slot in chosen[1:count])

    def _shorten(self, paths: list[_Path], fresh: list[int]) -> None:
        """Shorten some of the paths, in place."""
        tree = self.tree
        each = [(i, motions) for i in fresh for motions in (paths[i].motions, *paths[i].others)]
        short = mapped(lambda one: shorten(one[1], tree.steering, tree.checker), each, self.threads)
        for i in fresh:
            own = [motions for (j, _), motions in zip(each, short, strict=True) if j == i]
            paths[i] = paths[i]._replace(motions=min(own, key=lambda motions: float(motions.cost.sum())))

    def _reference(self, x: Array, path: _Path) -> Reference:
        homology, steering = self.tree.homology, self.tree.steering
        return Reference(
            winding=path.winding, signature=homology.signature(x, path.winding),
            trajectory=steering.trajectory(path.motions), named=homology.named,
        )  # fmt: skip


def path_of(places: g.Places, vertex: int, slot: int) -> list[int]:
    """Vertices from a node to its root, first to last (ReconstructPath)."""
    graph = places.graph
    key, path = graph.key[vertex, slot], [vertex]
    while graph.parent[vertex, slot] != g.ROOT:
        e = graph.parent[vertex, slot]
        with np.errstate(over="ignore"):
            key = key - graph.edge_key[e]
        vertex = int(graph.head[e])
        slot = g.find(places, vertex, key)
        path.append(vertex)
    return path


@inlined
def _over(at, edges, i, weights, key):  # type: ignore[no-untyped-def]
    """Cost and slot of the cheapest path into a class over a candidate edge; infinite if there is none."""
    if edges.status[i] != FREE:
        return np.inf, -1
    turns = edges.turns
    rest = key - key_of_pairs(turns.marker, turns.turn, turns.first[i], turns.first[i + 1], weights)
    vertex = g.vertex_at(at, edges.near[i])
    slot = g.slot_of(vertex, rest)
    return (np.inf, -1) if slot < 0 else (edges.cost[i] + load_float64(g.node_at(vertex, slot), g.COST), slot)


@kernel
def _follow(at, states, speed, x, vertex, slot, times, places):  # type: ignore[no-untyped-def]
    """Write places (T, 2) at times (T,) of the path from x (3,) over a node; the time at which it arrives.

    It waits where it arrives. The last leg, into a state without a time, has that speed [m/s].
    """
    key = load_int64(g.node_at(g.vertex_at(at, vertex), slot), g.KEY)
    ax, ay, s, k, T = x[0], x[1], x[2], 0, times.shape[0]
    while True:
        bx, by, t = states[vertex, 0], states[vertex, 1], states[vertex, 2]
        if math.isnan(t):
            t = s + math.hypot(bx - ax, by - ay) / speed
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
def choose(at, states, edges, weights, key, x, rules, chosen):  # type: ignore[no-untyped-def]
    """Choose paths of a class from x (3,) over k `Edges`: each apart from all cheaper ones; their number.

    Args:
        key: of the class.
        rules: least distance at some time [m], greatest excess of cost (share of the cheapest), speed of arrival [m/s].
        chosen: (c, 2) edges and slots, cheapest first; filled up to the number that is returned.
    """
    k, (far, excess, speed) = edges.near.shape[0], rules
    cost, slot = np.empty(k), np.empty(k, np.int64)
    for i in range(k):
        cost[i], slot[i] = _over(at, edges, i, weights, key)
    order = np.argsort(cost, kind="mergesort")
    count, most = 0, chosen.shape[0]
    T = TUNING.stations
    times, places, here = np.zeros(T), np.empty((most, T, 2)), np.empty((T, 2))
    for i in order:
        if count == most or not cost[i] <= (1.0 + excess) * cost[order[0]]:
            break
        if count == 0:
            end = _follow(at, states, speed, x, np.int64(edges.near[i]), slot[i], times[:0], here)
            copy_row(np.linspace(x[2], end, T), times)
        _follow(at, states, speed, x, np.int64(edges.near[i]), slot[i], times, here)
        new = True
        for j in range(count):
            widest = 0.0
            for p in range(T):
                widest = max(widest, math.hypot(here[p, 0] - places[j, p, 0], here[p, 1] - places[j, p, 1]))
            new = new and widest > far
        if new:
            copy_rows(here, places[count])
            chosen[count, 0], chosen[count, 1] = i, slot[i]
            count += 1
    return count
