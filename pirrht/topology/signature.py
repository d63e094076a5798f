"""Define the homology signature of a path: the interface between topology, tree, sampler and run."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cache

import numpy as np

from pirrht.arrays import Array, IntArray

OTHER = "other"  # name of all classes that no reference has, taken together


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
        array([0.19879181])
        >>> homology.crossings(np.array([1.0, -1.0]), np.array([1.0, 1.0]))  # (obstacle, turn) pairs
        [(0, -1)]
        >>> homology.along(np.array([[3.0, 1.0], [1.0, 1.0], [1.0, -1.0], [3.0, -1.0], [3.0, 1.0]]))  # once around
        array([1])
        >>> homology.name((1,))
        '1'
    """

    named: int | None = None  # turns that a name gives at least: later zeros are left out; None: all of them

    most_base: float = 0.5  # greatest magnitude of a base [turns]: a straight line in the plane turns at most half

    @property
    @abstractmethod
    def M(self) -> int:
        """Number of obstacles that paths can wind around."""

    @abstractmethod
    def base(self, x: Array) -> Array:
        """H of the base from x (n,), (M,) [turns], without the leading 1."""

    @abstractmethod
    def crossings(self, a: Array, b: Array) -> list[tuple[int, int]]:
        """(obstacle, turn) pairs that a straight segment from a (n,) to b (n,) adds to the class of b."""

    def along(self, path: Array) -> IntArray:
        """Sum of the crossings of a path's segments, path (k, n), (M,) [turns]."""
        whole = np.zeros(self.M, dtype=np.int64)
        for a, b in zip(path[:-1], path[1:], strict=True):
            for obstacle, turn in self.crossings(a, b):
                whole[obstacle] += turn
        return whole

    def at(self, x: Array, time: float) -> Array:
        """Point that `base` and `crossings` take for a state x (n,) at a time [s]; here the state."""
        return x

    def signature(self, x: Array, winding: Sequence[int]) -> Array:
        """The paper's H = 1 + H(sigma) of a class (M,) seen from x (n,), (M,) [turns]."""
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
