"""Connect two states optimally without obstacles (the paper's TPBVP)."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.checks import checked_state
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.geometry.space import StateKernels, at_states
from pirrht.jit.jit import as_tuple, borrowing, inlined
from pirrht.steering.chain import cheapest_chain, compiled_chain, plain_chain, resumed
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.motion import ARCS, MotionKernels, MotionKind, Motions, Surroundings, Trajectory
from pirrht.steering.polyline import taut_lines
from pirrht.topology.signature import Signature


@inlined
def along_axes(x, move, step, numbers, out):  # type: ignore[no-untyped-def]
    """Write x (n,) after a step along one of its axes to out (n,)."""
    for k in range(out.shape[0]):
        out[k] = x[k]
    out[move // 2] += step * (1 - 2 * (move % 2))


class SteeringKernels(NamedTuple):
    """Kernels of a steering method, by which trees grow in compiled code; both take its `numbers`."""

    nearest: Callable[..., None]  # of `nearest_with`
    optimum: Callable[..., Any]  # (tails (k, n), heads (k, n), numbers): the optimal motions


class Steering(ABC):
    """Optimal motions of the deterministic system without obstacles, and their costs.

    One along arcs at one speed also has `speed` [m/s], `cost_per_meter` and `controls(heading, curvature)`, the (l, m)
    that drive pieces starting at headings (l,) [rad] with curvatures (l,) [1/m]. Another names its kind of motion.
    """

    n: int  # states of a vertex; the position [m] comes first
    heading: int | None = None  # index of a vertex' heading [rad], if it has one
    symmetric: bool = False  # whether every motion may be driven the other way round at the same cost
    drives: bool = True  # whether references come with the controls that drive them; else proposals must find those ...
    m: int  # ... (m,), and the system
    slack: float  # may take this time to get under way [s]
    min_neighbours: int = 0  # least number of vertices to which a reference is looked for
    timed: bool = False  # whether vertices have a time, so that its paths may go among moving obstacles
    several: bool = False  # whether several paths of a class are shortened, since they may end in different optima
    motion: MotionKind = ARCS  # kind of what `connect` makes
    # (x (n,), move, step, numbers, out (n,)): write the state after one of `moves` of a pattern search over vertices
    shift: ClassVar[Callable[..., None]] = along_axes

    moves = property(lambda self: 2 * self.n, doc="Number of moves that `shift` knows.")
    resumes = property(
        lambda self: not self.drives or self.motion is not ARCS,
        doc="Whether paths are shortened much faster from an earlier path of the class.",
    )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the parameters of its kernels; here none."""
        return ()

    @property
    def alternatives(self) -> tuple["Steering", ...]:
        """Return methods for the same vertices whose paths lead to other local optima of a class; here none."""
        return ()

    @property
    def kernels(self) -> SteeringKernels | None:
        """Return the kernels by which trees grow in compiled code; here None: they grow in Python."""
        return None

    @abstractmethod
    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost of the obstacle-blind optimum, tails to heads, (..., n) x 2 -> (...,) [cost]. Need not be symmetric."""

    @abstractmethod
    def connect(self, tails: Array, heads: Array) -> Motions:
        """Return the k optimal motions from tails (k, n) to heads (k, n) (the paper's TPBVP): along arcs, `Curves`."""

    @abstractmethod
    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """Draw a state (n,) of the workspace, x and y first [m] (the paper's Sampling)."""

    @abstractmethod
    def roots(self, goal: Array) -> Array:
        """Return the states (k, n) at the goal point (2,) [m] that the tree starts from."""

    def states_in(self, space: FreeSpace) -> StateKernels:
        """Return kernels of its vertices for the footprint of an examined scene."""
        return at_states(space.static.kernels, self.reads(space))

    def reads(self, space: FreeSpace) -> tuple[int, ...]:
        """Return indices of a vertex' numbers that the footprint of an examined scene reads."""
        heading = (self.heading,) if space.static.kernels.turns and self.heading is not None else ()
        return (*range(space.static.kernels.position), *heading)

    def homology(self, space: FreeSpace) -> Signature:
        """Signature of its paths in an examined scene; here about static obstacles only."""
        return space.homology.static

    def surroundings(self, space: FreeSpace) -> Any:
        """Collect what the kernels of its motions take of an examined scene (`Surroundings`)."""
        return Surroundings.of(space, self.homology(space))

    def checker(self, space: FreeSpace) -> EdgeChecker:
        """Make the judge of its motions in an examined scene."""
        return EdgeChecker(space=space, around=self.surroundings(space), motion=self.motion)

    def shorten(self, path: Any, checker: EdgeChecker) -> Any:
        """Shorten a path of consecutive motions into the goal inside its class, certified, at no more cost.

        Here a polyline by its corners, and any other path by the cheapest chain of connections (`steering.chain`).
        """
        if self.motion is ARCS and self.n == 2 and not np.any(path.curvature):
            return taut_lines(path, self.connect, checker)
        found = self.chain(checker.kernels, self.states_in(checker.space))
        return cheapest_chain(path, self.connect, found, self.numbers, self.moves, checker)

    def chain(self, motion: MotionKernels, states: StateKernels) -> Callable[..., Array]:
        """Build what `shorten` calls for paths that bend, by kernels of motions and vertices; here in plain Python."""
        return plain_chain(self.distance, self.connect, motion, states, type(self).shift)

    def resume(self, x: Array, path: Any, checker: EdgeChecker) -> Any:
        """Find the cheapest path from x (n,) near an earlier one into the goal, in any class; None if there is none."""
        return resumed(x, path, self.connect, checker)

    def at(self, x: Array, time: float) -> Array:
        """Return the state to query a tree at, for a system's state x (n,) at a time [s]; here without the time."""
        return x

    def vertex_of(self, x: Array) -> Array:
        """Take the part of a system's state (..., n) that a vertex of the tree has; here all of it."""
        return x

    def checked(self, x: Any, time: float | None = None) -> Array:
        """Take what a vertex has of a system's state (n,) `at` a time, or of one with it; OptionError: it is none."""
        try:
            state = np.asarray(x, dtype=float)
            x = self.vertex_of(state if time is None else self.at(state, time))
        except (TypeError, ValueError, IndexError):
            pass  # it is refused by what it is
        return checked_state(x, self.n, type(self).__name__)

    def at_rest(self, x: Array) -> Array:
        """Return a vertex' state (n,) without its speed; here unchanged, since a vertex has none."""
        return x

    def states_along(self, path: Array, scene: Scene) -> Array:
        """Return states (l, n) both ways along points and headings (k, 3) [m, m, rad], with the rest drawn."""
        rng = np.random.default_rng(0)
        states = np.array([self.sample(scene, rng) for _ in path]).reshape(-1, self.n)
        states[:, :2] = path[:, :2]
        return states

    def draws(
        self, space: FreeSpace, rng: np.random.Generator, count: int, origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:  # fmt: skip
        """Draw states (count, n) of an examined scene for a tree, equal in parts and at once; here uniform ones.

        `origin` (n,) is where the robot is; None: the start. A `goal_share` of them is moved into the goal's disc.
        """
        drawn = np.empty((count, self.n))
        for x in drawn:
            x[:] = self.sample(space.scene, rng)
            if rng.random() < goal_share:
                angle = rng.uniform(-np.pi, np.pi)
                x[:2] = space.scene.goal.center + (space.scene.goal.radius * np.sqrt(rng.random())) * np.array(
                    [np.cos(angle), np.sin(angle)]
                )
        return drawn

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """Return states (l, n) that a tree draws first, from an origin (n,) or the start; here along passages."""
        return self.states_along(passages.axis, space.scene)

    def nearest(self, states: Array, x: Array, count: int, *, forward: bool) -> NDArray[np.int64]:
        """Find the `count` states of (k, n) that cost least to reach from x (n,) (forward) or to come from.

        Indices, cheapest first, (count,) or (k,) if those are fewer; the paper's NearForward and NearBackward.
        """
        return np.argsort(self.distance(x, states) if forward else self.distance(states, x), kind="stable")[:count]

    def trajectory(self, path: Any) -> Trajectory:
        """Return controls (l, m) along a path of consecutive motions, 0 if they are unknown, and durations (l,) [s]."""
        found = self.motion.trajectory(self, path)
        if self.drives:
            return found
        return replace(found, controls=np.zeros((len(found.durations), self.m)), slack=self.slack)


class CompiledSteering(Steering):
    """A steering method by two kernels of parameters `numbers`."""

    # (tail, head, numbers, limit): cost of the optimum between states, tuples (n,); any number above `limit` may be
    # infinity instead. Inlined.
    cost: ClassVar[Callable[..., float]]
    optimum: ClassVar[Callable[..., Any]]  # (tails (k, n), heads (k, n), numbers): the optimal motions

    @property
    @abstractmethod
    def numbers(self) -> tuple[float, ...]:
        """Return the parameters of both kernels."""

    @property
    def kernels(self) -> SteeringKernels:
        """Return the kernels by which trees grow in compiled code."""
        return SteeringKernels(nearest_with(type(self).cost, self.n), type(self).optimum)

    def chain(self, motion: MotionKernels, states: StateKernels) -> Callable[..., Array]:
        """Build what `shorten` calls for paths that bend, by kernels of motions and vertices, in compiled code."""
        kind = type(self)
        return compiled_chain(kind.cost, kind.optimum, motion, states, kind.shift, self.n)

    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost of the obstacle-blind optimum, tails to heads, (..., n) x 2 -> (...,) [cost]."""
        tails, heads = (np.array(states, dtype=float) for states in np.broadcast_arrays(tails, heads))
        return np.asarray(self.connect(tails, heads).cost.reshape(tails.shape[:-1]))

    def connect(self, tails: Array, heads: Array) -> Any:
        """Return the k optimal motions from tails (k, n) to heads (k, n) (the paper's TPBVP)."""
        tails, heads = (np.ascontiguousarray(one, dtype=float).reshape(-1, self.n) for one in (tails, heads))
        return type(self).optimum(tails, heads, self.numbers)

    def nearest(self, states: Array, x: Array, count: int, *, forward: bool) -> NDArray[np.int64]:
        """Find the `count` states of (k, n) that cost least to reach from x (n,) (forward) or to come from."""
        chosen = np.empty(min(count, len(states)), dtype=np.int64)
        nearest_with(type(self).cost, self.n)(states, x, self.numbers, forward, chosen, np.empty(len(chosen)))
        return chosen


@cache
def nearest_with(cost: Callable[..., float], n: int) -> Callable[..., None]:
    """Build the kernel (states (k, n), x (n,), numbers, forward, chosen (c,), least (c,)) of `Steering.nearest`."""

    @borrowing
    def nearest(states, x, numbers, forward, chosen, least):  # type: ignore[no-untyped-def]
        """Write indices of the states of least cost and these costs, cheapest first; of equal ones the earlier."""
        count = chosen.shape[0]
        found = 0
        here = as_tuple(x, n)

        for i in range(states.shape[0]):
            limit = least[count - 1] if found == count else np.inf
            there = as_tuple(states[i], n)
            d = cost(here, there, numbers, limit) if forward else cost(there, here, numbers, limit)
            if found == count and not d < least[count - 1]:
                continue
            found = min(found + 1, count)
            at = found - 1
            while at > 0 and least[at - 1] > d:
                least[at] = least[at - 1]
                chosen[at] = chosen[at - 1]
                at -= 1
            least[at], chosen[at] = d, i

    return cast(Callable[..., None], nearest)
