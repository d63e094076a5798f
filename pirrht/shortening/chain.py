"""Shorten paths of any steering method inside their class: the cheapest chain of its own connections.

A path is its vertices; its legs are the method's optimal motions between them. A round puts stations along the path and
joins any two by the optimal motion, if that is certified, stays outside the goal and turns around the markers as the
stretch that it replaces; the cheapest chain is a shortest path over the stations. Then the vertices move, by a pattern
search of ever smaller steps, so that corners come to lie next to what the path bends around.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.arcs import FREE, LEAST_STEP, UNSURE
from pirrht.geometry.field import clearance
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.jit.vectors import copy_row
from pirrht.shortening.tuning import RESUME, TUNING, ChainTuning, ResumeTuning
from pirrht.steering.edges import EdgeChecker, judge_with
from pirrht.steering.motion import MotionKernels, Motions, copied
from pirrht.steering.steering import CompiledSteering, Steering
from pirrht.topology.crossings import Turns, key_of_pairs

Number = Callable[..., float]


class Chain(NamedTuple):
    """Vertices of a path, and its legs between them."""

    states: Array  # (k, n)
    cost: Array  # (k,) of the leg that follows, up to the goal's disc [cost]; the last one is unused
    key: NDArray[np.int64]  # (k,) its additive key


def cheapest_chain(path: Motions, steering: Steering, checker: EdgeChecker, tuning: ChainTuning = TUNING) -> Any:
    """Find a path of consecutive motions into the goal, of one kind and class with `path`, that never costs more."""
    states, motion = np.vstack([path.tails[:1], path.heads]), checker.motion.kernels
    numbers: tuple[float, ...] = ()
    if isinstance(steering, CompiledSteering):
        numbers, kind = steering.numbers, type(steering)
        shorten = _compiled_chain(kind.cost, kind.optimum, motion, kind.shift, steering.n)
    else:  # plain Python

        def cost(tail: Array, head: Array, numbers: tuple[float, ...], limit: float) -> float:
            return float(steering.distance(tail, head))

        def connect(tails: Array, heads: Array, numbers: tuple[float, ...]) -> Any:
            return copied(steering.connect(tails, heads))

        shorten = _chain(cost, connect, motion, type(steering).shift, lambda function: function)
    with np.errstate(over="ignore"):  # keys wrap
        short = shorten(checker.around, numbers, states, steering.moves, tuning)
    found = checker.until_goal(steering.connect(short[:-1], short[1:]))
    return found if found.cost.sum() < path.cost.sum() else path


@cache
def _compiled_chain(cost: Number, connect: Any, motion: MotionKernels, shift: Any, n: int) -> Callable[..., Array]:
    @inlined
    def cost_of_rows(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
        return cost(as_tuple(tail, n), as_tuple(head, n), numbers, limit)

    return _chain(cost_of_rows, connect, motion, shift, kernel)


def _chain(cost_of: Number, connect: Any, motion: MotionKernels, shift: Any, part: Any) -> Callable[..., Array]:
    """Build (around, numbers, states (k, n), moves, tuning) -> the vertices (l, n) of a path that costs no more."""
    entry, cut, certify, pairs, most, between = motion

    @part
    def measure(around, motions, last, scratch):  # type: ignore[no-untyped-def]
        """Cut a single motion at the goal if it is the last one; its cost and additive key."""
        marker, turn = scratch
        if last:
            s = entry(motions, 0, around)
            if s < np.inf:
                cut(motions, 0, s)
        count = pairs(motions, 0, around, last, marker, turn, 0)
        return motions.cost[0], key_of_pairs(marker, turn, 0, count, around.weights)

    @part
    def admissible(around, motions, last):  # type: ignore[no-untyped-def]
        """Tell whether a single motion is certified, and outside the goal or, cut there, the last one."""
        outside = last or entry(motions, 0, around) == np.inf
        return outside and certify(motions, 0, around, False) == FREE

    @part
    def stations_of(around, numbers, states, count, tuning, scratch, out):  # type: ignore[no-untyped-def]
        """Write stations along a path and the legs between them to a `Chain`; the number of stations."""
        stations, cost, key = out
        legs, spacing = len(states) - 1, 0.0
        for i in range(legs):
            leg = connect(states[i : i + 1], states[i + 1 : i + 2], numbers)
            cost[i], _ = measure(around, leg, i == legs - 1, scratch)
            spacing += cost[i] / count
        used, row = 1, np.empty((1, states.shape[1]))
        copy_row(states[0], stations[0])
        for i in range(legs):
            tail, head = states[i : i + 1], states[i + 1 : i + 2]
            leg, parts = connect(tail, head, numbers), max(1, math.ceil(cost[i] / spacing))
            whole = leg.cost[0] * (1.0 + tuning.rounding)
            measure(around, leg, i == legs - 1, scratch)
            for p in range(1, parts):
                if between(leg, 0, p / parts, row[0]):
                    first = cost_of(tail[0], row[0], numbers, np.inf)
                    if first + cost_of(row[0], head[0], numbers, np.inf) <= whole:
                        copy_row(row[0], stations[used])
                        used += 1
            copy_row(states[i + 1], stations[used])
            used += 1
        for i in range(used - 1):
            leg = connect(stations[i : i + 1], stations[i + 1 : i + 2], numbers)
            cost[i], key[i] = measure(around, leg, i == used - 2, scratch)
        return used

    @part
    def cheapest(around, numbers, along, tuning, scratch, out):  # type: ignore[no-untyped-def]
        """Write the vertices of the cheapest chain over the stations `along` a path; their number."""
        stations, cost, key = along
        count = len(stations)
        best, source, passed = np.zeros(count), np.zeros(count, np.int64), np.zeros(count, np.int64)
        total, charge = np.empty(count), tuning.leg_charge * np.sum(cost[: count - 1])
        for j in range(1, count):
            last, inside = j == count - 1, 0.0
            best[j], source[j], passed[j] = best[j - 1] + cost[j - 1] + charge, j - 1, passed[j - 1] + key[j - 1]
            limit = best[j] + 0.5 * charge
            if last:  # motions end where they enter the goal's disc, which saves about the same on all paths
                inside = cost_of(stations[j - 1], stations[j], numbers, np.inf) - cost[j - 1]
            else:
                limit -= tuning.link_gain * best[j]
            for i in range(j):
                total[i] = best[i] + charge - inside
                total[i] += cost_of(stations[i], stations[j], numbers, limit - total[i])
            while True:
                i = int(np.argmin(total[:j]))
                if not total[i] < limit:
                    break
                leg = connect(stations[i : i + 1], stations[j : j + 1], numbers)
                own, turned = measure(around, leg, last, scratch)
                own += best[i] + charge
                if turned == passed[j] - passed[i] and own < best[j] and admissible(around, leg, last):
                    best[j], source[j] = own, i
                    if not last:
                        break
                total[i] = np.inf
        used, j = 1, count - 1
        while j > 0:
            j = source[j]
            used += 1
        j = count - 1
        for i in range(used - 1, -1, -1):
            copy_row(stations[j], out[i])
            j = source[j]
        return used

    @part
    def move(around, numbers, path, i, trial, tuning, scratch):  # type: ignore[no-untyped-def]
        """Move vertex i to the trial state (1, n) if its legs become admissible and cheaper; whether it did."""
        states, cost, key = path
        last, tail = i == len(states) - 1, states[i - 1 : i]
        limit, turned, least = cost[i - 1], key[i - 1], 0.0
        if clearance(around.field, trial[0, 0], trial[0, 1]) < LEAST_STEP:
            return False
        if not last:
            limit, turned = limit + cost[i], turned + key[i]
            if i < len(states) - 2:
                least = cost_of(trial[0], states[i + 1], numbers, limit)
        limit *= 1.0 - tuning.move_gain
        if not last and not least + cost_of(tail[0], trial[0], numbers, limit - least) < limit:
            return False
        first = connect(tail, trial, numbers)
        own, passed = measure(around, first, last, scratch)
        if not last:
            second, ends = connect(trial, states[i + 1 : i + 2], numbers), i == len(states) - 2
            rest, after = measure(around, second, ends, scratch)
            if not own + rest < limit or passed + after != turned:
                return False
            if not admissible(around, first, False) or not admissible(around, second, ends):
                return False
            cost[i], key[i] = rest, after
        elif not own < limit or passed != turned or not admissible(around, first, True):
            return False
        cost[i - 1], key[i - 1] = own, passed
        copy_row(trial[0], states[i])
        return True

    @part
    def search(around, numbers, states, moves, tuning, scratch):  # type: ignore[no-untyped-def]
        """Move the vertices (k, n) but the first, in place; the last one stays at the goal point."""
        k = len(states)
        cost, key, trial = np.empty(k), np.empty(k, np.int64), states[:1].copy()
        for i in range(k - 1):
            leg = connect(states[i : i + 1], states[i + 1 : i + 2], numbers)
            cost[i], key[i] = measure(around, leg, i == k - 2, scratch)
        for level in range(tuning.levels):
            for i in range(1, k):
                for m in range(moves):
                    shift(states[i], m, tuning.first_step * 0.5**level, numbers, trial[0])
                    if i == k - 1:
                        trial[0, 0], trial[0, 1] = states[i, 0], states[i, 1]
                    move(around, numbers, Chain(states, cost, key), i, trial, tuning, scratch)

    @part
    def shortened(around, numbers, states, moves, tuning):  # type: ignore[no-untyped-def]
        """Chain and search in turn."""
        crossings = most(connect(states[:1], states[1:2], numbers)) * len(around.weights)
        scratch = np.empty(crossings, np.int32), np.empty(crossings, np.int16)
        for count in tuning.stations:
            room = len(states) + count + 1
            along = Chain(np.empty((room, states.shape[1])), np.empty(room), np.empty(room, np.int64))
            used = stations_of(around, numbers, states, count, tuning, scratch, along)
            along = Chain(along.states[:used], along.cost, along.key)
            out = np.empty((used, states.shape[1]))
            states = out[: cheapest(around, numbers, along, tuning, scratch, out)].copy()
            search(around, numbers, states, moves, tuning, scratch)
        return states

    found: Callable[..., Array] = shortened
    return found


def resumed(x: Array, path: Motions, steering: Steering, checker: EdgeChecker, tuning: ResumeTuning = RESUME) -> Any:
    """Find the cheapest path from x (n,) to one of the next corners of an earlier one and on; None if none is free.

    Its class is that of x, the next corner and on, if the motion to that is free; else it may be another.
    """
    goal, corners = checker.space.scene.goal.center, path.heads.copy()
    corners[-1, :2] += tuning.into_goal * (goal - corners[-1, :2])
    count = min(tuning.corners, len(corners))
    to = np.r_[np.arange(count), np.arange(1, count)]  # from x, and from each corner to the next
    tails = np.vstack([np.repeat(x[None], count, axis=0), corners[: count - 1]])
    motions = copied(steering.connect(tails, corners[to]))
    edges, _ = judge_with(checker.motion.kernels)(checker.around, motions, to == len(corners) - 1, to)
    free, direct = edges.free[:count], edges.cost[:count]
    if edges.status[0] == UNSURE:
        free[0] = checker.motion.free(motions, 0, checker.space)
    key = keys_of(edges.turns, checker.around.weights)
    if free[0]:
        free &= key[:count] == key[0] + np.concatenate([[0], np.cumsum(key[count:])])
    if not free.any():
        return None
    legs = path.cost[1:]
    onward = legs.sum() - np.concatenate([[0.0], np.cumsum(legs[: count - 1])])
    first = int(np.argmin(np.where(free, direct + onward, np.inf)))
    stations = np.vstack([x, corners[first:]])
    return checker.until_goal(steering.connect(stations[:-1], stations[1:]))


def keys_of(turns: Turns, weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Additive key of the turns of each of k motions, (k,)."""
    summed = np.concatenate([[0], np.cumsum(weights[turns.marker] * turns.turn)])
    return np.asarray(summed[turns.first[1:]] - summed[turns.first[:-1]])
