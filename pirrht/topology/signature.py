"""Define the homology signature of a path: the interface between topology, tree, sampler and run.

A kind of signatures is a set of kernels, and a class that makes the numbers that they take. Whatever is above
`topology/` calls the kernels by their record, and imports no kind.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.topology.pairs import spread

OTHER = "other"  # name of all classes that no reference has, taken together


class SignatureKernels(NamedTuple):
    """Kernels of one kind of signatures, which steering, tree, proposals and samples call.

    `table` is `Signature.table`, `rays` what `Signature.rays` returns. Points are positions and times (`Signature.at`).
    Pairs (obstacle, turn) are appended to marker, turn (l,), where `count` are already; kernels that append them return
    how many there are. An obstacle may recur.
    """

    base: Any  # (table, x, out (M,)): write H of the base from a point [turns]
    # (table, a, b, to_goal, marker, turn, count): append the pairs that a straight step from point a to point b adds to
    # the class of b; `to_goal`: b is where it enters the goal, and it goes on straight to the goal point.
    crossings: Any
    turns: Any  # (table, a, b, out (M,)): add H of a straight step from point a to a later point b [turns]
    # (table, (start, curvature, length), to_goal, head, marker, turn, count): append the pairs of a curve of arcs
    # (`Curves`), that ends at `head`, among static obstacles; None: there are no arcs.
    arcs: Any = None
    # (table, a, b): additive key of a straight step between positions among static obstacles.
    key: Any = None
    # (table, f, (x, y, to_x, to_y), n, keys, at): add those of n steps of points in the plane to `keys` from `at` on;
    # their coordinates are in f, in single precision, from four places on. None: there are no points in the plane.
    keys: Any = None
    # Of sampled paths among moving obstacles; None: there are none. `watch` is scratch of one path after another.
    watch: Any = None  # (rays): allocate scratch
    begin: Any = None  # (rays, x, watch): begin another path at a position; return its first additive key
    follow: Any = None  # (rays, i, share, x, watch): additive key of the step to a position, a share of step i later


def _unclassified() -> SignatureKernels:
    """Make kernels of paths that have no class: their keys are 0."""
    nothing = inlined(lambda rays: 0)
    key = inlined(lambda table, a, b: np.int64(0))
    begin = inlined(lambda rays, x, watch: np.int64(0))
    follow = inlined(lambda rays, i, share, x, watch: np.int64(0))
    return SignatureKernels(
        None, None, None, None, key, inlined(lambda table, f, rows, n, keys, at: None), nothing, begin, follow
    )


NO_CLASSES = _unclassified()


class Table(Protocol):
    """Numbers of a signature as its kernels take them: a NamedTuple of numbers and addresses."""

    @property
    def kernels(self) -> SignatureKernels:
        """Return the kernels that take them."""


class Classes(NamedTuple):
    """A signature as kernels take it that classify paths from one state over steps."""

    table: Table  # `Signature.table`
    rays: Any  # `Signature.rays`


class Signature(ABC):
    """Signature of paths about M obstacles, written as integers (paper, section IV-A).

    Every point x has a base, one fixed path to the goal. A path from x has H = H(base of x) + k with whole numbers k.
    The tuple k is its class: two paths from x are homologous exactly when their tuples are equal, without a tolerance.
    k is the sum of the crossings of the path's segments, so a graph search adds it up edge by edge. `Homology` counts
    rays that planar paths cross. Linking numbers about rings in space fit as well.

    Examples:
        >>> from pirrht import Homology
        >>> homology = Homology(markers=np.array([[2.0, 0.0]]), goal=np.array([5.0, 0.0]))
        >>> homology.base(np.array([2.0, -1.0]))  # H of the straight line to the goal [turns]
        array([0.25])
        >>> homology.crossings(np.array([1.0, -1.0]), np.array([1.0, 1.0]))  # (obstacle, turn) pairs
        [(0, -1)]
        >>> homology.along(np.array([[3.0, 1.0], [1.0, 1.0], [1.0, -1.0], [3.0, -1.0], [3.0, 1.0]]))  # once around
        array([1])
        >>> homology.name((1,))
        '1'
    """

    markers: Array  # (M - J, d) one point inside each static obstacle [m]
    goal: Array  # (d,) goal point [m]
    names: tuple[str, ...] = ()  # (J,) of the moving obstacles that moving markers belong to
    moved: tuple[int, ...] = ()  # static markers that lie elsewhere in their obstacle than in the signature before
    named: int | None = None  # turns that a name gives at least: later zeros are left out; None: all of them
    speed: float = 1.0  # of bases among moving obstacles [m/s]

    most_base: float = 0.5  # greatest magnitude of a base [turns]: a straight line in the plane turns at most half

    @property
    def M(self) -> int:
        """Number of obstacles that paths can wind around: static ones, then moving ones."""
        return len(self.markers) + self.J

    @property
    def J(self) -> int:
        """Number of moving markers."""
        return len(self.names)

    @property
    @abstractmethod
    def table(self) -> Table:
        """Numbers that its kernels take."""

    @property
    def static(self) -> "Signature":
        """Signature about the static obstacles only; here there are no others."""
        return self

    @abstractmethod
    def with_goal(self, goal: Array) -> "Signature":
        """Signature about the same obstacles for another goal point (d,) [m]."""

    @abstractmethod
    def with_moving(self, movers: Sequence[Mover], footprint: Footprint) -> "Signature":
        """Signature about the same static obstacles and other moving ones."""

    def with_speed(self, speed: float) -> "Signature":
        """Signature with bases at another speed [m/s], which only moving obstacles depend on."""
        return self

    def rays(self, x: Array, times: Array) -> Any:
        """Return what kernels take of moving obstacles for paths from x (n,) over steps to times (T + 1,) [s]."""
        return ()

    def classes(self, x: Array, times: Array) -> Classes:
        """Return what kernels take that classify paths from x (n,) over steps to times (T + 1,) [s]."""
        return Classes(self.table, self.rays(x, times))

    def places(self, times: Array) -> Array:
        """Places of moving markers at times (T,) [s], (J, T, d) [m]."""
        return np.empty((self.J, len(times), len(self.goal)))

    def at(self, x: Array, time: float | Array) -> Array:
        """Points (..., d + 1) of states x (..., n) at times (...,) [s]: positions, then times."""
        position = x[..., : len(self.goal)]
        return np.concatenate(
            [position, np.broadcast_to(np.asarray(time, dtype=float), position.shape[:-1])[..., None]], axis=-1
        )

    def base(self, x: Array) -> Array:
        """H of the base from a point x, (M,) [turns], without the leading 1; 0 about moving markers at an open time."""
        out = np.empty(self.M)
        self.table.kernels.base(self.table, np.ascontiguousarray(x, dtype=float), out)
        return out

    def crossings(self, a: Array, b: Array) -> list[tuple[int, int]]:
        """(obstacle, turn) pairs that a straight segment from point a to point b adds to the class of b."""
        whole = self.along(np.array([a, b]))
        return [(int(k), int(whole[k])) for k in np.flatnonzero(whole)]

    def along(self, path: Array) -> IntArray:
        """Sum of the crossings of the segments of a path of k points, (M,) [turns]."""
        pairs = max(1, len(path) - 1) * self.M
        marker = np.empty(pairs, np.int32)
        turn = np.empty(pairs, np.int16)

        add, _ = _along_with(self.table.kernels, len(self.goal) + 1)
        count = add(self.table, self._timed(path), marker, turn)
        return spread(marker[:count], turn[:count], self.M)

    def turns(self, path: Array) -> Array:
        """H of a path of k points whose times do not fall, (M,) [turns], without the leading 1."""
        out = np.zeros(self.M)
        _, add = _along_with(self.table.kernels, len(self.goal) + 1)
        add(self.table, self._timed(path), out)
        return out

    def closed(self, turns: Array, first: Array, last: Array) -> Array:
        """H of a path from point `first` to `last`, completed to the goal point, over the base's, (M,) [turns]."""
        return turns + self.base(last) - self.base(first)

    def winding(self, path: Array) -> tuple[int, ...]:
        """Class, M [turns], of a path of k points, completed straight to the goal point, where it then waits."""
        path = self._timed(path)
        return integers(self.closed(self.turns(path), path[0], path[-1]))

    def most_turned(self, path: Array) -> float:
        """Return the greatest |H_i| about a static marker of what is left of a path (k, n) at its points [turns].

        It is completed straight to the goal point. A tree has the path if its limit is no less.
        """
        line = np.vstack([path[:, : len(self.goal)], self.goal])
        parts = np.array([self.static.turns(np.array(pair)) for pair in zip(line[:-1], line[1:], strict=True)])
        return float(np.abs(np.cumsum(parts[::-1], axis=0)).max(initial=0.0))

    def _timed(self, path: Array) -> Array:
        """Points (k, d + 1) of a path (k, n); times are 0 where nothing moves."""
        d = len(self.goal)
        return np.column_stack([path[:, :d], path[:, d] if self.J else np.zeros(len(path))])

    def signature(self, x: Array, winding: Sequence[int]) -> Array:
        """The paper's H = 1 + H(sigma) of a class (M,) seen from a point x, (M,) [turns]."""
        return np.asarray(1.0 + self.base(x) + np.asarray(winding, dtype=float))

    @property
    def hash_weights(self) -> IntArray:
        """Odd integers r (M,) such that a class has the additive key sum k_l r_l (mod 2^64)."""
        return hash_weights(self.M)

    def key(self, winding: Sequence[int]) -> int:
        """Additive key of a class (M,), as kernels carry it (a wrapped 64-bit integer)."""
        with np.errstate(over="ignore"):
            return int(np.sum(np.asarray(winding, dtype=np.int64) * self.hash_weights, dtype=np.int64))

    def name(self, winding: Sequence[int]) -> str:
        """Public name of a class (M,)."""
        return class_id(winding, self.named)


