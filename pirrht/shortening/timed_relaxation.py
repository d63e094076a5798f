"""Move the knots of a path in space and time to where it costs least while it keeps off all obstacles.

Knots lie at fixed shares of the path's duration; their places and the duration change, and the cost, the sum of q dt +
(r/2) |dx|^2 / dt, is convex in these. Penalties are squares of the margin lacking at points of every leg, of speeds
over the limit, and of the last knot's distance to the goal's disc. All terms are nearly linear in two neighbouring
knots and the duration, so a Newton step solves a matrix of three side diagonals with a border. Clearances are known
well only outside of solids: no step is longer than the robot.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.field import clearance
from pirrht.geometry.world import NOTHING_MOVES, WALL, MovingKernels
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.vectors import copy_rows
from pirrht.shortening.tuning import IN_TIME as TUNING

BAND = 4  # diagonals of a symmetric matrix of neighbouring knots


@inlined
def _add(matrix, border, slope, first, along, value, weight):  # type: ignore[no-untyped-def]
    """Add (weight / 2) (value + along . d)^2 of changes d of two knots and the duration to a model.

    `along` (5,) is the x and y of knot `first`, of the next, and the duration. Knot 0 stays, so that row 0 of `matrix`
    (l, BAND), `border` (l + 1,) and `slope` (l + 1,) is the x of knot 1; the last of the latter are the duration's.
    """
    begin, last = 2 * (first - 1), slope.shape[0] - 1
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
def model(moving: MovingKernels | None) -> Any:
    """Build the kernel that computes the cost of a path and its penalties, by kernels of moving obstacles."""
    among, moving_walls = moving is not None, (moving or NOTHING_MOVES).walls

    @inlined
    def near_walls(around, notes, x, y, t, margin, walls):  # type: ignore[no-untyped-def]
        """Write walls nearer than a margin [m] to rows of `walls` (J + 1, WALL); how many."""
        field, count = around.field, 0
        if among:
            count, _ = moving_walls(around.traffic, notes, x, y, t, margin, walls)
        c = clearance(field, x, y)
        if c < margin:
            h = 0.5 * field.spacing
            gx = (clearance(field, x + h, y) - clearance(field, x - h, y)) / (2.0 * h)
            gy = (clearance(field, x, y + h) - clearance(field, x, y - h)) / (2.0 * h)
            walls[count, 0], walls[count, 1], walls[count, 2], walls[count, 3], walls[count, 4] = c, gx, gy, 0.0, 0.0
            count += 1
        return count

    @kernel
    def modelled(around, notes, numbers, knots, weight, margin, model):  # type: ignore[no-untyped-def]
        """Cost of a path and its penalties; write the slope and the matrix of it if there is room for them.

        Args: `Surroundings`; `notes` on moving obstacles; numbers q, r and the limit of speeds; knots (N + 1, 3)
            [m, m, s]; weight of penalties [cost/m^2]; margin, the clearance to keep [m]; model, the matrix (2 N, BAND),
            border (2 N + 1,) and slope (2 N + 1,) of the places but the first and the duration.
        """
        q, r, limit, last = numbers[0], numbers[1], numbers[2] * (1.0 - TUNING.slower), knots.shape[0] - 1
        walls, along, total = np.empty((around.traffic.J + 1, WALL)), np.empty(5), 0.0
        (matrix, border, slope), whole = model, knots[last, 2] - knots[0, 2]
        filled = slope.shape[0] > 0
        matrix[:], border[:], slope[:] = 0.0, 0.0, 0.0
        for i in range(last):
            dx, dy, dt = knots[i + 1, 0] - knots[i, 0], knots[i + 1, 1] - knots[i, 1], knots[i + 1, 2] - knots[i, 2]
            vx, vy, part = dx / dt, dy / dt, dt / whole
            rate = q + 0.5 * r * (vx * vx + vy * vy)
            total += dt * rate
            lacking = math.hypot(dx, dy) - limit * dt
            if lacking > 0.0:
                total += 0.5 * weight * lacking * lacking
            if filled:
                slope[slope.shape[0] - 1] += rate * part
                along[0], along[1], along[2], along[3], along[4] = -1.0, 0.0, 1.0, 0.0, -vx * part
                _add(matrix, border, slope, i, along, dx, r / dt)
                along[0], along[1], along[2], along[3], along[4] = 0.0, -1.0, 0.0, 1.0, -vy * part
                _add(matrix, border, slope, i, along, dy, r / dt)
                if lacking > 0.0:
                    ux, uy = dx / (lacking + limit * dt), dy / (lacking + limit * dt)
                    along[0], along[1], along[2], along[3], along[4] = -ux, -uy, ux, uy, -limit * part
                    _add(matrix, border, slope, i, along, lacking, weight)
            for share in TUNING.leg_points:
                x, y, t = knots[i, 0] + share * dx, knots[i, 1] + share * dy, knots[i, 2] + share * dt
                for k in range(near_walls(around, notes, x, y, t, margin, walls)):
                    lacking, nx, ny = margin - walls[k, 0], walls[k, 1], walls[k, 2]
                    total += 0.5 * weight * lacking * lacking
                    if filled:
                        along[0], along[1] = (share - 1.0) * nx, (share - 1.0) * ny
                        along[2], along[3] = -share * nx, -share * ny
                        along[4] = (nx * walls[k, 3] + ny * walls[k, 4]) * (t - knots[0, 2]) / whole
                        _add(matrix, border, slope, i, along, lacking, weight)
        gx, gy = knots[last, 0] - around.goal_x, knots[last, 1] - around.goal_y
        away = math.sqrt(gx * gx + gy * gy)
        lacking = away - around.goal_radius * (1.0 - TUNING.inside)
        if lacking > 0.0:
            total += 0.5 * weight * lacking * lacking
            if filled:
                along[0], along[1], along[2], along[3], along[4] = 0.0, 0.0, gx / away, gy / away, 0.0
                _add(matrix, border, slope, last - 1, along, lacking, weight)
        return total

    return modelled


@kernel
def _decomposed(matrix, damping):  # type: ignore[no-untyped-def]
    """Cholesky's decomposition of a matrix (l, BAND) with `damping` added, in place."""
    for i in range(matrix.shape[0]):
        matrix[i, 0] += damping
        for k in range(min(BAND - 1, i), -1, -1):
            total, j = matrix[i, k], i - k
            for m in range(1, min(BAND - 1 - k, j) + 1):
                total -= matrix[i, k + m] * matrix[j, m]
            matrix[i, k] = total / matrix[j, 0] if k > 0 else math.sqrt(max(total, damping))


