"""Classes of paths in space: how often they link with closed polygons inside of grown solids.

A straight step from a to b and the bases of its ends, straight lines to the goal point g, are the border of a triangle
g, a, b. It turns about a polygon as often as the polygon pierces the triangle, forwards less backwards. Sides that
share a corner, and triangles that share a base, decide by the same number on which side of each other they are, so
each piercing counts once. The turn of an open path is Gauss's integral: over two straight pieces it is the solid angle
of the directions from one to the other, a quadrangle of arcs, over 4 pi.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.geometry.footprint import Footprint
from pirrht.geometry.obstacle import Mover
from pirrht.jit.jit import inlined, kernel, load_float64, load_int32, load_int64, part
from pirrht.jit.records import Held
from pirrht.topology.signature import NO_CLASSES, Signature, SignatureKernels, hash_weights


class LinkTable(NamedTuple):
    """M closed polygons as kernels take them."""

    goal: tuple[float, float, float]  # goal point [m]
    M: int
    start: int  # address of int32 (M + 1,): first corner of each
    corner: int  # address of float64 (N, 3): corners seen from the goal point, the first of each again as its last [m]
    across: int  # address of float64 (N, 3): vector products of each and the next [m^2]
    weight: int  # address of int64 (M,): additive keys of one turn


class Links(Held, LinkTable):
    """A `LinkTable` together with the arrays that its addresses point to."""

    @classmethod
    def of(cls, loops: Sequence[Array], goal: Array) -> "Links":
        """Gather polygons (k, 3) [m] as seen from a goal point (3,) [m]."""
        closed = [np.vstack([loop, loop[:1]]) - goal for loop in loops]
        corner = np.concatenate([np.zeros((0, 3)), *closed])
        start = np.cumsum([0, *map(len, closed)]).astype(np.int32)
        across = np.cross(corner, np.roll(corner, -1, axis=0))
        return cls.holding(tuple(goal.tolist()), len(loops), start, corner, across, hash_weights(len(loops)))

    @property
    def kernels(self) -> SignatureKernels:
        """Return the kernels of linking numbers."""
        return LINKING


@inlined
def _at(address, i):  # type: ignore[no-untyped-def]
    """Row i (3) of an array of vectors."""
    return load_float64(address, 3 * i), load_float64(address, 3 * i + 1), load_float64(address, 3 * i + 2)


@inlined
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _less(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@part
def _pierced(table, k, a, b, normal):  # type: ignore[no-untyped-def]
    """Whole turns about polygon k of the triangle of the goal point, a and b; a, b and a x b as seen from there."""
    whole = 0
    first = load_int32(table.start, k)
    last = load_int32(table.start, k + 1) - 1
    above = _dot(normal, _at(table.corner, first)) > 0.0
    for i in range(first, last):
        q = _at(table.corner, i + 1)
        later = _dot(normal, q) > 0.0
        if above != later:
            across = _at(table.across, i)
            left = _dot(across, a) > 0.0
            if left != (_dot(across, b) > 0.0):
                p = _at(table.corner, i)
                ahead = _dot(_less(q, p), _cross(_less(a, p), _less(b, p))) > 0.0
                if ahead == left:
                    whole += 1 if later else -1
        above = later
    return whole


@kernel
def crossings(table, a, b, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs that a straight step from a to b adds to the class of b; one to the goal goes on straight."""
    one = _less(a, table.goal)
    other = _less(b, table.goal)
    normal = _cross(one, other)
    for k in range(table.M):
        whole = _pierced(table, k, one, other, normal)
        if whole != 0:
            marker[count], turn[count] = k, whole
            count += 1
    return count


@part
def key(table, a, b):  # type: ignore[no-untyped-def]
    """Additive key of the segment from a to b, positions [m]."""
    one = _less(a, table.goal)
    other = _less(b, table.goal)
    normal = _cross(one, other)
    total = np.int64(0)
    for k in range(table.M):
        total += _pierced(table, k, one, other, normal) * load_int64(table.weight, k)
    return total


@inlined
def _solid_angle(a, b, c):  # type: ignore[no-untyped-def]
    """Return half the signed solid angle [rad] of a triangle seen from the origin (van Oosterom and Strackee 1983)."""
    la = math.sqrt(_dot(a, a))
    lb = math.sqrt(_dot(b, b))
    lc = math.sqrt(_dot(c, c))
    below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    return math.atan2(_dot(a, _cross(b, c)), below)


@kernel
def _turn(table, k, a, b):  # type: ignore[no-untyped-def]
    """Turn [turns] of a segment about polygon k, from a to b as seen from the goal point."""
    total = 0.0
    for i in range(load_int32(table.start, k), load_int32(table.start, k + 1) - 1):
        p = _at(table.corner, i)
        q = _at(table.corner, i + 1)
        one = _less(p, a)
        other = _less(q, b)
        total += _solid_angle(one, other, _less(q, a)) + _solid_angle(one, _less(p, b), other)
    return total / (2.0 * math.pi)


@kernel
def turns(table, a, b, out):  # type: ignore[no-untyped-def]
    """Add H of a straight step from point a to point b to `out` (M,) [turns]."""
    for k in range(table.M):
        out[k] += _turn(table, k, _less(a, table.goal), _less(b, table.goal))


@kernel
def base(table, x, out):  # type: ignore[no-untyped-def]
    """Write H of the straight line from a point to the goal point to `out` (M,) [turns]."""
    for k in range(table.M):
        out[k] = _turn(table, k, _less(x, table.goal), (0.0, 0.0, 0.0))


LINKING = SignatureKernels(base, crossings, turns, None, key, None, *NO_CLASSES[-3:])  # moving obstacles make none


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Linking(Signature):
    """Signature of paths in space about M closed polygons, none of which a free path touches.

    The base of a point is the straight line to the goal point. The integer of a polygon counts how often a path closed
    by its base links with it.
    """

    loops: tuple[Array, ...]  # M polygons (k, 3) inside of grown solids [m]
    goal: Array  # (3,) goal representative point [m]
    named: int | None = None  # turns that names of classes give at least
    markers: Array = field(init=False)  # (M, 3) a corner of each [m]
    links: Links = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "markers", np.array([loop[0] for loop in self.loops]).reshape(-1, 3))
        object.__setattr__(self, "links", Links.of(self.loops, self.goal))

    def __repr__(self) -> str:
        return f"Linking({self.M} polygons, goal {formatting.vector(self.goal)})"

    @property
    def most_base(self) -> float:  # type: ignore[override]
        """Greatest magnitude of a base [turns]: a straight line turns less than half about a side."""
        return max((0.5 * len(loop) if len(loop) > 4 else 1.0 for loop in self.loops), default=1.0)

    @property
    def table(self) -> Links:
        """Numbers that its kernels take."""
        return self.links

    def with_goal(self, goal: Array) -> "Linking":
        """Signature about the same polygons for another goal point (3,) [m]."""
        return replace(self, goal=goal)

    def with_moving(self, movers: Sequence[Mover], footprint: Footprint) -> "Linking":
        """Signature about the same polygons: no path winds about moving obstacles in space (`moving.in_space`)."""
        return self
