"""The expansion phase: a goal-rooted tree in the H-augmented space, and the references it gives (Algorithms 1-3, 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, cast

import numpy as np

from pirrht import shown
from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages, find_passages
from pirrht.jit.pointers import address_of
from pirrht.planner import graph as g
from pirrht.planner import plot as tree_plot
from pirrht.planner.around import Neighbourhood
from pirrht.planner.asking import ReferenceQuery
from pirrht.planner.extend import Vertices, grow, insert, proposer
from pirrht.planner.nodes import SearchRules
from pirrht.planner.offers import PassageSampler
from pirrht.planner.reference import Reference
from pirrht.planner.search import reaches, relax
from pirrht.planner.status import ASK, DONE, NODES_FULL, PAIRS_FULL, QUEUE_FULL
from pirrht.steering.edges import NO_EDGES, Edges
from pirrht.steering.motion import Motions
from pirrht.steering.steering import Compiled, Steering

GOAL_SHARE = 0.02  # share of the draws that go to the goal's disc, which uniform draws would rarely hit
DRAWS_PER_VERTEX, HURRIED = 50, 40  # HURRIED: draws, a few milliseconds
MORE = {NODES_FULL: (g.NODES, 1), QUEUE_FULL: (g.QUEUE, 0), PAIRS_FULL: (g.NODE_PAIRS, 2)}


class HomologyTree:
    """RRG on the state space with at most one node per allowed class at each vertex.

    Of `states` (V, n) and `in_goal` (V,) the first `size` rows count; `draws` counts iterations of Algorithm 1.

    Args:
        space: the examined scene.
        steering: the obstacle-blind two-point optimum.
        limit: H_limit [turns] of the allowed set |1 - H_i| <= H_limit, asked at every vertex.
        classes: keep at most so many cheapest classes per vertex; 0 keeps all.
        rng: source of the random states.

    Examples:
        >>> import numpy as np
        >>> from pirrht import *
        >>> size, position = np.array([0.4, 0.4, 0.3]), np.array([2.0, 1.5, 0.3])
        >>> table = Obstacle(name="table", kind=Kind.BOX, size=size, position=position, rotation=np.eye(3))
        >>> scene = Scene(
        ...     name="room", lower=np.zeros(2), upper=np.array([4.0, 3.0]), obstacles=(table,),
        ...     goal=Goal(center=np.array([3.4, 1.5]), radius=0.3), start=np.array([0.6, 1.4, 0.0]), robot_radius=0.2,
        ... )
        >>> problem = Problem(dynamics=SingleIntegrator(b=0.1), scene=scene, R=2.0 * np.eye(2))
        >>> space = FreeSpace.of(scene)
        >>> tree = HomologyTree(space, StraightLine.of(problem), rng=np.random.default_rng(0))
        >>> tree.grow(100)
        >>> tree.size
        100
        >>> [reference.id for reference in tree.references(scene.start[:2])]  # below the table, and above it
        ['0', '-1']

    Raises:
        OptionError: the limit is not positive, classes is negative, or the steering is of no states in the plane.
    """

    def __init__(
        self,
        space: FreeSpace,
        steering: Steering,
        *,
        limit: float = 0.6,
        classes: int = 16,
        rng: np.random.Generator,
    ) -> None:
        if not (np.isfinite(limit) and limit > 0):
            raise OptionError(f"the limit H_limit is {limit:g}; it must be positive (0.5 < limit < 1 is usual)")
        if classes < 0:
            raise OptionError(f"classes is {classes}; it must be 0 (all) or more")
        roots = np.asarray(steering.roots(space.scene.goal.center))
        if steering.n < 2 or roots.ndim != 2 or roots.shape[1] != steering.n:
            raise OptionError(
                f"{type(steering).__name__}: n is {steering.n} and its roots are {roots.shape}; a tree in the plane "
                "takes states of 2 numbers or more, x and y first, and roots (k, n)"
            )
        self.space, self.steering, self.rng = space, steering, rng
        self.rules = SearchRules(float(limit), int(classes), bool(steering.symmetric))
        self.around = Neighbourhood.of(space, steering)
        self.homology = self.around.homology
        self._compiled = steering.compiled
        self._remembering = steering.remembering(self.around.checker.around)
        self.states = np.zeros((256, steering.n))
        self.in_goal = np.zeros(256, dtype=np.bool_)
        self.graph = g.empty_graph(256, 8192, max(1, classes) if classes else 8, self.homology.M)
        self.draws = 0
        self.origin: Array | None = None  # where the robot is, (n,), as draws take it; None: at the scene's start
        for x in roots:
            self._write(x, root=True)
            self._insert(self.around.straight(x), NO_EDGES, NO_EDGES)

    @property
    def graph(self) -> g.Graph:
        """The graph and its nodes; another one, with more room, whenever they are full."""
        return self._places.graph

    @graph.setter
    def graph(self, graph: g.Graph) -> None:
        self._places = g.Places.of(graph)

    @property
    def limit(self) -> float:
        """H_limit of the allowed set [turns]."""
        return self.rules.limit

    @property
    def classes(self) -> int:
        """The most classes of a vertex; 0: all."""
        return self.rules.classes

    @property
    def size(self) -> int:
        """Number of vertices."""
        return int(self.graph.size[0])

    @property
    def node_count(self) -> int:
        """Number of nodes, all classes of all vertices."""
        return int(self.graph.nodes[: self.size].sum())

    def grow(
        self, vertices: int, *,
        progress: Callable[[int], None] | None = None, enough: Callable[[int], bool] | None = None,
    ) -> None:  # fmt: skip
        """Grow until the tree has so many vertices, with at most 50 draws for each (Algorithm 1).

        Passages are drawn first, and again until they are vertices; at least every second draw is uniform.

        Args:
            progress: called with the number of vertices after every batch of draws.
            enough: asked after every HURRIED draws or fewer whether a tree of so many vertices stays as it is.
        """
        budget = DRAWS_PER_VERTEX * max(0, vertices - self.size)
        most = budget if enough is None else HURRIED
        while self.size < vertices and budget > 0:
            if enough is not None and enough(self.size):
                return
            self._offers.note(self.states[: self.size])
            count = min(vertices - self.size, budget, most, self._offers.together(self.draws))
            budget -= count
            self.extend_by(self._drawn(count))
            if progress is not None:
                progress(self.size)

    def extend_by(self, draws: Array) -> None:
        """As many iterations of Algorithm 1 with the states (k, n), the same as `extend` one by one and faster."""
        i = 0
        while i < len(draws):
            before = i
            i, status = self._grown(draws, i)
            self.draws += i - before
            if status == ASK:
                if i < len(draws):
                    self.extend(draws[i])
                i += 1
            elif status != DONE:
                self._relax()

    def _grown(self, draws: Array, i: int) -> tuple[int, int]:
        """The draws from i on in compiled code: how many have been dealt with, and what comes next."""
        if self._compiled is None:
            return i, ASK
        values = np.array(self._compiled.numbers)
        given = (self._propose, self._places, self._vertices, draws, i, self._remembering, values, self.rules)
        return cast(tuple[int, int], grow(*given))

    @cached_property
    def _propose(self) -> Any:
        """The address of its `proposer`."""
        nearest, connect, numbers = cast(Compiled, self._compiled)
        known, straight = (self._remembering, np.array(numbers)), np.empty(self.homology.M)
        given = (self._vertices, 1, self.states[0], *known, True, False, straight)
        return address_of(proposer(nearest, connect, len(numbers), self.steering.motion.kernels), given)

    def aim(self, x: Array) -> None:
        """From now on draw what is of use to a robot at x (n,), where that makes a difference (`Steering.draws`)."""
        self.origin = np.array(x, dtype=float)
        self.__dict__.pop("_offers", None)

    def reserve(self, vertices: int) -> None:
        """Make room for about so many vertices at once, lest growth stop for it later, or to be compiled."""
        self._grown(self.states[:0], 0)
        more = 1.5 * vertices / self.size  # a vertex of a larger tree has more neighbours
        while len(self.states) < vertices:
            self._double_vertices()
        self._make_room(int(more * self.graph.size[1]), int(more * self.graph.size[4]))

    def extend(self, x: Array) -> bool:
        """One iteration of Algorithm 1 with the state x (n,); whether it became a vertex."""
        self.draws += 1
        if not self.around.checker.point_free(x):
            return False
        straight, out = self.around.straight(x), NO_EDGES
        root = bool(self.space.scene.goal.contains(x[:2]))
        if not root:
            out = self.around.edges_from(x, self._first(self.size))
            if not reaches(self._places, straight, out, self.rules):
                return False
        v = self._write(x, root=root)
        back = self.around.edges_to(self._first(v + 1)) if root or not self.rules.mirrored else out
        self._insert(straight, out, back)
        self._relax()
        return True

    def references(
        self,
        x: Array,
        *,
        polished: bool = True,
        before: Mapping[tuple[int, ...], Motions] | None = None,
        pressed: Callable[[], bool] = lambda: False,
        threads: int = 1,
        most: int | None = None,
    ) -> list[Reference]:
        """The best path of every allowed class from x (n,), least [cost] first; the tree is not changed (Algorithm 5).

        Args:
            x: a state of the system, of which vertices may have but a part (`Steering.vertex_of`).
            before: polished paths by winding, from a state not far from x: where that is faster shortening goes on from
                them, unless the tree's own path is cheaper even before it is shortened. Of other classes in space and
                time only the cheapest few are then polished at once.
            pressed: whether time is short; then paths of such other classes stay as the tree has them.
            threads: among which work is shared out; what is found does not depend on it.
            most: classes that are looked at, those that seem cheapest before paths are shortened; None: all.

        Raises:
            NoReference: no allowed class reaches the goal from x.
        """
        x = self.steering.vertex_of(x)
        return self._asked.references(x, polished=polished, before=before, pressed=pressed, threads=threads, most=most)

    def lengths(self, x: Array) -> dict[tuple[int, ...], float]:
        """Length [m] of the tree's own best path of every allowed class from x (n,), by winding; empty if none."""
        try:
            return {found.winding: found.length for found in self.references(x, polished=False)}
        except NoReference:
            return {}

    def at(self, x: Array, time: float) -> Array:
        """State to query it at, for a system's state x (n,) at a time [s]."""
        return self.steering.at(x, time)

    def too_fast(self, x: Array) -> bool:
        """Whether a state (n,) of the system that has no reference would have one at rest."""
        x = self.steering.vertex_of(x)
        rest = self.steering.at_rest(x)
        return not np.array_equal(rest, x) and bool(self.lengths(rest))

    def path_of(self, vertex: int, slot: int) -> list[int]:
        """Vertices from a node to its root, first to last (ReconstructPath)."""
        return self._asked.path_of(vertex, slot)

    def __repr__(self) -> str:
        scene, rules = shown.name(self.space.scene.name), self.rules
        counts = f"{self.size} vertices, {self.node_count} nodes"
        return (
            f"HomologyTree({counts} in {scene}, |1 - H| <= {rules.limit:g}, {rules.classes or 'all'} classes a vertex)"
        )

    def plot(self, x: Array | None = None, *, axes: Any = None) -> Any:
        """Draw the best edge of every vertex on a map of the scene.

        Args:
            x: a state (n,) from which the reference of every class is drawn too.
            axes: of matplotlib, to draw on; without them a new figure is made.

        Returns:
            the axes.

        Raises:
            OptionError: matplotlib is not installed.
            NoReference: no allowed class reaches the goal from x.
        """
        return tree_plot.draw(self, x, axes)

    @cached_property
    def passages(self) -> Passages:
        """Where obstacles face each other with room for the robot between."""
        return find_passages(self.space.field, self.space.collision)

    # -- growing -----------------------------------------------------------------------------------------------

    @cached_property
    def _offers(self) -> PassageSampler:
        return PassageSampler(self.steering.offers(self.passages, self.space, self.origin))

    def _drawn(self, count: int) -> Array:
        """States (count, n) of the next draws: in passages that have no vertex yet, or random."""
        offered = [self._offers.at(self.draws + k) for k in range(count)]
        random = [k for k, x in enumerate(offered) if x is None]
        drawn = np.empty((count, self.states.shape[1]))
        drawn[random] = self.steering.draws(self.space, self.rng, len(random), self.origin, GOAL_SHARE)
        for k, x in enumerate(offered):
            if x is not None:
                drawn[k] = x
        return drawn

    @property
    def _vertices(self) -> Vertices:
        return Vertices(self.states, self.in_goal)

    @property
    def _asked(self) -> ReferenceQuery:
        vertices = self._first(self.size)
        return ReferenceQuery(around=self.around, rules=self.rules, places=self._places, vertices=vertices)

    def _first(self, count: int) -> Vertices:
        """So many of the vertices, written but not yet inserted ones included."""
        return Vertices(self.states[:count], self.in_goal[:count])

    def _write(self, x: Array, *, root: bool) -> int:
        """Write a state where the next vertex will be; its index."""
        v = self.size
        if v >= len(self.states):
            self._double_vertices()
        self.states[v], self.in_goal[v] = x, root
        return v

    def _insert(self, straight: Array, out: Edges, back: Edges) -> None:
        """Make the state that has been written a vertex."""
        self._make_room(len(out.near) + len(back.near), len(out.turns.marker) + len(back.turns.marker))
        insert(self._places, self._vertices, straight, out, back, self.around.checker.around, self.rules)

    def _double_vertices(self) -> None:
        self.graph = g.doubled(self.graph, g.VERTICES + g.NODES)
        self.states = np.vstack([self.states, np.zeros_like(self.states)])
        self.in_goal = np.concatenate([self.in_goal, np.zeros_like(self.in_goal)])

    def _make_room(self, edges: int, pairs: int) -> None:
        while self.graph.size[1] + edges > len(self.graph.tail):
            self.graph = g.doubled(self.graph, g.EDGES)
        while self.graph.size[4] + pairs > len(self.graph.edge_marker):
            self.graph = g.doubled(self.graph, g.EDGE_PAIRS)

    def _relax(self) -> None:
        while (status := relax(self._places, self.rules)) != DONE:
            self.graph = g.doubled(self.graph, *MORE[status])
