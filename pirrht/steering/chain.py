"""Shorten paths of any steering method inside their class: the cheapest chain of its own connections.

A path is its vertices; its legs are the method's optimal motions between them. A round puts stations along the path and
joins any two by the optimal motion, if that is certified, stays outside the goal and turns around the markers as the
stretch that it replaces; the cheapest chain is a shortest path over the stations. Then the vertices move, by a pattern
search of ever smaller steps, so that corners come to lie next to what the path bends around.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.geometry.space import FREE, LEAST_STEP, UNSURE, StateKernels
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.jit.vectors import copy_row
from pirrht.steering.edges import EdgeChecker, judge_with
from pirrht.steering.motion import MotionKernels, Motions, copied
from pirrht.steering.tuning import CHAIN, RESUME, ChainTuning, ResumeTuning
from pirrht.topology.pairs import Turns, key_of_pairs

Number = Callable[..., float]
Connect = Callable[[Array, Array], Any]  # optimal motions from tails (k, n) to heads (k, n), as `Steering.connect`


class Chain(NamedTuple):
    """Vertices of a path, and its legs between them."""

    states: Array  # (k, n)
    cost: Array  # (k,) of the leg that follows, up to the goal's disc [cost]; the last one is unused
    key: NDArray[np.int64]  # (k,) its additive key


def cheapest_chain(
    path: Motions, connect: Connect, chain: Callable[..., Array], numbers: tuple[float, ...], moves: int,
    checker: EdgeChecker, tuning: ChainTuning = CHAIN,
) -> Any:  # fmt: skip
    """Find a path of consecutive motions into the goal, of one kind and class with `path`, that never costs more.

    `chain` is one of `plain_chain` or `compiled_chain`, which takes `numbers`; `moves` are those that its shift knows.
    """
    states = np.vstack([path.tails[:1], path.heads])
    with np.errstate(over="ignore"):  # keys wrap
        short = chain(checker.around, numbers, states, moves, tuning)
    found = checker.until_goal(connect(short[:-1], short[1:]))
    return found if found.cost.sum() < path.cost.sum() else path


def plain_chain(
    distance: Callable[..., Any], connect: Connect, motion: MotionKernels, states: StateKernels, shift: Any
) -> Callable[..., Array]:
    """Build a chain in plain Python, by the cost between two states (n,) and their optimal motion."""

    def cost(tail: Array, head: Array, numbers: tuple[float, ...], limit: float) -> float:
        return float(distance(tail, head))

    def optimum(tails: Array, heads: Array, numbers: tuple[float, ...]) -> Any:
        return copied(connect(tails, heads))

    return _chain(cost, optimum, motion, states, shift, lambda function: function)


@cache
def compiled_chain(
    cost: Number, connect: Any, motion: MotionKernels, states: StateKernels, shift: Any, n: int
) -> Callable[..., Array]:  # fmt: skip
    """Build a chain in compiled code, by kernels of a `CompiledSteering` for states of n numbers."""

    @inlined
    def cost_of_rows(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
        return cost(as_tuple(tail, n), as_tuple(head, n), numbers, limit)

    return _chain(cost_of_rows, connect, motion, states, shift, kernel)


def _chain(
    cost_of: Number, connect: Any, motion: MotionKernels, kernels: StateKernels, shift: Any, part: Any
) -> Callable[..., Array]:  # fmt: skip
    """Build (around, numbers, states (k, n), moves, tuning) -> the vertices (l, n) of a path that costs no more."""
    position = kernels.position
    entry, cut, certify, pairs, most, between = motion
    clearance = kernels.clearance

    @part
    def join(around, numbers, tail, head, last, scratch):  # type: ignore[no-untyped-def]
        """Join two states (1, n), up to the goal if it is the `last` motion; the motion, its cost and additive key."""
        (marker, turn), motion = scratch, connect(tail, head, numbers)
        s = entry(motion, 0, around) if last else np.inf
        if s < np.inf:
            cut(motion, 0, s)
        count = pairs(motion, 0, around, last, marker, turn, 0)
        return motion, motion.cost[0], key_of_pairs(marker, turn, 0, count, around.weights)

    @part
    def admissible(around, motion, last):  # type: ignore[no-untyped-def]
        """Return whether a single motion is certified, and outside the goal or, cut there, the last one."""
        return (last or entry(motion, 0, around) == np.inf) and certify(motion, 0, around, False) == FREE

    @part
    def stations_of(around, numbers, path, count, tuning, scratch, out):  # type: ignore[no-untyped-def]
        """Write stations along a `Chain`, about so many, to `out` (l, n); their number."""
        states, cost, _ = path

        last = len(states) - 2
        used = 1
        row = np.empty((1, states.shape[1]))

        spacing = np.sum(cost[: last + 1]) / count
        copy_row(states[0], out[0])
        for i in range(last + 1):
            tail = states[i : i + 1]
            head = states[i + 1 : i + 2]
            motion, _, _ = join(around, numbers, tail, head, i == last, scratch)
            whole = cost_of(tail[0], head[0], numbers, np.inf) * (1.0 + tuning.rounding)
            parts = max(1, math.ceil(cost[i] / spacing))
            for p in range(1, parts):
                if between(motion, 0, p / parts, row[0]):
                    first = cost_of(tail[0], row[0], numbers, np.inf)
                    if first + cost_of(row[0], head[0], numbers, np.inf) <= whole:
                        copy_row(row[0], out[used])
                        used += 1
            copy_row(states[i + 1], out[used])
            used += 1
        return used

    @part
    def cheapest(around, numbers, along, tuning, scratch, out):  # type: ignore[no-untyped-def]
        """Write the vertices of the cheapest chain over the stations `along` a path; their number."""
        stations, cost, key = along
        count = len(stations)

        best = np.zeros(count)
        source = np.zeros(count, np.int64)
        passed = np.zeros(count, np.int64)

        total = np.empty(count)
        charge = tuning.leg_charge * np.sum(cost[: count - 1])

        for j in range(1, count):
            last, inside = j == count - 1, 0.0

            best[j] = best[j - 1] + cost[j - 1] + charge
            source[j] = j - 1
            passed[j] = passed[j - 1] + key[j - 1]

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
                tail = stations[i : i + 1]
                motion, own, turned = join(around, numbers, tail, stations[j : j + 1], last, scratch)
                own += best[i] + charge
                if turned == passed[j] - passed[i] and own < best[j] and admissible(around, motion, last):
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
        """Move vertex i to the trial state (1, n) if its legs become admissible and cheaper."""
        states, cost, key = path
        last = i == len(states) - 1
        tail = states[i - 1 : i]

        limit = cost[i - 1]
        turned = key[i - 1]
        least = 0.0

        if clearance(around.static, trial[0]) < LEAST_STEP:
            return
        if not last:
            limit = limit + cost[i]
            turned = turned + key[i]

            if i < len(states) - 2:
                least = cost_of(trial[0], states[i + 1], numbers, limit)
        limit *= 1.0 - tuning.move_gain
        if not last and not least + cost_of(tail[0], trial[0], numbers, limit - least) < limit:
            return
        first, own, passed = join(around, numbers, tail, trial, last, scratch)
        if not last:
            ends = i == len(states) - 2
            second, rest, after = join(around, numbers, trial, states[i + 1 : i + 2], ends, scratch)
            if not own + rest < limit or passed + after != turned:
                return
            if not admissible(around, first, False) or not admissible(around, second, ends):
                return
            cost[i], key[i] = rest, after
        elif not own < limit or passed != turned or not admissible(around, first, True):
            return
        cost[i - 1], key[i - 1] = own, passed
        copy_row(trial[0], states[i])

    @part
    def search(around, numbers, path, moves, tuning, scratch):  # type: ignore[no-untyped-def]
        """Move the vertices of a `Chain` but the first, in place; the last one stays at the goal point."""
        states, trial = path.states, path.states[:1].copy()
        for level in range(tuning.levels):
            for i in range(1, len(states)):
                for m in range(moves):
                    shift(states[i], m, tuning.first_step * 0.5**level, numbers, trial[0])
                    if i == len(states) - 1:
                        for k in range(position):
                            trial[0, k] = states[i, k]
                    move(around, numbers, path, i, trial, tuning, scratch)

    @part
    def chain_of(around, numbers, states, scratch):  # type: ignore[no-untyped-def]
        """Make a `Chain` of states (k, n)."""
        cost = np.empty(len(states))
        key = np.empty(len(states), np.int64)

        for i in range(len(states) - 1):
            _, cost[i], key[i] = join(
                around, numbers, states[i : i + 1], states[i + 1 : i + 2], i == len(states) - 2, scratch
            )
        return Chain(states, cost, key)

    @part
    def shortened(around, numbers, states, moves, tuning):  # type: ignore[no-untyped-def]
        """Chain and search in turn."""
        crossings = most(connect(states[:1], states[1:2], numbers)) * len(around.weights)
        scratch = np.empty(crossings, np.int32), np.empty(crossings, np.int16)
        path = chain_of(around, numbers, states, scratch)
        for count in tuning.stations:
            out = np.empty((len(path.states) + count + 1, states.shape[1]))
            used = stations_of(around, numbers, path, count, tuning, scratch, out)
            along = chain_of(around, numbers, out[:used], scratch)
            chosen = np.empty((used, states.shape[1]))
            used = cheapest(around, numbers, along, tuning, scratch, chosen)
            path = chain_of(around, numbers, chosen[:used], scratch)
            search(around, numbers, path, moves, tuning, scratch)
        return path.states

    return cast(Callable[..., Array], shortened)


def shortcut_with(key_of: Callable[..., int], joins: Callable[..., bool]) -> Callable[..., int]:
    """Build the kernel that leaves out knots between others which a straight line of one class joins, in place.

    Args:
        key_of: (around, a (n,), b (n,), last) -> additive key of the line from a to b; `last`: into the goal.
        joins: (around, numbers, a, b, last, key) -> whether the line may be taken, and has the key.
    """

    @kernel
    def shortcut(around, numbers, knots, ahead):  # type: ignore[no-untyped-def]
        """Number of the knots (k, n) that stay; a line is as long as it gets after so many others `ahead` in vain."""
        count, kept, i = knots.shape[0], 1, 0
        keys = np.zeros(count, np.int64)
        for k in range(count - 1):
            keys[k + 1] = keys[k] + key_of(around, knots[k], knots[k + 1], k == count - 2)
        while i < count - 1:
            to = i + 1
            j = i + 2

            while j < count and j <= to + ahead:
                if joins(around, numbers, knots[i], knots[j], j == count - 1, keys[j] - keys[i]):
                    to = j
                j += 1
            copy_row(knots[to], knots[kept])
            keys[kept] = keys[to]
            kept, i = kept + 1, to
        return kept

    return cast(Callable[..., int], shortcut)


def resumed(x: Array, path: Motions, connect: Connect, checker: EdgeChecker, tuning: ResumeTuning = RESUME) -> Any:
    """Find the cheapest path from x (n,) to one of the next corners of an earlier one and on; None if none is free.

    Its class is that of x, the next corner and on, if the motion to that is free; else it may be another.
    """
    corners = path.heads.copy()
    count = min(tuning.corners, len(path.heads))

    goal = checker.space.scene.goal.center
    place = corners[-1, : len(goal)]
    place += tuning.into_goal * (goal - place)
    to = np.r_[np.arange(count), np.arange(1, count)]  # from x, and from each corner to the next
    motions = copied(connect(np.vstack([np.repeat(x[None], count, axis=0), corners[: count - 1]]), corners[to]))
    edges, _ = judge_with(checker.kernels)(checker.around, motions, to == len(corners) - 1, to)
    free = edges.free[:count]
    direct = edges.cost[:count]

    if edges.status[0] == UNSURE:
        free[0] = checker.resolved(motions, 0)
    key = keys_of(edges.turns, checker.around.weights)
    if free[0]:
        free &= key[:count] == key[0] + np.concatenate([[0], np.cumsum(key[count:])])
    if not free.any():
        return None
    onward = np.cumsum(path.cost[::-1])[::-1] - path.cost  # from each corner
    stations = np.vstack([x, corners[int(np.argmin(np.where(free, direct + onward[:count], np.inf))) :]])
    return checker.until_goal(connect(stations[:-1], stations[1:]))


def keys_of(turns: Turns, weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Additive key of the turns of each of k motions, (k,)."""
    summed = np.concatenate([[0], np.cumsum(weights[turns.marker] * turns.turn)])
    return np.asarray(summed[turns.first[1:]] - summed[turns.first[:-1]])
