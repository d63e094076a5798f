"""Algorithm 5, ExtractReference: the best path of every class from a state, shortened.

A path leads over the tree, or follows what is left of an earlier one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.jit.threads import mapped
from pirrht.planner import graph as g
from pirrht.planner.rewire import Best, best_classes
from pirrht.planner.tuning import TUNING
from pirrht.shortening.shorten import polish, resume, resumes
from pirrht.steering.edges import Edges
from pirrht.steering.motion import Motions
from pirrht.steering.trajectory import Trajectory
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
        best = Best.room(tree.classes or max(1, int(tree.graph.nodes[edges.near[edges.free]].sum())))
        count = best_classes(storage.places, tree.homology.base(x), edges, weights, tree.rules, best)
        if count == 0:
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit)
        cost = best.cost[:count]
        order = np.argsort(cost, kind="stable")
        if self.most is not None and self.most < count:
            earlier = [known.get(self._winding(edges, int(best.edge[i]), int(best.slot[i]))) for i in range(count)]
            least = [c if path is None else min(c, path.cost.sum()) for c, path in zip(cost, earlier, strict=True)]
            order = order[np.isin(order, np.argsort(least, kind="stable")[: self.most])]

        return mapped(lambda i: self._path(x, edges, int(best.edge[i]), int(best.slot[i]), known), order, self.threads)

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

    def _shorten(self, paths: list[_Path], fresh: list[int]) -> None:
        """Shorten some of the paths, in place."""
        tree = self.tree
        short = mapped(lambda i: polish(paths[i].motions, tree.steering, tree.checker), fresh, self.threads)
        for i, motions in zip(fresh, short, strict=True):
            paths[i] = paths[i]._replace(motions=motions)

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
