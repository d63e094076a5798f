"""Find what paths in space can link with: closed chains of solids that a robot cannot pass between.

Solids grown by the robot's radius, and six half spaces outside of the workspace, are convex sets. So their union has
the homology of its nerve: a vertex for each set, an edge where two meet, a triangle where three meet. By Alexander
duality a robot in space has one independent way around for each cycle of that graph that is no sum of triangles: a
pillar from floor to ceiling, a frame and a bar from wall to wall are one each, a body that floats is none. Subsets of
space have no torsion, so coefficients modulo 2 count cycles.

A common point certifies an edge or a triangle. A triangle that is missed costs a name, a wrong one would hide a class.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.shapes import PROBE, Solids, distance_from, offset_from
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.jit.jit import borrowing, kernel
from pirrht.topology.obstacles import Component, numbered
from pirrht.topology.tuning import TUNING

WORKSPACE = "workspace"  # name of all that lies outside
SIDES = 6  # half spaces outside of the workspace: below and above it along each axis


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop(Component):
    """A closed chain of grown solids, perhaps through the outside of the workspace, that paths can link with."""

    corners: Array  # (k, 3) of a closed polygon inside of them [m]


class Sets(NamedTuple):
    """M grown solids, then the half spaces outside of the workspace, as kernels take them."""

    solids: Solids
    radius: float  # by which solids are grown [m]
    lower: Array  # (3,) least corner of the workspace [m]
    upper: Array  # (3,) greatest corner [m]

    @property
    def amount(self) -> int:
        """Number of sets."""
        return len(self.solids.form) + SIDES

    def boxes(self) -> tuple[Array, Array]:
        """Return boxes along the axes around the sets, lower and upper corners, 2 x (count, 3) [m]."""
        low = np.full((self.amount, 3), -np.inf)
        high = np.full((self.amount, 3), np.inf)
        M = len(self.solids.form)
        low[:M] = self.solids.low - self.radius
        high[:M] = self.solids.high + self.radius
        for axis in range(3):
            high[M + 2 * axis, axis] = self.lower[axis]
            low[M + 2 * axis + 1, axis] = self.upper[axis]
        return low, high


@borrowing
def _excess(sets, i, x, y, z):  # type: ignore[no-untyped-def]
    """Return by how much a point is outside of set i [m], negative inside, and the unit vector away from the set."""
    M = len(sets.solids.form)
    if i >= M:
        axis = (i - M) // 2
        sign = 1.0 if (i - M) % 2 == 0 else -1.0
        end = sets.lower[axis] if sign > 0.0 else sets.upper[axis]
        excess = sign * ((x, y, z)[axis] - end)
        return excess, sign * (axis == 0), sign * (axis == 1), sign * (axis == 2)
    gap = distance_from(sets.solids, i, x, y, z)
    if gap <= PROBE:
        return -sets.radius, 0.0, 0.0, 0.0
    ex, ey, ez = offset_from(sets.solids, i, x, y, z)
    return gap - sets.radius, ex / gap, ey / gap, ez / gap


@kernel
def _meet(sets, trios, rounds, points, found):  # type: ignore[no-untyped-def]
    """Move points (k, 3) [m] into three sets each, trios (k, 3); found (k,) tells which are in all of them.

    A point goes to a depth in the set that it is farthest from, over and over. The depth is half the radius at first,
    and is halved if that leads nowhere within so many `rounds`.
    """
    for t in range(len(trios)):
        x, y, z = points[t, 0], points[t, 1], points[t, 2]
        depth = 0.5 * sets.radius
        while not found[t] and depth > 1e-4 * sets.radius:
            for _ in range(rounds):
                worst, nx, ny, nz = _excess(sets, trios[t, 0], x, y, z)
                for c in range(1, 3):
                    excess, ex, ey, ez = _excess(sets, trios[t, c], x, y, z)
                    if excess > worst:
                        worst, nx, ny, nz = excess, ex, ey, ez
                found[t] = worst <= -0.5 * depth
                if found[t]:
                    break
                x -= (worst + depth) * nx
                y -= (worst + depth) * ny
                z -= (worst + depth) * nz
            depth *= 0.5
        points[t, 0], points[t, 1], points[t, 2] = x, y, z


@kernel
def _excesses(sets, points, out):  # type: ignore[no-untyped-def]
    """Write by how much points (k, 3) are outside of each set, out (amount, k) [m]."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = _excess(sets, i, points[k, 0], points[k, 1], points[k, 2])[0]


