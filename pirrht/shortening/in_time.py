"""Shorten paths in space and time inside their class, until they are nearly the optimum of the class.

Knots between two others are left out where the straight line between those is free, within the limit of speeds and of
one class: that never costs more. Then all knots move, in space and time, to where the path costs least
(`timed_relaxation`), more of them where it bends. The result counts only if it is certified and of the class.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import FREE
from pirrht.geometry.scene import Goal
from pirrht.geometry.world import MovingKernels
from pirrht.jit.jit import kernel
from pirrht.shortening.timed_relaxation import relaxation
from pirrht.shortening.tuning import IN_TIME as TUNING
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.in_time import LATE, InTime, entered, free_leg
from pirrht.steering.motion import Legs
from pirrht.topology.crossings import key_of_pairs
from pirrht.topology.moving_crossings import crossings_of_leg


def taut_in_time(path: Legs, steering: InTime, checker: EdgeChecker) -> Legs:
    """Shorten a path into the goal's disc inside its class, at no more cost."""
    joined = _joined(path.knots, steering, checker, far=True)
    best = path if joined is None or joined.cost.sum() > path.cost.sum() else joined
    for count, margins in TUNING.rounds:
        for margin in margins:
            found = _relaxed(best, count, margin, steering, checker)
            if found is not None:
                best = found
                break
    return best


def resumed(x: Array, path: Legs, steering: InTime, checker: EdgeChecker) -> Legs | None:
    """Shorten the rest of a path from a place and a time x (3,) [m, m, s] near it; None if none is left or free.

    Its class is not checked.
    """
    goal, knots = checker.space.scene.goal, path.knots
    soon = x[2] + TUNING.soon * (knots[-1, 2] - knots[0, 2]) / (len(knots) - 1)
    knots = np.vstack([x, knots[knots[:, 2] > soon]])
    if len(knots) < 2:
        return None
    for margin in TUNING.margins_again:
        moved = knots.copy()
        if margin > 0.0:
            numbers, radius = steering.numbers, checker.space.scene.robot_radius
            relax = relaxation(checker.space.moving.kernels)
            relax(checker.around, numbers, moved, margin, radius, len(TUNING.weights) - 1)
        moved[-1, :2] = _into(moved[-1, :2], goal)
        found: Legs = checker.until_goal(steering.connect(moved[:-1], moved[1:]))
        if checker.inspect(found, np.arange(len(found.cost)) == len(found.cost) - 1).free.all():
            return found
    return None


def _into(place: Array, goal: Goal) -> Array:
    """Move a place (2,) [m] inside the goal's disc [m]."""
    away = place - goal.center
    inside: Array = goal.center + away * min(1.0, (1.0 - TUNING.inside) * goal.radius / max(np.hypot(*away), 1e-300))
    return inside


def _relaxed(path: Legs, count: int, margin: float, steering: InTime, checker: EdgeChecker) -> Legs | None:
    """Move the knots of a path; None unless the result is free, of the class and cheaper."""
    knots = _meshed(path.knots, count)
    relax = relaxation(checker.space.moving.kernels)
    relax(checker.around, steering.numbers, knots, margin, checker.space.scene.robot_radius, 0)
    found = _joined(knots, steering, checker, far=False)
    if found is None or found.cost.sum() >= path.cost.sum():
        return None
    return found if _key_of(checker.around, found.knots) == _key_of(checker.around, path.knots) else None


def _joined(knots: Array, steering: InTime, checker: EdgeChecker, *, far: bool) -> Legs | None:
    """Join some of the knots (k, 3) by legs that are all free up to the goal's disc; None if one is not."""
    kept, goal = knots.copy(), checker.space.scene.goal
    kept[-1, :2] = _into(kept[-1, :2], goal)
    count = shortcuts(checker.space.moving.kernels)(checker.around, steering.numbers, kept, far)
    path: Legs = checker.until_goal(steering.connect(kept[: count - 1], kept[1:count]))
    last = np.arange(count - 1) == count - 2
    return path if checker.inspect(path, last).free.all() else None


