"""Shorten paths in space and time inside their class, until they are nearly the optimum of the class.

Knots between two others are left out where the straight line between those is free, within the limit of speeds and of
one class: that never costs more. Then all knots move, in space and time, to where the path costs least while it keeps
off all obstacles, more of them where it bends. The result counts only if it is certified and of the class.

Knots lie at fixed shares of the path's duration; their places and the duration change, and the cost, the sum of q dt +
(r/2) |dx|^2 / dt, is convex in these. Penalties are squares of the margin lacking at points of every leg, of speeds
over the limit, and of the last knot's distance to the goal's disc. All terms are nearly linear in two neighbouring
knots and the duration, so a Newton step solves a matrix of three side diagonals with a border. Clearances are known
well only outside of solids: no step is longer than the robot.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.scene import Goal
from pirrht.geometry.space import FREE, SpaceKernels
from pirrht.geometry.world import NOTHING_MOVES, WALL, MovingKernels
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.vectors import copy_rows
from pirrht.steering.chain import Connect, keys_of, shortcut_with
from pirrht.steering.edges import EdgeChecker
from pirrht.steering.legs import LATE, entered, free_leg
from pirrht.steering.motion import Legs
from pirrht.steering.tuning import IN_TIME as TUNING
from pirrht.topology.pairs import key_of_pairs
from pirrht.topology.signature import SignatureKernels

BAND = 4  # diagonals of a symmetric matrix of neighbouring knots


def taut_in_time(path: Legs, connect: Connect, numbers: tuple[float, ...], checker: EdgeChecker) -> Legs:
    """Shorten a path into the goal's disc inside its class, at no more cost."""
    best = path
    key = _judged(path, checker)[1]
    relax = relaxation(checker.space.static.kernels, checker.space.moving.kernels)

    joined, _ = _joined(path.knots, connect, numbers, checker, far=True)
    if joined is not None and joined.cost.sum() <= path.cost.sum():
        best = joined
    for count, margins in TUNING.rounds:
        for margin in margins:
            knots = _meshed(best.knots, count)
            relax(checker.around, numbers, knots, margin, checker.space.scene.robot_radius, 0)
            found, own = _joined(knots, connect, numbers, checker, far=False)
            if found is not None and own == key and found.cost.sum() < best.cost.sum():
                best = found
                break
    return best


def resumed(
    x: Array, path: Legs, connect: Connect, numbers: tuple[float, ...], checker: EdgeChecker
) -> Legs | None:  # fmt: skip
    """Shorten the rest of a path from x (3,) [m, m, s] near it, in any class; None if none is left or free."""
    knots = path.knots
    knots = np.vstack([x, knots[knots[:, 2] > x[2] + TUNING.soon * (knots[-1, 2] - knots[0, 2]) / (len(knots) - 1)]])
    if len(knots) < 2:
        return None
    for margin in TUNING.margins_again:
        moved = knots.copy()
        if margin > 0.0:
            relax = relaxation(checker.space.static.kernels, checker.space.moving.kernels)
            relax(checker.around, numbers, moved, margin, checker.space.scene.robot_radius, len(TUNING.weights) - 1)
        moved[-1, :2] = _into(moved[-1, :2], checker.space.scene.goal)
        found: Legs = checker.until_goal(connect(moved[:-1], moved[1:]))
        if _judged(found, checker)[0]:
            return found
    return None


def _into(place: Array, goal: Goal) -> Array:
    """Move a place (2,) [m] inside the goal's disc [m]."""
    away = place - goal.center
    return np.asarray(goal.center + away * min(1.0, (1.0 - TUNING.inside) * goal.radius / max(np.hypot(*away), 1e-300)))


def _judged(path: Legs, checker: EdgeChecker) -> tuple[bool, int]:
    """Return true if all legs of a path into the goal are free, and its key."""
    edges = checker.inspect(path, np.arange(len(path.cost)) == len(path.cost) - 1)
    return bool(edges.free.all()), int(keys_of(edges.turns, checker.around.weights).sum())


