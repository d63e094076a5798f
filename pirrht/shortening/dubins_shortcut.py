"""Shortening a Dubins path inside its homology class, under the same bound on its curvature.

A round replaces parts of the path by the best chain of Dubins curves between poses along it, then settles the
places where the chain bends. Whatever is put in is free by the clearance field and sweeps the same angles
around the markers as what it replaces.
"""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import Curves, along
from pirrht.shortening.dubins_bends import settle
from pirrht.shortening.dubins_chain import chain
from pirrht.shortening.dubins_legs import Task, append
from pirrht.steering.dubins import Dubins

ROUNDS = (12, 16)  # stations of each round; more rounds or stations gain a few parts in a thousand


def shortcut(path: Curves, steering: Dubins, space: FreeSpace, rounds: tuple[int, ...] = ROUNDS) -> Curves:
    """A path (rows are consecutive curves into the goal's disc) of the same class that is never longer.

    What is kept of the path is not judged again.
    """
    goal = space.scene.goal
    homology = space.homology
    task = Task(space.field, homology.cuts, homology.hash_weights, goal.center, float(goal.radius), steering.radius)
    room = 9 * (path.length.size + max(rounds) + 1)
    pose, curvature, length = np.empty((room, 3)), np.empty(room), np.empty(room)
    count = _pieces(path.start, path.curvature, path.length, pose, curvature, length)
    for stations in rounds:
        if count == 0 or 9 * (count + stations + 1) > room:  # each step can at worst triple the pieces
            break
        count = chain(task, pose, curvature, length, count, stations)
        count = settle(task, pose, curvature, length, count)
    if count == 0 or length[:count].sum() >= path.length.sum():
        return path
    return _in_rows(pose[:count], curvature[:count], length[:count], steering.cost_per_meter)


def _in_rows(pose: Array, curvature: Array, length: Array, cost_per_meter: float) -> Curves:
    """Consecutive pieces as curves of three pieces each."""
    rows = -(-len(length) // 3)
    kappa, ell = np.zeros((2, rows, 3))
    kappa.flat[: len(length)], ell.flat[: len(length)] = curvature, length
    start = pose[::3].copy()
    end = np.array(along(*pose[-1], curvature[-1], length[-1]))
    return Curves(
        start=start,
        curvature=kappa,
        length=ell,
        cost=ell.sum(axis=1) * cost_per_meter,
        tails=start,
        heads=np.vstack([start[1:], end]),
    )


@kernel
def _pieces(start, curvature, length, pose, kappa, ell):  # type: ignore[no-untyped-def]
    """Rows of curves as one list of pieces; number of pieces."""
    count = 0
    for i in range(start.shape[0]):
        count = append(pose, kappa, ell, count, start[i], curvature[i], length[i])
    return count
