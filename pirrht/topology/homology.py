"""Tell homology classes of planar paths by H-signatures and the integers behind them (paper, section IV-A).

From a point x every path to the goal point has H = H(straight line from x) + k with whole turns k. The tuple k is the
class; two paths from x are homologous exactly when their tuples are equal, without a tolerance. The integer k_l counts
how often a path crosses the cut, the ray that leaves marker l away from the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache

import numpy as np

from pirrht import shown
from pirrht.arrays import Array, IntArray
from pirrht.geometry.arcs import turns_of_chord
from pirrht.jit.jit import kernel
from pirrht.topology.cuts import Cuts, straight_turns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Homology:
    """Markers of the topological obstacles and the goal point that all signatures refer to.

    Names of classes give the turns about the first `named` markers always (None: about all), about later ones up to the
    last that has any: classes keep their names while obstacles are added.
    """

    markers: Array  # (M, 2) one point inside each topological obstacle [m]
    goal: Array  # (2,) goal representative point [m]
    named: int | None = None
    cuts: Cuts = field(init=False, repr=False)  # the markers sorted, for kernels that must not ask all of them

    def __post_init__(self) -> None:
        object.__setattr__(self, "cuts", Cuts.of(self.markers, self.goal, self.hash_weights))

    def __repr__(self) -> str:
        return f"Homology({self.M} markers, goal {shown.vector(self.goal)})"

    @property
    def M(self) -> int:
        """Number of topological obstacles."""
        return int(self.markers.shape[0])

    def asked(self, x: Array, time: float) -> Array:
        """Return the state (n,) itself, whatever the time; `TimedHomology` takes a place and a time."""
        return x

    def straight(self, points: Array) -> Array:
        """H of the straight lines from points (k, 2) [m] to the goal point, (k, M) [turns], without the leading 1."""
        out = np.empty((len(points), self.M))
        _straight(np.ascontiguousarray(points, dtype=float), self.markers, self.goal, out)
        return out

    def turns(self, polyline: Array) -> Array:
        """H of a polyline (l, 2) [m], (M,) [turns], without the leading 1."""
        out = np.zeros(self.M)
        _turns(np.ascontiguousarray(polyline[:, :2], dtype=float), self.markers, out)
        return out

    def winding(self, polyline: Array) -> tuple[int, ...]:
        """Class, M [turns], of a path (l, 2) [m], completed by the straight line from its end to the goal point."""
        ends = self.straight(polyline[[0, -1], :2])
        whole = self.turns(polyline) + ends[1] - ends[0]
        return integers(whole)

    def signature(self, start: Array, winding: Sequence[int]) -> Array:
        """The paper's H = 1 + H(sigma) of a class (M,) seen from start (2,) [m], (M,) [turns]."""
        value: Array = 1.0 + self.straight(start[None, :2])[0] + np.asarray(winding, dtype=float)
        return value

    def name(self, winding: Sequence[int]) -> str:
        """The public name of a class (M,)."""
        return class_id(winding, self.named)

    @property
    def hash_weights(self) -> IntArray:
        """Odd integers r (M,) such that a class has the additive key sum k_l r_l (mod 2^64)."""
        return hash_weights(self.M)

    def key(self, winding: Sequence[int]) -> int:
        """The additive key of a class (M,), as kernels carry it (a wrapped 64-bit integer)."""
        weights = self.hash_weights
        with np.errstate(over="ignore"):
            return int(np.sum(np.asarray(winding, dtype=np.int64) * weights, dtype=np.int64))


@cache
def hash_weights(M: int) -> IntArray:
    """Draw odd integers (M,), one for each of so many markers."""
    draws = np.random.default_rng(0x5157).integers(0, 2**62, size=M, dtype=np.int64)
    return draws * 2 + 1


def integers(whole: Array | IntArray) -> tuple[int, ...]:
    """Round numbers (M,) [turns], whole but for rounding, to a class of M plain integers."""
    winding: tuple[int, ...] = tuple(np.rint(whole).astype(np.int64).tolist())
    return winding


def class_id(winding: Sequence[int], named: int | None = None) -> str:
    """Name a class (M,) publicly: its integers joined by commas; "-" where there is nothing to wind around.

    Zeros at the end are left out after `named` integers; None: never.
    """
    last = len(winding)
    while named is not None and last > named and winding[last - 1] == 0:
        last -= 1
    return _name(tuple(winding[:last]))


@lru_cache(maxsize=1024)  # every plan asks for the same few again
def _name(winding: tuple[int, ...]) -> str:
    return ",".join(map(str, winding)) or "-"


@kernel
def _straight(points, markers, goal, out):  # type: ignore[no-untyped-def]
    for i in range(points.shape[0]):
        for k in range(markers.shape[0]):
            out[i, k] = straight_turns(points[i, 0], points[i, 1], markers[k, 0], markers[k, 1], goal[0], goal[1])


@kernel
def _turns(points, markers, out):  # type: ignore[no-untyped-def]
    for i in range(points.shape[0] - 1):
        for k in range(markers.shape[0]):
            ax, ay = points[i, 0] - markers[k, 0], points[i, 1] - markers[k, 1]
            bx, by = points[i + 1, 0] - markers[k, 0], points[i + 1, 1] - markers[k, 1]
            out[k] += turns_of_chord(ax, ay, bx, by)
