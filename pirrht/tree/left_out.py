"""Ways that H_limit leaves out although they are short: |1 - H_i| along them is greater."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree

FACTOR = 1.25  # a way of no more than so many times the shortest matters
POINTS = 4000  # of the grid on which ways are measured, at most
STEPS = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))  # to neighbours: at most 3 % too long
NOWHERE = -9999  # what SciPy has before the first point of a way


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A collision-free way that no allowed class takes."""

    length: float  # [m]
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
    """The shortest way from a start (2,) to the goal, and those through places (k, 2): lengths, points (l, 2) [m]."""
    scene = tree.space.scene
    size = scene.upper - scene.lower
    spacing = max(0.5 * scene.robot_radius, math.sqrt(float(np.prod(size)) / POINTS))
    ends = np.vstack([start[None], scene.goal.center[None], places])
    nx, ny = np.maximum(np.ceil(size / spacing).astype(int), 2) + 1
    i, j = (one.ravel() for one in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    points = np.vstack([scene.lower + np.column_stack([i, j]) * size / [nx - 1, ny - 1], ends])
    tails, heads = [], []
    number = np.arange(nx * ny).reshape(nx, ny)
    for di, dj in STEPS:
        tails.append(number[: nx - di, max(0, -dj) : ny - max(0, dj)].ravel())
        heads.append(number[di:, max(0, dj) : ny - max(0, -dj)].ravel())
    for k in range(nx * ny, len(points)):
        near = np.flatnonzero(np.hypot(*(points[: nx * ny] - points[k]).T) < 2.5 * spacing)
        tails.append(np.full(len(near), k))
        heads.append(near)
    tail, head = np.concatenate(tails), np.concatenate(heads)
    free = tree.space.collision.clearance(points)
    length = np.hypot(*(points[tail] - points[head]).T)
    # Clearance changes no faster than the place: two discs of free space that overlap hold the line between them.
    open_ = (free[tail] > 0.0) & (free[head] > 0.0)
    sure = open_ & (free[tail] + free[head] >= length)
    asked = np.flatnonzero(open_ & ~sure)
    sure[asked] = tree.space.collision.segments_free(points[tail[asked]], points[head[asked]])
    graph = csr_matrix((length[sure], (tail[sure], head[sure])), shape=(len(points), len(points)))
    begin, end = nx * ny, nx * ny + 1
    found, before = dijkstra(graph, directed=False, indices=[begin, end], return_predecessors=True)

    def back(row: int, k: int) -> list[int]:
        """Points from k back to the source of a row, both included."""
        chain = [k]
        while before[row, chain[-1]] != NOWHERE:
            chain.append(int(before[row, chain[-1]]))
        return chain

    ways = [(float(found[0, end]), back(0, end)[::-1])]
    for k in range(end + 1, len(points)):
        ways.append((float(found[0, k] + found[1, k]), [*back(0, k)[::-1], *back(1, k)[1:]]))
    return [(length, points[chain]) for length, chain in ways if math.isfinite(length)]
