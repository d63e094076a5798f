"""Algorithm 5, ExtractReference: the best path of every class from a state, shortened.

A path leads over the tree, or follows what is left of an earlier one. In space and time a class may have several local
optima: to pass in front of a moving obstacle's end or to wait for it may both be of one class, and no path between the
two be free. A tree keeps the cheaper at every vertex, which need not be the cheaper once both are shortened.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.jit.jit import kernel, load_int32, load_int64, mapped
from pirrht.planner import graph as g
from pirrht.planner.tuning import TUNING
from pirrht.steering.chain import keys_of
from pirrht.steering.edges import Edges
from pirrht.steering.motion import Motions, Trajectory
from pirrht.topology.signature import class_id, integers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """The best known path of one homology class from a state into the goal."""

    winding: tuple[int, ...]  # (M,) whole turns against the straight line from the state to the goal point
    signature: Array  # (M,) the paper's H, leading 1 included [turns]
    trajectory: Trajectory  # controls (l, m), durations (l,) [s] and path
    named: int | None = None  # turns that its name gives at least, as `Signature.named`
    alternatives: tuple[Trajectory, ...] = ()  # other courses of the class, not certified: they may touch something

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


class ReferenceQuery(NamedTuple):
    """One query of a tree as it is now; the fields after it are those of `HomologyTree.references`."""

    tree: Any  # `HomologyTree`
    steering: Any  # `Steering` that leads to vertices of the tree and shortens paths
    shortened: bool
    before: Mapping[tuple[int, ...], Motions]
    over_budget: Callable[[], bool]
    threads: int
    most: int | None
    hopeless: Callable[[float], float] | None

    def extract(self, x: Array) -> list[Reference]:
        """References from x (n,), a state as vertices are, least [cost] first (ExtractReference); NoReference: none."""
        tree, homology = self.tree, self.tree.homology
        steering = self.steering
        known = self.before if self.shortened and steering.resumes else {}
        edges = tree.edges_from(x, steering.min_neighbours, self.threads, steering)  # line 1
        rows = _rows(tree, edges)
        classes = self._classes(x, edges, rows, known)
        if not classes:
            raise NoReference(x.tolist(), vertices=tree.size, limit=tree.limit)
        several = self.shortened and not known and steering.several

        def of_class(winding: tuple[int, ...]) -> tuple[bool, list[Any]]:
            """Return true and a path that has been shortened, or false and paths to shorten, cheapest first."""
            row = classes[winding]
            path = self._path(x, edges, row)
            again = self._resumed(x, known[winding], winding) if winding in known else None
            if again is not None and again.cost.sum() <= path.cost.sum() * (1.0 + TUNING.resumed_excess):
                # One that costs more than before leads back to a corner that the robot has passed.
                return steering.timed or again.cost.sum() <= known[winding].cost.sum(), [again]
            return False, self._optima(x, edges, rows[rows["key"] == row["key"]]) if several else [path]

        found = mapped(of_class, classes, self.threads)
        worth = self._worth_shortening([*classes], [options[0].cost.sum() for _, options in found])
        fresh = [i for i, (resumed, _) in enumerate(found) if worth[i] and not resumed]
        if known and steering.timed:
            fresh = [] if self.over_budget() else fresh[: TUNING.new_classes]
        paths = [options[:1] for _, options in found]
        for i, some in self._shortest({i: found[i][1] for i in fresh}).items():
            paths[i] = some
        references = [
            Reference(
                winding=winding, signature=homology.signature(x, winding), trajectory=steering.trajectory(path),
                named=homology.named, alternatives=tuple(map(steering.trajectory, others)),
            )
            for winding, (path, *others) in zip(classes, paths, strict=True)
        ]  # fmt: skip
        return sorted(references, key=lambda reference: reference.cost)

    def _worth_shortening(self, classes: Sequence[tuple[int, ...]], costs: Sequence[float]) -> list[bool]:
        """Check of classes, by costs [cost] before they are shortened, that they may come to have weight."""
        if self.hopeless is None or not self.shortened:
            return [self.shortened] * len(classes)
        bound = self.hopeless(min(costs))
        earlier = [self.before[one].cost.sum() if one in self.before else np.inf for one in classes]
        return [min((1.0 - TUNING.saving) * cost, other) <= bound for cost, other in zip(costs, earlier, strict=True)]

    def _shortest(self, options: Mapping[int, list[Any]]) -> dict[int, list[Any]]:
        """Shorten paths, of which there are some for each number; return those of each, cheapest first.

        In space and time that is the cheapest alone, else all that are no deformation of a cheaper one.
        """
        steering, checker = self.steering, self.tree.checker
        each = [(i, path) for i, some in options.items() for path in some]
        short = mapped(lambda one: (one[0], steering.shorten(one[1], checker)), each, self.threads)
        own = {i: sorted((path for j, path in short if j == i), key=lambda path: path.cost.sum()) for i in options}
        return {i: some[:1] if steering.timed else self._apart(some) for i, some in own.items()}

    def _apart(self, paths: Sequence[Any]) -> list[Any]:
        """Return paths of a class, cheapest first, that are none a deformation of a cheaper one.

        One is if places of equal shares of both see each other (visibility deformation: Jaillet and Simeon, 2008).
        """
        space = self.tree.space
        shares = np.linspace(0.0, 1.0, TUNING.stations)
        kept: list[tuple[Any, Array]] = []
        for path in paths:
            corners = np.vstack([path.tails, path.heads[-1:]])[:, : len(space.scene.goal.center)]
            length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
            places = np.column_stack([np.interp(shares * length[-1], length, axis) for axis in corners.T])
            if not any(space.collision.segments_free(places, other).all() for _, other in kept):
                kept.append((path, places))
        return [path for path, _ in kept[: TUNING.optima]]

    def _classes(self, x: Array, edges: Edges, rows: Any, known: Mapping[tuple[int, ...], Motions]) -> dict[Any, Any]:
        """The cheapest row of every allowed class by its winding, cheapest first.

        Of more than `most` classes those are kept that seem cheapest, by these and by earlier paths.
        """
        tree, best = self.tree, {}
        base = tree.homology.base(x)
        for row in rows[np.sort(np.unique(rows["key"], return_index=True)[1])]:
            turns = g.class_at(tree.graph, edges.near[row["edge"]], row["slot"])
            winding = integers(turns + edges.turns.dense(row["edge"], tree.homology.M))
            if np.all(np.abs(base + winding) <= tree.limit):
                best[winding] = row
                if len(best) == tree.classes:
                    break
        seem = {w: min(row["cost"], known[w].cost.sum() if w in known else np.inf) for w, row in best.items()}
        kept = sorted(seem, key=seem.__getitem__)[: self.most]
        return {winding: row for winding, row in best.items() if winding in kept}

    def _path(self, x: Array, edges: Edges, row: Any) -> Any:
        """Path from x (n,) over an edge and on from a node at its head, into the goal (line 3)."""
        tree = self.tree
        vertex = int(edges.near[row["edge"]])
        states = np.vstack([x, tree.states[path_of(tree.storage.places, vertex, int(row["slot"]))]])
        return tree.checker.until_goal(self.steering.connect(states[:-1], states[1:]))

    def _resumed(self, x: Array, path: Motions, winding: tuple[int, ...]) -> Any:
        """Cheapest path of the class from x (n,) over corners of an earlier one; None if there is none."""
        found = self.steering.resume(x, path, self.tree.checker)
        if found is None:
            return None
        count = len(found.cost)
        edges = self.tree.checker.inspect(found, np.arange(count) == count - 1)
        turns = np.sum([edges.turns.dense(i, self.tree.homology.M) for i in range(count)], axis=0)
        return found if integers(turns) == winding else None

    def _optima(self, x: Array, edges: Edges, rows: Any) -> list[Any]:
        """Paths of a class, each apart from all cheaper ones: they may end in different local optima."""
        rows = rows[rows["cost"] <= (1.0 + TUNING.optima_excess) * rows["cost"][0]]
        if not self.steering.timed:
            return self._apart([self._path(x, edges, row) for row in rows])
        goal = self.tree.space.scene.goal.center
        far = TUNING.optima_apart * float(np.hypot.reduce(x[: len(goal)] - goal))
        paths = [self._path(x, edges, row) for row in rows[:: 1 + len(rows) // TUNING.optima_tried]]
        times = np.linspace(x[len(goal)], paths[0].knots[-1, -1], TUNING.stations)
        chosen: list[tuple[Any, Array]] = []
        for path in paths:
            places = path.places(times)
            if all(np.hypot.reduce(places - other, axis=1).max() > far for _, other in chosen):
                chosen.append((path, places))
        return [path for path, _ in chosen[: TUNING.optima]]


def _rows(tree: Any, edges: Edges) -> Any:
    """Cost, key of the class, edge and slot of the paths over every edge and on from a node, cheapest first."""
    graph, near = tree.graph, edges.near
    edge, slot = np.nonzero((np.arange(graph.cost.shape[1]) < graph.nodes[near][:, None]) & edges.free[:, None])
    rows = np.empty(len(edge), [("cost", "f8"), ("key", "i8"), ("edge", "i8"), ("slot", "i8")])
    rows["edge"], rows["slot"] = edge, slot
    rows["cost"] = edges.cost[edge] + graph.cost[near[edge], slot]
    with np.errstate(over="ignore"):  # keys wrap
        rows["key"] = keys_of(edges.turns, tree.homology.hash_weights)[edge] + graph.key[near[edge], slot]
    return rows[np.argsort(rows["cost"], kind="stable")]


@kernel
def path_of(at, vertex, slot):  # type: ignore[no-untyped-def]
    """Vertices from a node to its root, first to last (ReconstructPath)."""
    node = g.node_at(g.vertex_at(at, vertex), slot)
    path = [vertex]
    key = load_int64(node, g.KEY)
    while load_int32(node, g.PARENT) != g.ROOT:
        edge = g.edge_at(at, load_int32(node, g.PARENT))
        key -= load_int64(edge, g.EDGE_KEY)
        vertex = np.int64(load_int32(edge, g.HEAD))
        node = g.node_at(g.vertex_at(at, vertex), g.slot_of(g.vertex_at(at, vertex), key))
        path.append(vertex)
    return np.array(path)