@cache
def _along_with(kernels: SignatureKernels, d: int) -> tuple[Any, Any]:
    """Build kernels that append the pairs of a path of points (k, d), and that add its H."""
    crossings, turned = kernels.crossings, kernels.turns

    @kernel
    def pairs(table, path, marker, turn):  # type: ignore[no-untyped-def]
        count = 0
        for i in range(path.shape[0] - 1):
            count = crossings(table, as_tuple(path[i], d), as_tuple(path[i + 1], d), False, marker, turn, count)
        return count

    @kernel
    def turns(table, path, out):  # type: ignore[no-untyped-def]
        for i in range(path.shape[0] - 1):
            turned(table, as_tuple(path[i], d), as_tuple(path[i + 1], d), out)

    return pairs, turns


@cache
def hash_weights(M: int) -> IntArray:
    """Draw odd integers (M,), one for each of so many obstacles."""
    return np.random.default_rng(0x5157).integers(0, 2**62, size=M, dtype=np.int64) * 2 + 1


def integers(whole: Array | IntArray) -> tuple[int, ...]:
    """Round numbers (M,) [turns], whole but for rounding, to a class of M plain integers."""
    return tuple(np.rint(whole).astype(np.int64).tolist())


def class_id(winding: Sequence[int], named: int | None = None) -> str:
    """Name a class (M,) publicly: its integers joined by commas; "-" where there is nothing to wind around.

    Zeros at the end are left out after `named` integers; None: never.
    """
    last = len(winding)
    while named is not None and last > named and winding[last - 1] == 0:
        last -= 1
    return ",".join(map(str, winding[:last])) or "-"
