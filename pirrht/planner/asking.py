"""Algorithm 5: the best path of every class from a state, over the tree or left of an earlier one, and shortened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.jit.threads import mapped
from pirrht.planner import graph as g
from pirrht.planner.around import Neighbourhood
from pirrht.planner.extend import Vertices
from pirrht.planner.nodes import SearchRules
from pirrht.planner.reference import Reference
from pirrht.planner.search import Best, best_classes
from pirrht.planner.valleys import apart_of, choose
from pirrht.shortening.shorten import polish, resume, resumes
from pirrht.steering.edges import Edges
from pirrht.steering.in_time import InTime
from pirrht.steering.motion import Motions
from pirrht.topology.signature import integers

ALIKE = 1e-5  # share of its cost by which a path that was shortened before may exceed one that is not
WAYS = 4  # of a class in space and time that are shortened where no earlier one is known
APART, DEARER = 0.1, 0.2  # these lie so far from each other, as a share of the way to the goal, and cost so much more
NEW = 1  # of the classes in space and time that is polished at once while earlier paths of others are known

Earlier = Mapping[tuple[int, ...], Motions]  # polished paths by winding


class _Path(NamedTuple):
    """The path of a class from a state into the goal."""

    winding: tuple[int, ...]
    motions: Any
    taut: bool  # whether it goes on from an earlier one that has been shortened
    others: tuple[Any, ...] = ()  # of the same class, apart from it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceQuery:
    """A tree as it stands when it is asked; worthless once it has grown."""

    around: Neighbourhood
    rules: SearchRules
    places: g.Places
    vertices: Vertices  # those that count

    def references(
        self,
        x: Array,
        *,
        polished: bool,
        before: Earlier | None,
        pressed: Callable[[], bool],
        threads: int,
        most: int | None = None,
    ) -> list[Reference]:
        """See `HomologyTree.references`; x (n,) is a state as vertices are."""
        known = before if before and polished and resumes(self.around.steering) else {}
        ways = polished and not known and isinstance(self.around.steering, InTime)
        paths = self._paths(x, known, ways, threads, most)
        if polished:
            raw = [i for i, path in enumerate(paths) if not path.taut]
            if known and isinstance(self.around.steering, InTime):
                raw = [] if pressed() else raw[:NEW]
            self._shorten(paths, raw, threads)
        return sorted((self._reference(x, path) for path in paths), key=lambda reference: reference.cost)

    def path_of(self, vertex: int, slot: int) -> list[int]:
        """Vertices from a node to its root, first to last (ReconstructPath)."""
        gr = self.places.graph
        key, path = gr.key[vertex, slot], [vertex]
        while gr.parent[vertex, slot] != g.ROOT:
            e = gr.parent[vertex, slot]
            with np.errstate(over="ignore"):
                key = key - gr.edge_key[e]
            vertex = int(gr.head[e])
            slot = g.find(self.places, vertex, key)
            path.append(vertex)
        return path

    def _paths(self, x: Array, known: Earlier, ways: bool, threads: int, most: int | None) -> list[_Path]:
        """The path of every allowed class, cheapest of the tree's own first; with other `ways` where it is not taut.

        Of more than `most` classes those are looked at that seem cheapest, by these and by earlier paths.
        """
        around, nodes = self.around, self.places.graph.nodes
        edges = around.edges_from(x, self.vertices, around.steering.asked, threads)
        best = Best.room(self.rules.classes or max(1, int(nodes[edges.near[edges.free]].sum())))
        weights = around.homology.hash_weights
        count = best_classes(self.places, around.straight(x), edges, weights, self.rules, best)
        if count == 0:
            raise NoReference(x.tolist(), vertices=len(self.vertices.states), limit=self.rules.limit)
        cost = best.cost[:count]
        order = np.argsort(cost, kind="stable")
        if most is not None and most < count:
            earlier = [known.get(self._winding(edges, int(best.edge[i]), int(best.slot[i]))) for i in range(count)]
            least = [c if path is None else min(c, path.cost.sum()) for c, path in zip(cost, earlier, strict=True)]
            order = order[np.isin(order, np.argsort(least, kind="stable")[:most])]

        def path(i: int) -> _Path:
            found = self._path(x, edges, int(best.edge[i]), int(best.slot[i]), known)
            if found.taut or not ways:
                return found
            return found._replace(others=self._others(x, edges, int(best.key[i])))

        return mapped(path, order, threads)

    def _shorten(self, paths: list[_Path], raw: list[int], threads: int) -> None:
        """Shorten some of the paths, in place."""
        around = self.around
        each = [(i, motions) for i in raw for motions in (paths[i].motions, *paths[i].others)]
        short = mapped(lambda one: polish(one[1], around.steering, around.space), each, threads)
        for i in raw:
            own = [motions for (j, _), motions in zip(each, short, strict=True) if j == i]
            own.sort(key=lambda motions: float(motions.cost.sum()))
            others = apart_of(own, self._far(own[0].knots[0])) if paths[i].others else ()
            paths[i] = paths[i]._replace(motions=own[0], others=others)

    def _path(self, x: Array, edges: Edges, edge: int, slot: int, known: Earlier) -> _Path:
        """The path from x (n,) over one of the edges and on from a node at its head, or what is left of an earlier."""
        path, winding = self._motions(x, edges, edge, slot), self._winding(edges, edge, slot)
        again = self._resumed(x, known[winding], winding) if winding in known else None
        taut = again is not None and again.cost.sum() <= path.cost.sum() * (1.0 + ALIKE)
        return _Path(winding, again if taut else path, taut)

    def _winding(self, edges: Edges, edge: int, slot: int) -> tuple[int, ...]:
        """The class of the path over one of the edges and on from a node at its head."""
        turns = edges.turns.dense(edge, self.around.homology.M)
        return integers(g.class_at(self.places.graph, int(edges.near[edge]), slot) + turns)

    def _others(self, x: Array, edges: Edges, key: int) -> tuple[Any, ...]:
        """What ways of a class there are apart from the cheapest."""
        steering, weights = self.around.steering, self.around.homology.hash_weights
        assert isinstance(steering, InTime)
        chosen, rules = np.empty((WAYS, 2), np.int64), (self._far(x), DEARER)
        count = choose(self.places, self.vertices.states, edges, weights, key, x, steering.pace, rules, chosen)
        return tuple(self._motions(x, edges, int(edge), int(slot)) for edge, slot in chosen[1:count])

    def _far(self, x: Array) -> float:
        """How far apart ways from x (n,) lie that may end in different valleys [m]."""
        return APART * float(np.hypot(*(x[:2] - self.around.space.scene.goal.center)))

    def _motions(self, x: Array, edges: Edges, edge: int, slot: int) -> Any:
        """The path from x (n,) over one of the edges and on from a node at its head, into the goal."""
        around = self.around
        states = np.vstack([x, self.vertices.states[self.path_of(int(edges.near[edge]), slot)]])
        return around.checker.until_goal(around.steering.connect(states[:-1], states[1:]))

    def _resumed(self, x: Array, path: Motions, winding: tuple[int, ...]) -> Any:
        """The cheapest path of the class from x (n,) over corners of an earlier one; None if there is none."""
        checker = self.around.checker
        found = resume(x, path, self.around.steering, checker)
        if found is None:
            return None
        count = len(found.cost)
        edges = checker.inspect(found, np.arange(count) == count - 1)
        turns = np.sum([edges.turns.dense(i, self.around.homology.M) for i in range(count)], axis=0)
        return found if integers(turns) == winding else None

    def _reference(self, x: Array, path: _Path) -> Reference:
        return Reference(
            winding=path.winding,
            signature=self.around.homology.signature(x, path.winding),
            trajectory=self.around.steering.trajectory(path.motions),
            named=self.around.homology.named,
            others=tuple(self.around.steering.trajectory(other) for other in path.others),
        )
