"""The expansion phase: Algorithms 1 to 3 of the paper grow a goal-rooted tree in the H-augmented space.

Comments give the paper's lines. Draws of which nothing is doubtful run through the same steps in one kernel,
`expand.grow`. Costs that a new vertex changes are relaxed by `rewire.relax`.
"""

import reprlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from numbers import Integral
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.jit.jit import address_of, mapped
from pirrht.planner import references
from pirrht.planner.expand import PassageSampler, growing, insert, near_count, proposer
from pirrht.planner.graph import SIZE, STATUS, Graph, Storage
from pirrht.planner.references import Reference
from pirrht.planner.rewire import SearchRules, reaches, relax
from pirrht.planner.tuning import TUNING, PlannerTuning
from pirrht.steering.edges import NO_EDGES, Edges, concatenated
from pirrht.steering.motion import Motions
from pirrht.steering.steering import Steering


class HomologyTree:
    """RRG on the state space with at most one node per allowed class at each vertex.

    Of `states` (V, n) and `in_goal` (V,) the first `size` rows count; `draws` counts iterations of Algorithm 1.

    Args:
        space: the examined scene.
        steering: the obstacle-blind two-point optimum, which names the signature of its paths as well.
        limit: H_limit [turns] of the allowed set |1 - H_i| <= H_limit, checked at every vertex.
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
        OptionError: the limit is not positive, classes is negative, or the steering has no roots.
    """

    def __init__(
        self, space: FreeSpace, steering: Steering, *, limit: float = 0.6, classes: int = 16, rng: np.random.Generator,
        tuning: PlannerTuning = TUNING,
    ) -> None:  # fmt: skip
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

        self.space = space
        self.steering = steering
        self.rng = rng
        self.tuning = tuning

        self.homology = steering.homology(space)
        self.rules = SearchRules(
            float(limit),
            int(classes),
            limit >= self.homology.most_base,
            bool(steering.symmetric),
            asks=space.grain is None,
        )
        self.checker = steering.checker(space)
        self.storage = Storage(steering.n, self.homology.M, classes)
        self.draws = 0
        self.origin: Array | None = None  # where the robot is, (n,), as draws take it; None: at the scene's start
        self._passages: Passages | None = None
        self._passage_sampler: PassageSampler | None = None
        for x in roots:
            self.storage.write(x, True)
            self._insert(x, NO_EDGES, NO_EDGES)

    # -- Algorithm 1: Expansion ------------------------------------------------------------------------------------

    def grow(
        self, vertices: int, *, progress: Callable[[int], None] | None = None,
        enough: Callable[[int], bool] | None = None,
    ) -> None:  # fmt: skip
        """Grow until the tree has so many vertices, with at most 50 draws for each (Algorithm 1).

        Passages are drawn first, and again until they are vertices; at least every second draw is uniform. `progress`
        is called with the number of vertices after every batch of draws, `enough` after every few; true: it grows no
        more. OptionError: the number is negative or not whole.
        """
        if not (isinstance(vertices, Integral) and vertices >= 0):
            raise OptionError(f"vertices is {reprlib.repr(vertices)}; it must be a whole number of 0 or more")
        budget = self.tuning.draws_per_vertex * max(0, vertices - self.size)
        most = budget if enough is None else self.tuning.draws_in_time
        while self.size < vertices and budget > 0:  # line 2
            if enough is not None and enough(self.size):
                return
            self._passage_draws.note(self.states[: self.size])
            count = min(vertices - self.size, budget, most, self._passage_draws.together(self.draws))
            budget -= count
            self.extend_by(self._sampling(count))  # line 3
            if progress is not None:
                progress(self.size)

    def extend_by(self, draws: Array) -> None:
        """Expand by each of the states (k, n) in turn; in compiled code, as far as that can decide."""
        i = 0
        while i < len(draws):
            before = i
            i, status = self._grown(draws, i)
            self.draws += i - before
            if status == STATUS.ask:
                if i < len(draws):
                    self.extend(draws[i])
                i += 1
            elif status != STATUS.done:
                self.relax()

    def extend(self, x: Array) -> bool:
        """Expand by a random state x (n,); return whether it became a vertex (Algorithm 1, lines 4 to 12)."""
        self.draws += 1
        if not self.space.free(x, self.steering.reads(self.space)):
            return False
        root = self.space.in_goal(x)  # line 4
        edges = NO_EDGES  # line 5: AddRoot
        if not root:
            edges = self.edges_from(x)  # line 7
            if not reaches(self.storage.places, self.homology.base(x), edges, self.rules):  # line 9
                return False
        v = self.storage.write(x, root)
        back = self.edges_to(v) if root or not self.rules.mirrored else edges  # line 11
        self._insert(x, edges, back)  # line 10
        self.relax()  # Algorithm 2, lines 6 to 8; Algorithm 3, lines 8 to 17
        return True

    def _sampling(self, count: int) -> Array:
        """Draw states (count, n): in passages that have no vertex yet, or random (Sampling)."""
        offered = [self._passage_draws.at(self.draws + k) for k in range(count)]
        uniform = sum(x is None for x in offered)
        drawn = iter(self.steering.draws(self.space, self.rng, uniform, self.origin, self.tuning.goal_share))
        return np.array([next(drawn) if x is None else x for x in offered])

    def _insert(self, x: Array, edges: Edges, back: Edges) -> None:
        """Make the state x (n,) that was written last a vertex, with edges from it and to it."""
        storage = self.storage
        more = len(edges.near) + len(back.near)
        pairs = len(edges.turns.marker) + len(back.turns.marker)
        storage.make_room(E=self.graph.size[SIZE.edges] + more, P=self.graph.size[SIZE.pairs] + pairs)
        insert(storage.places, storage.vertices, self.homology.base(x), edges, back, self.checker.around, self.rules)

    def relax(self) -> None:
        """Relax costs until no node improves (`rewire.relaxed`)."""
        while (status := relax(self.storage.places, self.rules)) != STATUS.done:
            self.storage.double(status)

    # -- Algorithm 2: ChooseParent ---------------------------------------------------------------------------------

    def edges_from(self, x: Array, least: int = 0, threads: int = 1, steering: Steering | None = None) -> Edges:
        """Judge edges from x (n,) to at least so many near vertices (Algorithm 2); `relax` does AppendNode.

        They may be those of another steering.
        """
        near = self._near(x, self.states[: self.size], forward=True, least=least)  # line 1
        connect = (steering or self.steering).connect

        def edges(near: NDArray[np.int64]) -> Edges:
            motions = connect(np.repeat(x[None], len(near), axis=0), self.states[near])  # line 3: TPBVP
            return self.checker.inspect(motions, self.in_goal[near], near)  # lines 4 and 5: ObstacleFree

        if threads == 1 or len(near) < self.tuning.shared_edges:
            return edges(near)
        return concatenated(mapped(edges, np.array_split(near, 2 * threads), threads))

    # -- Algorithm 3: Rewire ---------------------------------------------------------------------------------------

    def edges_to(self, v: int) -> Edges:
        """Judge edges to vertex v from the vertices near it (Algorithm 3, lines 1 to 7); lines 8 to 17 are `relax`."""
        x = self.states[v]
        near = self._near(x, self.states[: v + 1], forward=False)  # line 1
        near = near[(near != v) & ~self.in_goal[near]]
        motions = self.steering.connect(self.states[near], np.repeat(x[None], len(near), axis=0))  # line 3: TPBVP
        return self.checker.inspect(motions, np.full(len(near), self.in_goal[v]), near)  # lines 4 and 5: ObstacleFree

    def _near(self, x: Array, states: Array, *, forward: bool, least: int = 0) -> NDArray[np.int64]:
        """Find vertices near x (n,) among states (V, n), at least so many (NearForward and NearBackward)."""
        return self.steering.nearest(states, x, max(near_count(len(states), self.steering.n), least), forward=forward)

    # -- Algorithm 5: ExtractReference -----------------------------------------------------------------------------

    def references(
        self, x: Array, *, shortened: bool = True, before: Mapping[tuple[int, ...], Motions] | None = None,
        over_budget: Callable[[], bool] = lambda: False, threads: int = 1, most: int | None = None,
        hopeless: Callable[[float], float] | None = None,
    ) -> list[Reference]:  # fmt: skip
        """Best path of every allowed class from x (n,), least [cost] first; the tree is not changed (Algorithm 5).

        Args:
            x: a state of the system, of which vertices may have but a part (`Steering.vertex_of`).
            shortened: shorten paths inside their class.
            before: shortened paths by winding, from a state not far from x: where that is faster shortening goes on
                from them, unless the tree's own path is cheaper even before it is shortened. Of other classes in space
                and time only the cheapest few are then shortened at once.
            over_budget: whether time is short; then paths of such other classes stay as the tree has them.
            threads: among which work is shared out; the result does not depend on it.
            most: classes that are evaluated, those that seem cheapest before paths are shortened; None: all.
            hopeless: cost from which on a class weighs nothing, by the least cost of all. Paths that cannot become so
                cheap stay as the tree has them; None: all are shortened.

        Raises:
            NoReference: no allowed class reaches the goal from x.
            OptionError: x is no state.
        """
        x = self.steering.checked(x)
        query = references.ReferenceQuery(
            self, self.steering, shortened, before or {}, over_budget, threads, most, hopeless
        )
        return query.extract(x)

    def with_alternatives(self, x: Array, found: Sequence[Reference], threads: int = 1) -> list[Reference]:
        """Return references from x (n,) with paths of their classes by `Steering.alternatives` of the tree's."""
        if not self.steering.alternatives:
            return [*found]
        x = self.steering.checked(x)
        others = list[Reference]()
        for steering in self.steering.alternatives:
            query = references.ReferenceQuery(self, steering, True, {}, lambda: False, threads, None, None)
            with suppress(NoReference):
                others += query.extract(x)
        own = {one.winding: tuple(o.trajectory for o in others if o.winding == one.winding) for one in found}
        return [replace(one, alternatives=own[one.winding]) for one in found]

    def at(self, x: Array, time: float) -> Array:
        """State to query the tree at, for a system's state x (n,) at a time [s]."""
        return self.steering.at(x, time)

    def lengths(self, x: Array) -> dict[tuple[int, ...], float]:
        """Length [m] of the tree's own best path of every allowed class from x (n,), by winding; empty if none."""
        try:
            return {found.winding: found.length for found in self.references(x, shortened=False)}
        except NoReference:
            return {}

    def too_fast(self, x: Array) -> bool:
        """Return whether a state (n,) of the system that has no reference would have one at rest."""
        if self.steering.timed:  # vertices have no speed
            return False
        x = self.steering.checked(x)
        rest = self.steering.at_rest(x)
        return not np.array_equal(rest, x) and bool(self.lengths(rest))

    def path_of(self, vertex: int, slot: int) -> list[int]:
        """Vertices from a node to its root, first to last (ReconstructPath)."""
        return cast(list[int], references.path_of(self.storage.places, vertex, slot).tolist())

    # -- the rest --------------------------------------------------------------------------------------------------

    def aim(self, x: Array) -> None:
        """From now on draw what is of use to a robot at x (n,), where that makes a difference (`Steering.draws`)."""
        self.origin = np.array(x, dtype=float)
        self._passage_sampler = None  # what it offers depends on where the robot is

    def reserve(self, vertices: int) -> None:
        """Make room for about so many vertices at once, lest growth stop for it later, or to be compiled."""
        self._grown(self.states[:0], 0)
        more = 1.0 + 1.5 * vertices / self.size  # a vertex of a larger tree has more neighbours
        self.storage.make_room(
            V=vertices, E=int(more * self.graph.size[SIZE.edges]), P=int(more * self.graph.size[SIZE.pairs])
        )

    def _grown(self, draws: Array, i: int) -> tuple[int, int]:
        """Handle the draws from i on in compiled code: how many have been handled, and what comes next."""
        if self.steering.kernels is None:
            return i, STATUS.ask
        values = np.array(self.steering.numbers)
        at = (self.storage.places, self.storage.vertices)

        grow = growing(self.steering.states_in(self.space).certify)
        return cast(tuple[int, int], grow(self._propose, *at, draws, i, self.checker.around, values, self.rules))

    @cached_property
    def _propose(self) -> Any:
        """Address of its `proposer`."""
        kernels = self.steering.kernels
        assert kernels is not None
        numbers = np.array(self.steering.numbers)
        straight = np.empty(self.homology.M)
        given = (self.storage.vertices, 1, self.states[0], self.checker.around, numbers, True, False, straight)
        propose = proposer(
            kernels.nearest, kernels.optimum, len(numbers), self.checker.kernels, self.homology.table.kernels
        )
        return address_of(propose, given)

    @property
    def passages(self) -> Passages:
        """Passages between obstacles that face each other with clearance for the robot, found when first asked for.

        Those of another tree may be given, if its static obstacles are the same.
        """
        if self._passages is None:
            self._passages = self.space.passages()
        return self._passages

    @passages.setter
    def passages(self, found: Passages) -> None:
        self._passages = found
        self._passage_sampler = None

    @property
    def _passage_draws(self) -> PassageSampler:
        if self._passage_sampler is None:
            self._passage_sampler = PassageSampler(self.steering.offers(self.passages, self.space, self.origin))
        return self._passage_sampler

    graph = property(lambda self: cast(Graph, self.storage.places.graph), doc="Replaced by a larger one when full.")
    states = property(lambda self: cast(Array, self.graph.states), doc="States of vertices, (V, n).")
    in_goal = property(lambda self: self.graph.in_goal, doc="Whether a vertex is a root, (V,).")
    size = property(lambda self: int(self.graph.size[SIZE.vertices]), doc="Number of vertices.")
    limit = property(lambda self: cast(float, self.rules.limit), doc="H_limit of the allowed set [turns].")
    classes = property(lambda self: cast(int, self.rules.classes), doc="The most classes of a vertex; 0: all.")
    node_count = property(lambda self: int(self.graph.nodes[: self.size].sum()), doc="All classes of all vertices.")

    def __repr__(self) -> str:
        scene = formatting.name(self.space.scene.name)
        counts = f"{self.size} vertices, {self.node_count} nodes"
        classes = f"{self.rules.classes or 'all'} classes a vertex"

        return f"HomologyTree({counts} in {scene}, |1 - H| <= {self.rules.limit:g}, {classes})"

    def plot(self, x: Array | None = None, *, axes: Any = None) -> Any:
        """Draw the best edge of every vertex on a map of the scene, and the references of a state x (n,).

        Returns matplotlib's axes, new ones unless they are given; in space those of the view from above, over one from
        the south. OptionError: it is not installed; NoReference.
        """
        from pirrht.plotting import maps
        from pirrht.plotting.colors import ClassColors
        from pirrht.plotting.tuning import TUNING as PLOTTING

        references = [] if x is None else self.references(x)
        views = maps.of(self.space, 0.0, axes, "tree.plot")
        edges = self.best_edges(PLOTTING.spacing)
        colors = ClassColors(one.id for one in references)
        paths = [one.trajectory for one in references]
        labels = [f"{formatting.turns(one.id)}: {one.cost:.3g}" for one in references]
        hues = [colors[one.id] for one in references]
        for view, seen in views:
            drawn = [edge[:, list(seen)] for edge in edges]
            maps.lines(view, drawn, maps.TREE, width=0.4, opacity=0.6, zorder=2)
            maps.classes(view, self.space.scene.body, paths, labels, hues, seen, title="class: cost")
        axes = views[0][0]
        axes.set_title(f"{maps.literal(self.space.scene.name)}: {self.size} vertices", fontsize=10)
        return axes

    def best_edges(self, spacing: float) -> list[Array]:
        """Return the edge that each vertex' cheapest node takes as a line (k, 2) of points at a spacing [m]."""
        graph = self.graph
        tails = np.flatnonzero(graph.nodes[: self.size] > 0)
        costs = np.where(np.arange(graph.cost.shape[1]) < graph.nodes[tails, None], graph.cost[tails], np.inf)
        taken = graph.parent[tails, np.argmin(costs, axis=1)]
        tails = tails[taken >= 0]
        heads = graph.head[taken[taken >= 0]]
        return self.steering.connect(self.states[tails], self.states[heads]).points(spacing) if len(tails) else []