class Nerve:
    """Sets, edges between two that meet, with a common point each, and triangles of three that meet."""

    def __init__(self, sets: Sets) -> None:
        self.sets = sets
        low, high = sets.boxes()
        near = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=-1)
        pairs = np.argwhere(np.triu(near, 1))
        middle = 0.5 * (sets.lower + sets.upper)
        centers = np.vstack([sets.solids.position, np.tile(middle, (SIDES, 1))])
        points, found = self._common(pairs[:, [0, 1, 1]], 0.5 * (centers[pairs[:, 0]] + centers[pairs[:, 1]]))
        self.edges: IntArray = pairs[found]
        self.points = points[found]  # (E, 3) [m]
        self.edge_of = {(i, j): e for e, (i, j) in enumerate(self.edges.tolist())}
        self.neighbors: list[list[int]] = [[] for _ in range(sets.amount)]
        for i, j in self.edges.tolist():
            self.neighbors[i].append(j)
            self.neighbors[j].append(i)
        self.triangles = self._triangles()

    def _common(self, trios: NDArray[np.int64], starts: Array) -> tuple[Array, BoolArray]:
        """Return points near some starts, and whether they are in all three sets each.

        Starts are moved a little, so that no corner of a polygon lies exactly between places that people choose.
        """
        shift = TUNING.meeting_shift * self.sets.radius
        points = starts + np.random.default_rng(0).uniform(-shift, shift, starts.shape)
        found = np.zeros(len(trios), dtype=np.bool_)
        _meet(self.sets, np.ascontiguousarray(trios), TUNING.meeting_rounds, points, found)
        return points, found

    def _triangles(self) -> list[tuple[int, int, int]]:
        """Return three edges for each triangle of three sets with a common point."""
        above = [{k for k in near if k > i} for i, near in enumerate(self.neighbors)]
        trios = [(i, j, k) for i, j in self.edge_of for k in above[i] & above[j]]
        if not trios:
            return []
        sides = [(self.edge_of[i, j], self.edge_of[i, k], self.edge_of[j, k]) for i, j, k in trios]
        _, found = self._common(np.array(trios), self.points[np.array(sides)].mean(axis=1))
        return [side for side, meets in zip(sides, found.tolist(), strict=True) if meets]

    def parts(self) -> list[int]:
        """Return for each edge its part of the classes of the cycles that it is on, a bit for each generator.

        The class of a cycle is the sum of its edges' parts modulo 2; edges of a spanning forest have none.
        """
        parent = list(range(self.sets.amount))

        def root(i: int) -> int:
            while parent[i] != i:
                parent[i] = parent[parent[i]]
                i = parent[i]
            return i

        unit = [0] * len(self.edges)
        count = 0
        for e, (i, j) in enumerate(self.edges.tolist()):
            if root(i) == root(j):
                unit[e] = 1 << count
                count += 1
            parent[root(i)] = root(j)
        rows = dict[int, int]()  # triangles as sums of edges, by the highest of them
        for a, b, c in self.triangles:
            _independent(unit[a] ^ unit[b] ^ unit[c], rows)
        place = {bit: k for k, bit in enumerate(bit for bit in range(count) if bit not in rows)}
        left = [_reduced(mask, rows) for mask in unit]
        return [sum(1 << k for bit, k in place.items() if mask >> bit & 1) for mask in left]

    def cycles(self, known: Sequence[Sequence[int]] = ()) -> list[list[int]]:
        """Return the sets along a basis of cycles: of few sets each, then that leave the workspace seldom, then short.

        Known cycles come first, and are left out. A cycle that is no sum of triangles has an edge with a part of its
        class, so it is enough to search from the ends of these.
        """
        parts = self.parts()
        best = dict[int, tuple[int, int, float, list[int]]]()
        for first in sorted({i for pair, e in self.edge_of.items() if parts[e] for i in pair}):
            chain, total = self._tree(first, parts)
            for (i, j), e in self.edge_of.items():
                if i not in chain or not (kind := total[i] ^ total[j] ^ parts[e]):
                    continue
                size = len(chain[i]) + len(chain[j]) - 1
                if kind not in best or size <= best[kind][0]:
                    cycle = [*chain[i], *chain[j][:0:-1]]
                    shorter = size, *self._order(cycle), cycle
                    best[kind] = min(best.get(kind, shorter), shorter)
        rows = dict[int, int]()
        for one in known:
            _independent(self.kind(one, parts), rows)
        ordered = sorted(best.items(), key=lambda item: item[1])
        kept = [cycle for kind, (*_, cycle) in ordered if _independent(kind, rows)]
        return [[*cycle[k:], *cycle[:k]] for cycle in kept for k in [cycle.index(min(cycle))]]

    def kind(self, cycle: Sequence[int], parts: list[int]) -> int:
        """Return the class of a cycle modulo 2, of the parts of edges."""
        return reduce(xor, (parts[e] for e in self._around(cycle)), 0)

    def around(self, corners: Array) -> list[int]:
        """Return the sets that hold the sides of a polygon (k, 3) [m], each of which meets the next; [] if none do."""
        excess = np.empty((self.sets.amount, len(corners)))
        _excesses(self.sets, np.ascontiguousarray(corners), excess)
        holds = (excess <= GEOMETRY.rounding) & (np.roll(excess, -1, axis=1) <= GEOMETRY.rounding)
        if not holds.any(axis=0).all():
            return []
        sets = holds.argmax(axis=0).tolist()
        cycle = [i for k, i in enumerate(sets) if i != sets[k - 1]]
        near = zip(cycle, [*cycle[1:], *cycle[:1]], strict=True)
        return cycle if all((min(pair), max(pair)) in self.edge_of for pair in near) else []

    def _tree(self, first: int, parts: list[int]) -> tuple[dict[int, list[int]], dict[int, int]]:
        """Return shortest chains from a set to all others, and the parts of classes along them."""
        chain = {first: [first]}
        total = {first: 0}
        queue = deque([first])
        while queue:
            i = queue.popleft()
            for j in self.neighbors[i]:
                if j not in chain:
                    chain[j] = [*chain[i], j]
                    total[j] = total[i] ^ parts[self.edge_of[min(i, j), max(i, j)]]
                    queue.append(j)
        return chain, total

    def corners(self, cycle: Sequence[int]) -> Array:
        """Return the common points of the sets along a cycle, (k, 3) [m]: sides between them lie in one set each.

        They go around the axis across which their loop is widest counter-clockwise, whatever the order of the sets.
        """
        corners = self.points[self._around(cycle)]
        area = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
        return corners if area[np.argmax(np.abs(area))] >= 0.0 else corners[::-1]

    def _around(self, cycle: Sequence[int]) -> list[int]:
        return [self.edge_of[min(pair), max(pair)] for pair in zip(cycle, [*cycle[1:], cycle[0]], strict=True)]

    def _order(self, cycle: Sequence[int]) -> tuple[int, float]:
        """Return how often a cycle goes from a solid to a half space, and how long its polygon is [m]."""
        outside = np.array(cycle) >= self.sets.amount - SIDES
        corners = self.points[self._around(cycle)]
        length = np.linalg.norm(corners - corners[np.arange(-1, len(cycle) - 1)], axis=1).sum()
        return int(np.sum(outside & ~np.roll(outside, 1))), float(length)