def _joined(
    knots: Array, connect: Connect, numbers: tuple[float, ...], checker: EdgeChecker, *, far: bool
) -> tuple[Legs | None, int]:  # fmt: skip
    """Join some of the knots (k, 3) by legs up to the goal's disc; the path, None if a leg is not free, and its key."""
    kept = knots.copy()
    kept[-1, :2] = _into(kept[-1, :2], checker.space.scene.goal)
    around = checker.around
    shortcut = shortcuts(around.static.kernels, around.traffic.kernels, around.classes.kernels)
    kept = kept[: shortcut(checker.around, numbers, kept, len(kept) if far else TUNING.patience)]
    path: Legs = checker.until_goal(connect(kept[:-1], kept[1:]))
    free, key = _judged(path, checker)
    return path if free else None, key


def _meshed(knots: Array, count: int) -> Array:
    """Divide a path over knots (k, 3) into `count` legs, denser where it bends, (count + 1, 3)."""
    steps = np.diff(knots, axis=0)
    steps = steps[steps[:, 2] > 0.0]
    knots = np.vstack([knots[0], knots[0] + np.cumsum(steps, axis=0)])
    times = knots[:, 2]
    weight = np.full(256, 1.0)
    even = np.linspace(times[0], times[-1], 257)
    bends = np.hypot(*np.diff(steps[:, :2] / steps[:, 2:], axis=0).T)
    if len(bends) and bends.sum() > 0.0:
        middle = 0.5 * (even[1:] + even[:-1])
        near = np.exp(-(((middle[:, None] - times[None, 1:-1]) / (0.05 * (times[-1] - times[0]))) ** 2)) @ bends
        weight = (1.0 - TUNING.bends) / 256 + TUNING.bends * near / near.sum()
    share = np.concatenate([[0.0], np.cumsum(weight)])
    at = np.interp(np.linspace(0.0, share[-1], count + 1), share, even)
    return np.column_stack([np.interp(at, times, knots[:, k]) for k in range(3)])


@cache
def shortcuts(space: SpaceKernels, moving: MovingKernels | None, classes: SignatureKernels) -> Any:
    """Build the kernel that leaves out knots, by kernels of a footprint, of moving obstacles and of a signature."""
    free = free_leg(space, moving)
    crossings = classes.crossings

    @kernel
    def key_of_leg(around, a, b, to_goal):  # type: ignore[no-untyped-def]
        """Additive key of the straight line from a to b, 2 x (3,)."""
        M = around.weights.shape[0]
        tail = (a[0], a[1], a[2])
        head = (b[0], b[1], b[2])

        marker = np.empty(M, np.int32)
        turn = np.empty(M, np.int16)
        return key_of_pairs(
            marker, turn, 0, crossings(around.classes, tail, head, to_goal, marker, turn, 0), around.weights
        )

    @kernel
    def joins(around, numbers, a, b, last, key):  # type: ignore[no-untyped-def]
        """Return whether the straight line from a to b, 2 x (3,), is free, within the limit of speeds and has a key."""
        dt = b[2] - a[2]
        square = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2

        return (
            dt > 0.0
            and square <= (numbers[2] * dt) ** 2 * (1.0 + LATE)
            and (last or entered(around, a[0], a[1], b[0], b[1]) == np.inf)
            and key_of_leg(around, a, b, last) == key
            and free(around, (a[0], a[1], a[2], b[0], b[1], b[2])) == FREE
        )

    return shortcut_with(key_of_leg, joins)


@inlined
def _add(model, first, value, weight, *along):  # type: ignore[no-untyped-def]
    """Add (weight / 2) (value + along . d)^2 of changes d of two knots and the duration to a model.

    `along` is the x and y of knot `first`, of the next, and the duration. Knot 0 stays, so that row 0 of the matrix
    (l, BAND), border (l + 1,) and slope (l + 1,) is the x of knot 1; the last of the latter are the duration's.
    """
    matrix, border, slope = model
    begin = 2 * (first - 1)
    last = slope.shape[0] - 1

    for p in range(4):
        row = begin + p
        if row >= 0 and along[p] != 0.0:
            slope[row] += weight * value * along[p]
            border[row] += weight * along[p] * along[4]
            for k in range(min(p, row) + 1):
                matrix[row, k] += weight * along[p] * along[p - k]
    slope[last] += weight * value * along[4]
    border[last] += weight * along[4] * along[4]


