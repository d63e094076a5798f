"""Shorten paths of any steering method inside their class: the cheapest chain of its own connections.

A round puts stations along the path, its vertices and states between them, and joins any two by the method's optimal
motion, where that is free, stays outside the goal and turns around the markers as the stretch it replaces. The cheapest
chain from first to last is a shortest path. The first round spreads stations evenly, later ones ever nearer to corners.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, BoolArray
from pirrht.freespace import FreeSpace
from pirrht.geometry.certify import FREE, UNSURE
from pirrht.steering.edges import EdgeChecker, judge_with
from pirrht.steering.motion import Motions
from pirrht.steering.steering import Steering
from pirrht.topology.crossings import Turns

EVEN = 16  # stations of the first round, vertices not counted
CORNERS = 6  # rounds that follow, each with stations twice as near to the corners
GAIN = 1e-5  # two rounds in turn that save less than this share of the cost are the last
AHEAD = 6  # corners of an earlier path that another may go on from
INTO = 1e-3  # of the way from the goal's rim to its centre: where a path ended on the rim the next one ends within
ROUNDING = 1e-6  # share of the cost of a motion by which its parts may cost more


def cheapest_chain(path: Motions, steering: Steering, space: FreeSpace) -> Any:
    """Find a path of consecutive motions into the goal, of one kind and class with `path`, that never costs more."""
    checker = EdgeChecker.of(space, steering)
    idle = 0
    for number in range(1 + CORNERS):
        stations = _stations(path, steering, number)
        found = _joined(checker, steering, stations)
        if found is None:
            continue
        before, after = float(path.cost.sum()), float(found.cost.sum())
        if after < before:
            path = found
        idle = idle + 1 if after > before * (1.0 - GAIN) else 0
        if idle == 2:
            break
    return path


def resumed(x: Array, path: Motions, steering: Steering, space: FreeSpace) -> Any:
    """Find the cheapest path from x (n,) to one of the next corners of an earlier one and on; None if none is free.

    Its class is that of x, the next corner and on, if the motion to that is free; else it may be another.
    """
    goal, corners = space.scene.goal.center, path.heads.copy()
    corners[-1, :2] += INTO * (goal - corners[-1, :2])
    checker, count = EdgeChecker.of(space, steering), min(AHEAD, len(corners))
    to = np.r_[np.arange(count), np.arange(1, count)]  # from x, and from each corner to the next
    tails = np.vstack([np.repeat(x[None], count, axis=0), corners[: count - 1]])
    record = checker.motion.record(steering.connect(tails, corners[to]))
    edges, _ = judge_with(checker.motion.kernels)(checker.around, record, to == len(corners) - 1, to)
    free, direct = edges.free[:count], edges.cost[:count]
    if edges.status[0] == UNSURE:
        free[0] = checker.motion.ask(record, 0, checker.space)
    key = _keys(edges.turns, checker.around.weights)
    if free[0]:
        free &= key[:count] == key[0] + np.concatenate([[0], np.cumsum(key[count:])])
    if not free.any():
        return None
    legs = path.cost[1:]
    onward = legs.sum() - np.concatenate([[0.0], np.cumsum(legs[: count - 1])])
    first = int(np.argmin(np.where(free, direct + onward, np.inf)))
    stations = np.vstack([x, corners[first:]])
    return checker.until_goal(steering.connect(stations[:-1], stations[1:]))


def _stations(path: Motions, steering: Steering, number: int) -> Array:
    """Vertices of a path and states between them, (l, n), for a round."""
    cost, states = path.cost, [path.tails[0]]
    for i, own in enumerate(cost):
        if number == 0:
            count = round(EVEN * own / cost.sum())
            shares = np.arange(1, count + 1) / (count + 1.0)
        else:
            near = 0.5 ** (number + 1)
            shares = np.array([near, 0.5, 1.0 - near])
        between = steering.motion.between(path, i, shares)
        tail, head = path.tails[i], path.heads[i]
        if len(between):
            parts = steering.distance(tail, between) + steering.distance(between, head)
            whole = float(steering.distance(tail, head))
            between = between[parts <= whole * (1.0 + ROUNDING)]
        states += [*between, head]
    return np.array(states)


def _joined(checker: EdgeChecker, steering: Steering, stations: Array) -> Any:
    """Find the cheapest chain of free motions from the first to the last station (l, n), in the class of all, or None.

    Motions between neighbours make the class; FCL is asked of those alone where the clearance field is not certain.
    """
    count = len(stations)
    i, j = np.triu_indices(count, 1)
    motions = steering.connect(stations[i], stations[j])
    record, last = checker.motion.record(motions), j == count - 1
    edges, _ = judge_with(checker.motion.kernels)(checker.around, record, last, j)
    free, next_ = edges.status == FREE, j == i + 1
    for row in np.flatnonzero(next_ & (edges.status == UNSURE)).tolist():
        free[row] = checker.motion.ask(record, row, checker.space)
    if not free[next_].all():
        return None
    key = _keys(edges.turns, checker.around.weights)
    passed = np.concatenate([[0], np.cumsum(key[next_])])
    free &= key == passed[j] - passed[i]
    order = _cheapest(count, i, j, edges.cost, free)
    return checker.until_goal(steering.connect(stations[order[:-1]], stations[order[1:]]))


def _keys(turns: Turns, weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Additive key of the turns of each of k motions, (k,)."""
    summed = np.concatenate([[0], np.cumsum(weights[turns.marker] * turns.turn)])
    return np.asarray(summed[turns.first[1:]] - summed[turns.first[:-1]])


def _cheapest(
    count: int, i: NDArray[np.int64], j: NDArray[np.int64], cost: Array, free: BoolArray
) -> NDArray[np.int64]:
    """Stations of the cheapest chain over free motions from i (k,) to j (k,), which costs (k,), first to last."""
    matrix = np.full((count, count), np.inf)
    matrix[i[free], j[free]] = cost[free]
    best, source = np.full(count, np.inf), np.zeros(count, np.int64)
    best[0] = 0.0
    for to in range(1, count):
        over = best[:to] + matrix[:to, to]
        source[to] = int(np.argmin(over))
        best[to] = over[source[to]]
    order = [count - 1]
    while order[-1] > 0:
        order.append(int(source[order[-1]]))
    return np.array(order[::-1])
