"""Find the H_limit that short paths require: |1 - H_i| along them may exceed that of a tree."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.planner.tree import HomologyTree

LONGER = 1.25  # paths of so many times the shortest length matter


def required_limit(tree: HomologyTree, x: Array) -> float:
    """Return the least H_limit [turns] that allows the short path of every class of a tree of a wide limit from x (n,).

    Paths of at most 1.25 times the shortest matter. Among moving obstacles it is 0: classes are in space and time.
    """
    if tree.steering.timed:
        return 0.0
    try:
        references = tree.references(x)
    except NoReference:
        return 0.0
    shortest, least = min(one.length for one in references), 0.0
    for points in (one.trajectory.points for one in references if one.length <= LONGER * shortest):
        a, b = points[:-1, None, :2] - tree.homology.markers, points[1:, None, :2] - tree.homology.markers
        turns = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1)) / (2.0 * np.pi)
        rest = np.cumsum(turns[::-1], axis=0)  # 1 - H of the rest of the path
        least = max(least, float(np.abs(rest).max(initial=0.0)))
    return least


def surely_wide(tree: HomologyTree, x: Array) -> bool:
    """Return whether a reference is nearly straight, and no unused passage near enough for a short path."""
    if tree.steering.timed:
        return bool(tree.lengths(tree.at(x, 0.0)))
    try:
        references = tree.references(x, shortened=False)
    except NoReference:
        return False
    passages, goal = tree.passages, tree.space.scene.goal.center
    used = np.any([passages.crossed(reference.trajectory.points) for reference in references], axis=0)
    place, cheapest = passages.place[~used], min(one.length for one in references)
    around = np.hypot(*(place - x[:2]).T) + np.hypot(*(place - goal).T)  # no path through is shorter
    return cheapest <= LONGER * math.dist(x[:2], goal) and not np.any(around <= LONGER * cheapest)