@cache
def model(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel that computes the cost of a path and its penalties, by kernels of moving obstacles."""
    among, moving_walls = moving is not None, (moving or NOTHING_MOVES).walls
    clearance = space.place

    @inlined
    def near_walls(around, notes, x, y, t, margin, walls):  # type: ignore[no-untyped-def]
        """Write walls nearer than a margin [m] to rows of `walls` (J + 1, WALL); how many."""
        static, count = around.static, 0
        if among:
            count, _ = moving_walls(around.traffic, notes, (x, y), t, margin, walls)
        c = clearance(static, (x, y))
        if c < margin:
            h = 0.5 * static.spacing
            nx = (clearance(static, (x + h, y)) - clearance(static, (x - h, y))) / (2.0 * h)
            ny = (clearance(static, (x, y + h)) - clearance(static, (x, y - h))) / (2.0 * h)
            walls[count] = (c, nx, ny, 0.0, 0.0, 0.0, 0.0)
            count += 1
        return count

    @kernel
    def modelled(around, notes, numbers, knots, weight, margin, model, filled):  # type: ignore[no-untyped-def]
        """Cost of a path and its penalties; if `filled`, write the slope and the matrix of it.

        Args: `Surroundings`; `notes` on moving obstacles; numbers q, r and the limit of speeds; knots (N + 1, 3)
            [m, m, s]; weight of penalties [cost/m^2]; margin, the clearance to keep [m]; model, as in `_add`.
        """
        q = numbers[0]
        r = numbers[1]
        limit = numbers[2] * (1.0 - TUNING.slower)
        last = knots.shape[0] - 1

        walls, total = np.empty((around.traffic.J + 1, WALL)), 0.0
        (matrix, border, slope), whole = model, knots[last, 2] - knots[0, 2]
        if filled:
            matrix[:], border[:], slope[:] = 0.0, 0.0, 0.0
        for i in range(last):
            dx = knots[i + 1, 0] - knots[i, 0]
            dy = knots[i + 1, 1] - knots[i, 1]
            dt = knots[i + 1, 2] - knots[i, 2]

            vx, vy = dx / dt, dy / dt
            part = dt / whole
            rate = q + 0.5 * r * (vx * vx + vy * vy)
            total += dt * rate
            lacking = math.hypot(dx, dy) - limit * dt
            if lacking > 0.0:
                total += 0.5 * weight * lacking * lacking
            if filled:
                slope[slope.shape[0] - 1] += rate * part
                _add(model, i, dx, r / dt, -1.0, 0.0, 1.0, 0.0, -vx * part)
                _add(model, i, dy, r / dt, 0.0, -1.0, 0.0, 1.0, -vy * part)
                if lacking > 0.0:
                    ux = dx / (lacking + limit * dt)
                    uy = dy / (lacking + limit * dt)
                    _add(model, i, lacking, weight, -ux, -uy, ux, uy, -limit * part)
            for share in TUNING.leg_points:
                x = knots[i, 0] + share * dx
                y = knots[i, 1] + share * dy
                t = knots[i, 2] + share * dt

                for k in range(near_walls(around, notes, x, y, t, margin, walls)):
                    lacking = margin - walls[k, 0]
                    nx, ny = walls[k, 1], walls[k, 2]
                    total += 0.5 * weight * lacking * lacking
                    if filled:
                        later = (nx * walls[k, 4] + ny * walls[k, 5]) * (t - knots[0, 2]) / whole
                        own = share - 1.0
                        _add(model, i, lacking, weight, own * nx, own * ny, -share * nx, -share * ny, later)
        gx = knots[last, 0] - around.goal[0]
        gy = knots[last, 1] - around.goal[1]
        away = math.sqrt(gx * gx + gy * gy)
        lacking = away - around.goal_radius * (1.0 - TUNING.inside)
        if lacking > 0.0:
            total += 0.5 * weight * lacking * lacking
            if filled:
                _add(model, last - 1, lacking, weight, 0.0, 0.0, gx / away, gy / away, 0.0)
        return total

    return modelled


@kernel
def _newton(model, damping, step):  # type: ignore[no-untyped-def]
    """Write the Newton step of a model to `step` (l + 1,), by Cholesky's decomposition in place; `damping` is added."""
    (matrix, border, slope), n = model, step.shape[0] - 1
    corner, rest = border[n] + damping, -slope[n]
    for i in range(n):
        matrix[i, 0] += damping
        for k in range(min(BAND - 1, i), -1, -1):
            total = matrix[i, k]
            j = i - k

            for m in range(1, min(BAND - 1 - k, j) + 1):
                total -= matrix[i, k + m] * matrix[j, m]
            matrix[i, k] = total / matrix[j, 0] if k > 0 else math.sqrt(max(total, damping))
        step[i] = -slope[i]
        for k in range(1, min(BAND - 1, i) + 1):
            step[i] -= matrix[i, k] * step[i - k]
            border[i] -= matrix[i, k] * border[i - k]
        step[i] /= matrix[i, 0]
        border[i] /= matrix[i, 0]
        corner -= border[i] * border[i]
        rest -= border[i] * step[i]
    step[n] = rest / max(corner, damping)
    for i in range(n - 1, -1, -1):
        step[i] -= border[i] * step[n]
        for k in range(1, min(BAND - 1, n - 1 - i) + 1):
            step[i] -= matrix[i + k, k] * step[i + k]
        step[i] /= matrix[i, 0]


@kernel
def _moved(knots, step, share, out):  # type: ignore[no-untyped-def]
    """Write knots (N + 1, 3) after a share of a step (2 N + 1,) to `out`."""
    last = knots.shape[0] - 1
    longer = 1.0 + share * step[2 * last] / (knots[last, 2] - knots[0, 2])
    for i in range(1, last + 1):
        out[i, 0] = knots[i, 0] + share * step[2 * i - 2]
        out[i, 1] = knots[i, 1] + share * step[2 * i - 1]
        out[i, 2] = knots[0, 2] + longer * (knots[i, 2] - knots[0, 2])


@inlined
def _allowed(knots, step, farthest, fastest):  # type: ignore[no-untyped-def]
    """Share of a step that moves no knot too far [m] for bodies that go so fast, nor ends the path at once."""
    last = knots.shape[0] - 1

    whole = knots[last, 2] - knots[0, 2]
    change = step[2 * last]
    share = 1.0

    if change < 0.0:
        share = min(share, (TUNING.shortest_duration - 1.0) * whole / change)
    for i in range(1, last + 1):
        later = abs(change) * (knots[i, 2] - knots[0, 2]) / whole
        moved = math.hypot(step[2 * i - 2], step[2 * i - 1]) + fastest * later
        if moved > farthest:
            share = min(share, farthest / moved)
    return share


@cache
def relaxation(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel that moves the knots of a path to where it costs least, by kernels of moving obstacles."""
    modelled, watch = model(space, moving), (moving or NOTHING_MOVES).watch

    @kernel
    def relax(around, numbers, knots, margin, thin, first):  # type: ignore[no-untyped-def]
        """Move the knots (N + 1, 3) of a path but the first, in place, to where it costs least.

        Args: `Surroundings`; numbers q, r and the limit of speeds; knots, with times that increase [m, m, s]; margin,
            the clearance to keep [m]; `thin`, radius of the robot [m]; `first` weight, the last if nearly optimal.
        """
        n = 2 * (knots.shape[0] - 1)
        notes = watch(around.traffic)
        model = np.empty((n, BAND)), np.empty(n + 1), np.empty(n + 1)
        step = np.empty(n + 1)
        moved = knots.copy()

        for k in range(first, len(TUNING.weights)):
            weight = TUNING.weights[k]
            for _ in range(TUNING.steps):
                before, after = modelled(around, notes, numbers, knots, weight, margin, model, True), np.inf
                _newton(model, 1e-9 * weight, step)
                share = _allowed(knots, step, TUNING.longest_step * thin, around.traffic.speed)
                for _ in range(TUNING.halvings):
                    _moved(knots, step, share, moved)
                    after = modelled(around, notes, numbers, moved, weight, margin, model, False)
                    if after < before:
                        break
                    share *= 0.5
                if after < before:
                    copy_rows(moved, knots)
                if not after < before * (1.0 - TUNING.settled):
                    break

    return relax
