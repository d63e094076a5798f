"""Find the H_limit that short paths require: |1 - H_i| along them may exceed that of a tree."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.errors import NoReference
from pirrht.geometry.field import clearances
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import hash_weights

LONGER = 1.25  # paths of so many times the shortest length matter
LATTICES = (4000, 16_000, 64_000)  # points on which paths are measured: few are quick
NEIGHBOURS = 2.3  # lattice points so many spacings apart are joined: in the open at most 3 % too long


def required_limit(tree: HomologyTree, x: Array) -> float:
    """Return the least H_limit [turns] that allows every short path from x (n,); 0 where the tree's limit does.

    Paths lead to any point by the shortest path and on to the goal by the shortest path. Those of at most 1.25 times
    the shortest of all matter, one per class. They are those of a point that may turn on the spot. Among moving
    obstacles it is 0, since classes are those in space and time.
    """
    if tree.steering.timed or tree.homology.M == 0 or _surely_allowed(tree, x):
        return 0.0
    for count in LATTICES:
        points, before, length = _shortest_paths(tree, x[:2], count)
        whole = length.sum(axis=0)
        if math.isfinite(whole[0]):
            break
    else:
        return 0.0
    near = np.flatnonzero(whole <= LONGER * whole[0])
    near = near[np.argsort(whole[near], kind="stable")]
    markers = tree.homology.markers
    back, on = (_turns(points, row, markers, near) for row in before)
    windings = np.rint(on - back - tree.homology.base(x)).astype(np.int64)
    _, shortest = np.unique(windings @ hash_weights(tree.homology.M), return_index=True)
    least = 0.0
    for k in near[shortest].tolist():
        path = points[[*_chain(before[0], k)[::-1], *_chain(before[1], k)[1:]]]
        rest = np.cumsum(_turns_of(path[:-1], path[1:], markers)[::-1], axis=0)  # H of the rest of the path
        least = max(least, float(np.abs(rest).max()))
    return least if least > tree.limit else 0.0


def _surely_allowed(tree: HomologyTree, x: Array) -> bool:
    """Return whether a reference is nearly straight, and no unused passage near enough for a short path."""
    try:
        references = tree.references(x, shortened=False)
    except NoReference:
        return False
    passages, goal = tree.passages, tree.space.scene.goal.center
    used = np.any([passages.crossed(reference.trajectory.points) for reference in references], axis=0)
    place, cheapest = passages.place[~used], min(one.length for one in references)
    around = np.hypot(*(place - x[:2]).T) + np.hypot(*(place - goal).T)  # no path through is shorter
    return cheapest <= LONGER * math.dist(x[:2], goal) and not np.any(around <= LONGER * cheapest)


def _shortest_paths(tree: HomologyTree, start: Array, count: int) -> tuple[Array, IntArray, Array]:
    """Return points (k, 2) [m], predecessors on shortest paths from start and goal, and lengths of these, (2, k) each.

    They are a lattice of about `count` points and the axes of passages, which have points where a lattice has none.
    """
    from scipy.sparse import csr_matrix  # these take a tenth of a second, and most scenes need no paths
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    scene, collision = tree.space.scene, tree.space.collision
    spacing = math.sqrt(float(np.prod(scene.upper - scene.lower)) / count)
    axes = [np.arange(low + 0.5 * spacing, high, spacing) for low, high in zip(scene.lower, scene.upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    points = np.vstack([start, scene.goal.center, tree.passages.axis[:, :2], grid])
    free, own = np.empty(len(points)), len(points) - len(grid)
    clearances(tree.space.field, points, free)
    tail, head = cKDTree(points).query_pairs(NEIGHBOURS * spacing, output_type="ndarray").T
    length = np.hypot(*(points[tail] - points[head]).T)
    open_ = (free[tail] > 0.0) & (free[head] > 0.0)
    # Two discs of free space that overlap hold the line between them; on axes of passages they may be too small.
    sure = open_ & (free[tail] + free[head] >= length)
    doubtful = np.flatnonzero(open_ & ~sure & ((tail < own) | (head < own)))
    sure[doubtful] = collision.segments_free(points[tail[doubtful]], points[head[doubtful]])
    graph = csr_matrix((length[sure], (tail[sure], head[sure])), shape=(len(points), len(points)))
    lengths, before = dijkstra(graph, directed=False, indices=[0, 1], return_predecessors=True)
    return points, before, lengths


def _turns_of(a: Array, b: Array, markers: Array) -> Array:
    """Turns about markers (M, 2) of straight lines from points a to b, (k, 2) each, (k, M) [turns]."""
    a, b = a[:, None] - markers, b[:, None] - markers
    return np.asarray(np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1)) / (2.0 * np.pi))


def _turns(points: Array, before: IntArray, markers: Array, near: IntArray) -> Array:
    """Turns about markers (M, 2) of the paths from points `near` (k,) back to the first of all, (k, M) [turns]."""
    own = np.arange(len(near))
    index = np.full(len(points), -1)
    index[near] = own
    parent = np.where(before[near] < 0, own, index[np.maximum(before[near], 0)])
    turns = _turns_of(points[near], points[near][parent], markers)
    while np.any(parent != parent[parent]):  # the path doubles each time
        turns += turns[parent]
        parent = parent[parent]
    return turns


def _chain(before: IntArray, k: int) -> list[int]:
    """Points from k back to the first of all, both included."""
    chain = [k]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return chain
