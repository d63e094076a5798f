"""Connect two states optimally without obstacles (the paper's TPBVP)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.passages import Passages
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined
from pirrht.steering.along_arcs import ARCS
from pirrht.steering.motion import Motion, Motions, Surroundings
from pirrht.steering.trajectory import Trajectory


class Compiled(NamedTuple):
    """A steering method as kernels, for growth that need not come back to Python."""

    nearest: Callable[..., None]  # (states (k, n), x (n,), numbers, forward, chosen (c,), work (c,)): as `nearest`
    connect: Callable[..., Any]  # (tails (k, n), heads (k, n), numbers): optimal motions as the record of their kernels
    numbers: tuple[float, ...]  # what both read


class Steering(ABC):
    """Optimal motions of the deterministic system without obstacles, and their costs.

    One along arcs at one speed also has `speed` [m/s], `cost_per_meter` and `controls(heading, curvature)`, the (l, m)
    that drive pieces starting at headings (l,) [rad] with curvatures (l,) [1/m]. Another names its kind of motion.
    """

    n: int  # states of a vertex; the first two are the position [m]
    symmetric: bool = False  # whether every motion may be driven the other way round at the same cost
    drives: bool = True  # whether references come with the controls that drive them; else guides must find those
    asked: int = 0  # how many vertices a reference is looked for from at least
    timed: bool = False  # whether vertices have a time, so that its paths may go among moving obstacles
    motion: Motion = ARCS  # what `connect` makes

    @abstractmethod
    def distance(self, tails: Array, heads: Array) -> Array:
        """Cost of the obstacle-blind optimum, tails to heads, (..., n) x 2 -> (...,) [cost]. Need not be symmetric."""

    @abstractmethod
    def connect(self, tails: Array, heads: Array) -> Motions:
        """The k optimal motions from tails (k, n) to heads (k, n) (the paper's TPBVP): along arcs, `Curves`."""

    @abstractmethod
    def sample(self, scene: Scene, rng: np.random.Generator) -> Array:
        """A random state (n,) of the workspace, x and y first [m] (the paper's Sampling)."""

    @abstractmethod
    def roots(self, goal: Array) -> Array:
        """States (k, n) at the goal point (2,) [m] that the tree starts from."""

    def homology(self, space: FreeSpace) -> Any:
        """Signature of its paths in an examined scene (`Signature`); here about static obstacles only."""
        return space.homology.static

    def surroundings(self, space: FreeSpace) -> Any:
        """Collect what the kernels of its motions take of an examined scene (`Surroundings`)."""
        return Surroundings.of(space)

    def remembering(self, around: Any) -> Any:
        """Add a cache for a growing graph to surroundings; for one thread at a time."""
        return around

    def at(self, x: Array, time: float) -> Array:
        """State to query a tree at, for a system's state x (n,) at a time [s]; here without the time."""
        return x

    def vertex_of(self, x: Array) -> Array:
        """Take the part of a system's state (..., n) that a vertex of the tree has; here all of it."""
        return x

    def backwards(self, x: Array) -> Array | None:
        """Return the state (n,) whose paths `reversing` turns into such from x (n,); None: nothing reverses."""
        return None

    def reversing(self, trajectory: Trajectory) -> Trajectory:
        """Drive a trajectory backwards, from the state that faces the other way."""
        return trajectory

    def at_rest(self, x: Array) -> Array:
        """Return a vertex' state (n,) without its speed; here unchanged, since a vertex has none."""
        return x

    def states_along(self, way: Array, scene: Scene) -> Array:
        """States (l, n) that lead both ways along a path of points and headings (k, 3) [m], [m], [rad].

        Here all but the position is drawn, from one seed; steering methods with headings override it.
        """
        rng = np.random.default_rng(0)
        states = np.array([self.sample(scene, rng) for _ in way]).reshape(-1, self.n)
        states[:, :2] = way[:, :2]
        return states

    def draws(
        self,
        space: FreeSpace,
        rng: np.random.Generator,
        count: int,
        origin: Array | None = None,
        goal_share: float = 0.0,
    ) -> Array:
        """Draw states (count, n) of an examined scene for a tree, equal in parts and at once; here uniform ones.

        Args:
            origin: where the robot is, (n,); None: at the scene's start.
            goal_share: share of them that is moved into the goal's disc.
        """
        goal, drawn = space.scene.goal, np.empty((count, self.n))
        for x in drawn:
            x[:] = self.sample(space.scene, rng)
            if rng.random() < goal_share:
                angle, radius = rng.uniform(-np.pi, np.pi), goal.radius * np.sqrt(rng.random())
                x[:2] = goal.center + radius * np.array([np.cos(angle), np.sin(angle)])
        return drawn

    def offers(self, passages: Passages, space: FreeSpace, origin: Array | None = None) -> Array:
        """States (l, n) that a tree in an examined scene draws first; here those along its passages.

        `origin` is the robot's state (n,); None: the scene's start.
        """
        return self.states_along(passages.axis, space.scene)

    def nearest(self, states: Array, x: Array, count: int, *, forward: bool) -> NDArray[np.int64]:
        """Indices of the `count` states of (k, n) that cost least to reach from x (n,) (forward) or to come from.

        Cheapest first, (count,) or (k,) if those are fewer; the paper's NearForward and NearBackward.
        """
        if (compiled := self.compiled) is not None:
            chosen = np.empty(min(count, len(states)), dtype=np.int64)
            compiled.nearest(states, x, compiled.numbers, forward, chosen, np.empty(len(chosen)))
            return chosen
        cost = self.distance(x, states) if forward else self.distance(states, x)
        if count >= len(states):
            return np.argsort(cost, kind="stable")
        chosen = np.argpartition(cost, count)[:count]
        return np.asarray(chosen[np.argsort(cost[chosen], kind="stable")])

    @property
    def compiled(self) -> Compiled | None:
        """`nearest` and `connect` as kernels, with which a tree grows faster; None if there are none."""
        return None

    def trajectory(self, path: Any) -> Trajectory:
        """The controls (l, m) along a path of consecutive motions, and their durations (l,) [s]."""
        return self.motion.trajectory(self, path)


def rows(states: Array, n: int) -> Array:
    """States (..., n) as contiguous rows (k, n), as kernels read them."""
    return np.ascontiguousarray(states, dtype=float).reshape(-1, n)


@inlined
def insert(chosen, least, found, d, i):  # type: ignore[no-untyped-def]
    """Insert i of cost d into the `found` of `chosen` (c,), whose costs `least` (c,) rise; how many there are then."""
    if found < chosen.shape[0]:
        found += 1
    elif d >= least[found - 1]:
        return found
    at = found - 1
    while at > 0 and least[at - 1] > d:
        least[at], chosen[at] = least[at - 1], chosen[at - 1]
        at -= 1
    least[at], chosen[at] = d, i
    return found
