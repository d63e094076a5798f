"""Ways that H_limit leaves out although they are short: |1 - H_i| along them is greater."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.geometry.field import clearances
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree

FACTOR = 1.25  # a way of no more than so many times the shortest matters
POINTS = 4000  # of the lattice on which ways are measured
NEIGHBOURS = 2.3  # points that are so many spacings apart are connected: in the open ways are at most 3 % too long
NOWHERE = -9999  # what SciPy has before the first point of a way


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A collision-free way that no allowed class takes."""

    length: float  # on a lattice: beside walls up to 15 % too long [m]
    limit: float  # the least H_limit that allows it [turns]


def left_out(tree: HomologyTree, x: Array, factor: float = FACTOR) -> list[LeftOut]:
    """The ways from x (n,) that H_limit leaves out and that the robot might want, shortest first.

    Each is the shortest collision-free way through an open passage that no reference of the tree leads through, or the
    shortest of all; it is at most `factor` times as long as that. Ways are those of a point that may turn on the spot.
    Empty among moving obstacles, where classes are those in space and time.
    """
    if isinstance(tree.homology, TimedHomology):
        return []
    try:
        references = tree.references(x, polished=False)
    except NoReference:
        references = []
    passages, goal = tree.passages, tree.space.scene.goal.center
    used = np.zeros(passages.count, dtype=bool)
    for reference in references:
        used |= passages.crossed(reference.trajectory.points)
    place = passages.place[~used]
    cheapest = min((one.length for one in references), default=math.inf)
    around = np.hypot(*(place - x[:2]).T) + np.hypot(*(place - goal).T)  # no way through is shorter
    if cheapest <= factor * math.dist(x[:2], goal) and not np.any(around <= factor * cheapest):
        return []
    ways = _ways(tree, x[:2], place)
    shortest = min((length for length, _ in ways), default=math.inf)
    found = []
    for length, points in ways:
        if length <= factor * shortest:
            suffixes = (tree.homology.turns(points[k:]) for k in range(len(points) - 1))
            limit = max((float(np.abs(turns).max(initial=0.0)) for turns in suffixes), default=0.0)
            if limit > tree.limit:
                found.append(LeftOut(length=length, limit=limit))
    return sorted(found, key=lambda way: way.length)


def _ways(tree: HomologyTree, start: Array, places: Array) -> list[tuple[float, Array]]:
    """The shortest way from a start (2,) to the goal, and those through places (k, 2): lengths, points (l, 2) [m].

    They lead over a coarse lattice and along the axes of passages, which have points where a lattice has none.
    """
    scene, collision = tree.space.scene, tree.space.collision
    spacing = math.sqrt(float(np.prod(scene.upper - scene.lower)) / POINTS)
    lattice = [
        np.arange(low + 0.5 * spacing, high, spacing) for low, high in zip(scene.lower, scene.upper, strict=True)
    ]
    grid = np.stack(np.meshgrid(*lattice), axis=-1).reshape(-1, 2)
    points = np.vstack([start, scene.goal.center, places, tree.passages.way[:, :2], grid])
    free, own = np.empty(len(points)), len(points) - len(grid)
    clearances(tree.space.field, points, free)
    tail, head = cKDTree(points).query_pairs(NEIGHBOURS * spacing, output_type="ndarray").T
    length = np.hypot(*(points[tail] - points[head]).T)
    open_ = (free[tail] > 0.0) & (free[head] > 0.0)
    # Two discs of free space that overlap hold the line between them; on axes of passages they may be too small.
    sure = open_ & (free[tail] + free[head] >= length)
    asked = np.flatnonzero(open_ & ~sure & (tail < own) & (head < own) & (length < scene.robot_radius))
    sure[asked] = collision.segments_free(points[tail[asked]], points[head[asked]])
    graph = csr_matrix((length[sure], (tail[sure], head[sure])), shape=(len(points), len(points)))
    found, before = dijkstra(graph, directed=False, indices=[0, 1], return_predecessors=True)

    def back(row: int, k: int) -> list[int]:
        """Points from k back to the source of a row, both included."""
        chain = [k]
        while before[row, chain[-1]] != NOWHERE:
            chain.append(int(before[row, chain[-1]]))
        return chain

    ways = [(float(found[0, 1]), back(0, 1)[::-1])]
    for k in range(2, 2 + len(places)):
        ways.append((float(found[0, k] + found[1, k]), [*back(0, k)[::-1], *back(1, k)[1:]]))
    return [(length, points[chain]) for length, chain in ways if math.isfinite(length)]