@kernel
def _solved(matrix, right, out):  # type: ignore[no-untyped-def]
    """Write the solution of a decomposed matrix (l, BAND) and -right (l + 1,) to `out` (l,)."""
    n = out.shape[0]
    for i in range(n):
        total = -right[i]
        for k in range(1, min(BAND - 1, i) + 1):
            total -= matrix[i, k] * out[i - k]
        out[i] = total / matrix[i, 0]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(1, min(BAND - 1, n - 1 - i) + 1):
            total -= matrix[i + k, k] * out[i + k]
        out[i] = total / matrix[i, 0]


@kernel
def _step(matrix, border, slope, damping, step, work):  # type: ignore[no-untyped-def]
    """Write the Newton step of a model (l, BAND), (l + 1,), (l + 1,) to `step` (l + 1,); `work` (l,) is scratch."""
    n = work.shape[0]
    _decomposed(matrix, damping)
    _solved(matrix, slope, step[:n])
    _solved(matrix, border, work)
    above, below = -slope[n], border[n] + damping
    for i in range(n):
        above -= border[i] * step[i]
        below += border[i] * work[i]
    step[n] = above / max(below, damping)
    for i in range(n):
        step[i] += step[n] * work[i]


@kernel
def _moved(knots, step, share, out):  # type: ignore[no-untyped-def]
    """Write knots (N + 1, 3) after a share of a step (2 N + 1,) to `out`."""
    last = knots.shape[0] - 1
    longer = 1.0 + share * step[2 * last] / (knots[last, 2] - knots[0, 2])
    for i in range(1, last + 1):
        out[i, 0], out[i, 1] = knots[i, 0] + share * step[2 * i - 2], knots[i, 1] + share * step[2 * i - 1]
        out[i, 2] = knots[0, 2] + longer * (knots[i, 2] - knots[0, 2])


@inlined
def _allowed(knots, step, farthest, fastest):  # type: ignore[no-untyped-def]
    """Share of a step that moves no knot too far [m] for bodies that go so fast, nor ends the path at once."""
    last = knots.shape[0] - 1
    whole, change, share = knots[last, 2] - knots[0, 2], step[2 * last], 1.0
    if change < 0.0:
        share = min(share, (TUNING.shortest_duration - 1.0) * whole / change)
    for i in range(1, last + 1):
        later = abs(change) * (knots[i, 2] - knots[0, 2]) / whole
        moved = math.hypot(step[2 * i - 2], step[2 * i - 1]) + fastest * later
        if moved > farthest:
            share = min(share, farthest / moved)
    return share


@cache
def relaxation(moving: MovingKernels | None) -> Any:
    """Build the kernel that moves the knots of a path to where it costs least, by kernels of moving obstacles."""
    modelled, watch = model(moving), (moving or NOTHING_MOVES).watch

    @kernel
    def relax(around, numbers, knots, margin, thin, first):  # type: ignore[no-untyped-def]
        """Move the knots (N + 1, 3) of a path but the first, in place, to where it costs least.

        Args: `Surroundings`; numbers q, r and the limit of speeds; knots, with times that increase [m, m, s]; margin,
            the clearance to keep [m]; `thin`, radius of the robot [m]; `first` weight: a nearly optimal path needs the
            last one alone.
        """
        n, notes = 2 * (knots.shape[0] - 1), watch(around.traffic)
        matrix, border, slope, none = np.empty((n, BAND)), np.empty(n + 1), np.empty(n + 1), np.empty(0)
        step, work, moved = np.empty(n + 1), np.empty(n), knots.copy()
        for k in range(first, len(TUNING.weights)):
            weight = TUNING.weights[k]
            for _ in range(TUNING.steps):
                before = modelled(around, notes, numbers, knots, weight, margin, (matrix, border, slope))
                _step(matrix, border, slope, 1e-9 * weight, step, work)
                share, after = _allowed(knots, step, TUNING.longest_step * thin, around.traffic.speed), np.inf
                for _ in range(TUNING.halvings):
                    _moved(knots, step, share, moved)
                    after = modelled(around, notes, numbers, moved, weight, margin, (matrix[:0], none, none))
                    if after < before:
                        break
                    share *= 0.5
                if after < before:
                    copy_rows(moved, knots)
                if not after < before * (1.0 - TUNING.settled):
                    break

    return relax