def _meshed(knots: Array, count: int) -> Array:
    """Divide a path over knots (k, 3) into `count` legs, denser where it bends, (count + 1, 3)."""
    steps = np.diff(knots, axis=0)
    steps = steps[steps[:, 2] > 0.0]
    knots = np.vstack([knots[0], knots[0] + np.cumsum(steps, axis=0)])
    times = knots[:, 2]
    even = np.linspace(times[0], times[-1], 257)
    velocity = steps[:, :2] / steps[:, 2:]
    bends = np.hypot(*np.diff(velocity, axis=0).T)
    weight = np.full(256, 1.0)
    if len(bends) and bends.sum() > 0.0:
        middle, width = 0.5 * (even[1:] + even[:-1]), 0.05 * (times[-1] - times[0])
        near = np.exp(-(((middle[:, None] - times[None, 1:-1]) / width) ** 2)) @ bends
        weight = (1.0 - TUNING.bends) / 256 + TUNING.bends * near / near.sum()
    share = np.concatenate([[0.0], np.cumsum(weight)])
    at = np.interp(np.linspace(0.0, share[-1], count + 1), share, even)
    return np.column_stack([np.interp(at, times, knots[:, k]) for k in range(3)])


@kernel
def _key_of_leg(around, a, b, to_goal, marker, turn):  # type: ignore[no-untyped-def]
    """Additive key of the straight line from a to b, 2 x (3,); marker, turn (M,) are scratch."""
    tail, head = (a[0], a[1], a[2]), (b[0], b[1], b[2])
    count = crossings_of_leg(around, tail, head, to_goal, marker, turn, 0)
    return key_of_pairs(marker, turn, 0, count, around.weights)


@kernel
def _key_of(around, knots):  # type: ignore[no-untyped-def]
    """Additive key of a path over knots (k, 3) into the goal's disc."""
    M, last, key = around.weights.shape[0], knots.shape[0] - 2, np.int64(0)
    marker, turn = np.empty(M, np.int32), np.empty(M, np.int16)
    for i in range(last + 1):
        key += _key_of_leg(around, knots[i], knots[i + 1], i == last, marker, turn)
    return key


@cache
def shortcuts(moving: MovingKernels | None) -> Any:
    """Build the kernel that leaves out knots, by kernels of moving obstacles."""
    free = free_leg(moving)

    @kernel
    def shortcut(around, numbers, knots, far):  # type: ignore[no-untyped-def]
        """Leave out knots (k, 3) between others joined by a free straight line of the class, in place; how many stay.

        The last one is where the path enters the goal's disc. Without `far` a search ends after a few knots in vain.
        """
        M, count = around.weights.shape[0], knots.shape[0]
        marker, turn, kept, i, speed = np.empty(M, np.int32), np.empty(M, np.int16), 1, 0, numbers[2]
        keys = np.zeros(count, np.int64)
        for k in range(count - 1):
            keys[k + 1] = keys[k] + _key_of_leg(around, knots[k], knots[k + 1], k == count - 2, marker, turn)
        while i < count - 1:
            a, to, j, ahead = knots[i], i + 1, i + 2, count - 1 if far else TUNING.patience
            while j < count and j <= to + ahead:
                b = knots[j]
                dt, square, last = b[2] - a[2], (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2, j == count - 1
                if (
                    dt > 0.0
                    and square <= (speed * dt) ** 2 * (1.0 + LATE)
                    and (last or entered(around, a[0], a[1], b[0], b[1]) == np.inf)
                    and _key_of_leg(around, a, b, last, marker, turn) == keys[j] - keys[i]
                    and free(around, (a[0], a[1], a[2], b[0], b[1], b[2])) == FREE
                ):
                    to = j
                j += 1
            for c in range(3):
                knots[kept, c] = knots[to, c]
            keys[kept] = keys[to]
            kept, i = kept + 1, to
        return kept

    return shortcut