def _reduced(mask: int, rows: dict[int, int]) -> int:
    """Return a sum of edges modulo rows, each known by its highest edge."""
    left = 0
    while mask:
        high = mask.bit_length() - 1
        one = 1 << high if high not in rows else 0
        left |= one
        mask ^= one or rows[high]
    return left


def _independent(mask: int, rows: dict[int, int]) -> bool:
    """Return whether a sum of edges is none of rows, and make what is left of it one of them."""
    left = _reduced(mask, rows)
    if left:
        rows[left.bit_length() - 1] = left
    return left > 0


class _Chains:
    """The nerve of a world, and its cycles as chains of solids."""

    def __init__(self, collision: Collision) -> None:
        self.world = collision.world
        low, high = collision.extents()
        radius = collision.footprint.radius
        within = np.all((low - radius <= self.world.upper) & (high + radius >= self.world.lower), axis=1)
        self.alone = [i for i in np.flatnonzero(within).tolist() if collision.first[i] == i]
        solids = Solids.of([self.world.obstacles[i] for i in self.alone])
        self.nerve = Nerve(Sets(solids, radius, self.world.lower, self.world.upper))

    def loop(self, cycle: Sequence[int], corners: Array) -> Loop:
        """Return a chain by a cycle of sets and its polygon (k, 3) [m]."""
        M = len(self.alone)
        members = tuple(sorted(self.alone[i] for i in cycle if i < M))
        outside = [WORKSPACE] if max(cycle) >= M else []
        names = (*(self.world.obstacles[i].name for i in members), *outside)
        return Loop(members=members, names=names, marker=corners[0], corners=corners)

    def found(self, known: Sequence[Sequence[int]] = ()) -> list[Loop]:
        """Return chains that with known cycles make a basis."""
        cycles = self.nerve.cycles(known)
        return sorted((self.loop(cycle, self.nerve.corners(cycle)) for cycle in cycles), key=lambda one: one.members)


def loops(collision: Collision) -> tuple[Component, ...]:
    """Return the chains that paths in space can link with, as `Loop`, then every solid within reach on its own."""
    chains = _Chains(collision)
    names = [one.name for one in chains.world.obstacles]
    return *chains.found(), *(Component(members=(i,), names=(names[i],), marker=None) for i in chains.alone)


def continued_loops(collision: Collision, before: Sequence[Component], named: int) -> tuple[Component, ...]:
    """Return the chains of a changed world in the order of earlier ones, then new ones (`obstacles.continued`).

    An earlier polygon stays while grown solids hold its sides and it is no sum of triangles. Else it is put outside of
    the workspace, where no path links with it, until a later chain takes its number.
    """
    chains = _Chains(collision)
    parts = chains.nerve.parts()
    cycles = [chains.nerve.around(old.corners) if isinstance(old, Loop) else [] for old in before]
    kept = [
        chains.loop(cycle, old.corners) if isinstance(old, Loop) and cycle and chains.nerve.kind(cycle, parts) else None
        for old, cycle in zip(before, cycles, strict=True)
    ]
    known = [cycle for cycle, part in zip(cycles, kept, strict=True) if part]
    nowhere = 2.0 * collision.world.upper - collision.world.lower + np.eye(3)
    gone = Loop(members=(), names=(), marker=nowhere[0], corners=nowhere)
    return numbered(before, kept, chains.found(known), gone, named)
