"""Short ways that H_limit leaves out: |1 - H_i| along them is greater."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.errors import NoReference
from pirrht.geometry.field import clearances
from pirrht.planner.tree import HomologyTree
from pirrht.planner.tuning import TUNING
from pirrht.topology.signature import hash_weights


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A class of collision-free ways that is not allowed."""

    length: float  # of its shortest way on a lattice: next to walls up to 15 % too long [m]
    limit: float  # the least H_limit that allows it [turns]


def left_out(tree: HomologyTree, x: Array, factor: float = TUNING.left_out_factor) -> list[LeftOut]:
    """The classes of ways from x (n,) that H_limit leaves out and that the robot might want, shortest first.

    Ways lead to any point by the shortest way and on to the goal by the shortest way; those of at most `factor` times
    the shortest of all matter. They are those of a point that may turn on the spot. Empty among moving obstacles, where
    classes are those in space and time.
    """
    if tree.steering.timed or tree.homology.M == 0 or _surely_none(tree, x, factor):
        return []
    for count in TUNING.lattices:
        points, before, length = _shortest_ways(tree, x[:2], count)
        whole = length.sum(axis=0)
        if math.isfinite(whole[0]):
            break
    else:
        return []
    near = np.flatnonzero(whole <= factor * whole[0])
    to, on = (_turns(points, before[row], tree.homology.markers, near) for row in (0, 1))
    to *= -1.0  # both are turns from a point to the end of its row
    windings = np.rint(to + on - tree.homology.base(x)).astype(np.int64)
    keys = windings @ hash_weights(tree.homology.M)
    order = np.argsort(whole[near], kind="stable")
    _, first = np.unique(keys[order], return_index=True)
    number = {int(k): row for row, k in enumerate(near)}
    found = []
    for row in order[first].tolist():
        limit = 0.0
        for k in _back(before[0], int(near[row])):
            limit = max(limit, float(np.abs(to[row] - to[number[k]] + on[row]).max()))
        for k in _back(before[1], int(near[row])):
            limit = max(limit, float(np.abs(on[number[k]]).max()))
        if limit > tree.limit:
            found.append(LeftOut(length=float(whole[near[row]]), limit=limit))
    return sorted(found, key=lambda one: one.length)


def _surely_none(tree: HomologyTree, x: Array, factor: float) -> bool:
    """Return whether a reference is nearly straight, and no unused passage near enough for a short path."""
    try:
        references = tree.references(x, polished=False)
    except NoReference:
        return False
    passages, goal = tree.passages, tree.space.scene.goal.center
    used = np.zeros(passages.count, dtype=bool)
    for reference in references:
        used |= passages.crossed(reference.trajectory.points)
    place = passages.place[~used]
    cheapest = min(one.length for one in references)
    around = np.hypot(*(place - x[:2]).T) + np.hypot(*(place - goal).T)  # no way through is shorter
    return cheapest <= factor * math.dist(x[:2], goal) and not np.any(around <= factor * cheapest)


def _shortest_ways(tree: HomologyTree, start: Array, count: int) -> tuple[Array, IntArray, Array]:
    """Points (k, 2) [m], and what comes before each on its shortest way from start and goal, with its length, (2, k).

    They are a lattice of about `count` points and the axes of passages, which have points where a lattice has none.
    """
    from scipy.sparse import csr_matrix  # these take a tenth of a second, and most scenes ask for no ways
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    scene, collision = tree.space.scene, tree.space.collision
    spacing = math.sqrt(float(np.prod(scene.upper - scene.lower)) / count)
    lattice = [
        np.arange(low + 0.5 * spacing, high, spacing) for low, high in zip(scene.lower, scene.upper, strict=True)
    ]
    grid = np.stack(np.meshgrid(*lattice), axis=-1).reshape(-1, 2)
    points = np.vstack([start, scene.goal.center, tree.passages.axis[:, :2], grid])
    free, own = np.empty(len(points)), len(points) - len(grid)
    clearances(tree.space.field, points, free)
    tail, head = cKDTree(points).query_pairs(TUNING.neighbours * spacing, output_type="ndarray").T
    length = np.hypot(*(points[tail] - points[head]).T)
    open_ = (free[tail] > 0.0) & (free[head] > 0.0)
    # Two discs of free space that overlap hold the line between them; on axes of passages they may be too small.
    sure = open_ & (free[tail] + free[head] >= length)
    doubtful = np.flatnonzero(open_ & ~sure & ((tail < own) | (head < own)))
    sure[doubtful] = collision.segments_free(points[tail[doubtful]], points[head[doubtful]])
    graph = csr_matrix((length[sure], (tail[sure], head[sure])), shape=(len(points), len(points)))
    found, before = dijkstra(graph, directed=False, indices=[0, 1], return_predecessors=True)
    return points, before, found


def _turns(points: Array, before: IntArray, markers: Array, near: IntArray) -> Array:
    """Turns about markers (M, 2) of the ways from points `near` (k,) back to the first of all, (k, M) [turns]."""
    index = np.full(len(points), -1)
    index[near] = np.arange(len(near))
    parent = np.where(before[near] < 0, np.arange(len(near)), index[np.maximum(before[near], 0)])
    a, b = points[near][:, None] - markers, points[near][parent][:, None] - markers
    turns = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1)) / (2.0 * np.pi)
    while np.any(parent != parent[parent]):  # the way doubles each time
        turns += turns[parent]
        parent = parent[parent]
    return np.asarray(turns)


def _back(before: IntArray, k: int) -> list[int]:
    """Points from k back to the first of all, both included."""
    chain = [k]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return chain
