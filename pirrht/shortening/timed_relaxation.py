"""Knots of a path in space and time, moved to where the path costs least while it keeps off everything.

The cost sum q dt + (r/2) |dx|^2 / dt is convex in the knots. What the path must keep off is a penalty on how much of a
margin it lacks at points of every leg, and so are the limit of speeds and the goal's disc, into which the last knot
leads. All terms are squares of what is nearly linear in two neighbouring knots, so each Newton step solves a matrix of
five side diagonals. Clearances are known well only outside of solids: no step is longer than they are thick.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.field import clearance
from pirrht.geometry.traffic import WALL, moving_walls

BAND = 6  # diagonals of a symmetric matrix of neighbouring knots
WEIGHTS = (1e2, 1e3, 1e4, 1e5)  # of squares of what is lacking, one after the other [cost/m^2]
STEPS = 12  # Newton steps for each weight
HALVINGS = 6  # of a step that does not save anything
SETTLED = 1e-7  # a step that saves less than this share is the last one for its weight
SHARES = (0.5, 1.0)  # points of a leg that keep off everything
THIN = 0.5  # a step moves knots by at most so many margins of the robot
LEAST = 0.1  # share of the duration of a leg that a step leaves at least
INSIDE = 1e-3  # share of the goal's radius by which a path leads into the disc
SLOWER = 1e-3  # share by which legs keep below the limit of speeds
DAMPING = 1e-4, 1e4  # least and greatest


@inlined
def _add(matrix, slope, first, along, value, weight):  # type: ignore[no-untyped-def]
    """Add (weight / 2) (value + along . d)^2 of changes d of two knots, the first of them `first`, to a model.

    `along` (6,); knot 0 stays, so that row 0 of `matrix` (l, BAND) and `slope` (l,) is knot 1's x.
    """
    begin = 3 * (first - 1)
    for p in range(6):
        row = begin + p
        if row >= 0 and along[p] != 0.0:
            slope[row] += weight * value * along[p]
            for k in range(min(p, row) + 1):
                matrix[row, k] += weight * along[p] * along[p - k]


@kernel
def modelled(around, numbers, knots, weight, margin, model, matrix, slope):  # type: ignore[no-untyped-def]
    """Cost of a path and what it lacks, and if `model` is true also the slope and the matrix of it; infinite if not one.

    Args:
        around: of `TimedSurroundings`.
        numbers: q, r and the limit of speeds.
        knots: the path (N + 1, 3) [m, m, s].
        weight: of what is lacking [cost/m^2].
        margin: clearance that is wanted [m].
        model: whether to write the others.
        matrix, slope: (3 N, BAND) and (3 N,), whose rows are the knots' but the first one's.
    """
    q, r, limit = numbers[0], numbers[1], numbers[2]
    walls, along, total = np.empty((around.traffic.lead.shape[0] + 1, WALL)), np.zeros(6), 0.0
    if model:
        matrix[:], slope[:] = 0.0, 0.0
    for i in range(knots.shape[0] - 1):
        dx, dy, dt = knots[i + 1, 0] - knots[i, 0], knots[i + 1, 1] - knots[i, 1], knots[i + 1, 2] - knots[i, 2]
        if not dt > 0.0:
            return np.inf
        vx, vy = dx / dt, dy / dt
        square = vx * vx + vy * vy
        total += dt * (q + 0.5 * r * square)
        if model:
            along[:] = 0.0
            along[2], along[5] = -1.0, 1.0
            _slope(slope, i, along, q + 0.5 * r * square)
            for k in range(2):
                along[:] = 0.0
                v = vy if k else vx
                along[3 + k], along[5], along[k], along[2] = 1.0, -v, -1.0, v
                # the square of (change of way less v times that of duration) has the value 0 and the slope r v dt
                _add(matrix, slope, i, along, v * dt, r / dt)
        size = math.sqrt(square)
        lacking = size * dt - limit * (1.0 - SLOWER) * dt
        if lacking > 0.0:
            total += 0.5 * weight * lacking * lacking
            if model:
                along[0], along[1], along[2] = -vx / size, -vy / size, limit * (1.0 - SLOWER)
                along[3], along[4], along[5] = vx / size, vy / size, -limit * (1.0 - SLOWER)
                _add(matrix, slope, i, along, lacking, weight)
        for share in SHARES:
            x, y, t = knots[i, 0] + share * dx, knots[i, 1] + share * dy, knots[i, 2] + share * dt
            count = moving_walls(around.traffic, x, y, t, margin, walls)
            c = clearance(around.field, x, y)
            if c < margin:
                h = 0.5 * around.field.spacing
                gx = (clearance(around.field, x + h, y) - clearance(around.field, x - h, y)) / (2.0 * h)
                gy = (clearance(around.field, x, y + h) - clearance(around.field, x, y - h)) / (2.0 * h)
                walls[count, 0], walls[count, 1], walls[count, 2], walls[count, 3], walls[count, 4] = c, gx, gy, 0.0, 0.0
                count += 1
            for k in range(count):
                lacking, nx, ny = margin - walls[k, 0], walls[k, 1], walls[k, 2]
                total += 0.5 * weight * lacking * lacking
                if model:
                    speed = nx * walls[k, 3] + ny * walls[k, 4]
                    for end in range(2):
                        part = share if end else 1.0 - share
                        along[3 * end], along[3 * end + 1], along[3 * end + 2] = -part * nx, -part * ny, part * speed
                    _add(matrix, slope, i, along, lacking, weight)
    last = knots.shape[0] - 1
    gx, gy = knots[last, 0] - around.goal_x, knots[last, 1] - around.goal_y
    away = math.sqrt(gx * gx + gy * gy)
    lacking = away - around.reach * (1.0 - INSIDE)
    if lacking > 0.0:
        total += 0.5 * weight * lacking * lacking
        if model:
            along[:] = 0.0
            along[3], along[4] = gx / away, gy / away
            _add(matrix, slope, last - 1, along, lacking, weight)
    return total


@inlined
def _slope(slope, first, along, value):  # type: ignore[no-untyped-def]
    """Add value times `along` (6,) of the knots `first` and the next to `slope` (l,)."""
    for p in range(6):
        row = 3 * (first - 1) + p
        if row >= 0:
            slope[row] += value * along[p]


@kernel
def _solved(matrix, damping, slope, out):  # type: ignore[no-untyped-def]
    """Write the step -(matrix + damping)^-1 slope to `out` (l,); whether there is one. Changes the matrix (l, BAND)."""
    n = slope.shape[0]
    for i in range(n):
        matrix[i, 0] += damping
        for k in range(min(BAND - 1, i), -1, -1):
            total, j = matrix[i, k], i - k
            for m in range(1, min(BAND - 1 - k, j) + 1):
                total -= matrix[i, k + m] * matrix[j, m]
            if k > 0:
                matrix[i, k] = total / matrix[j, 0]
            elif total <= 0.0:
                return False
            else:
                matrix[i, 0] = math.sqrt(total)
    for i in range(n):
        total = -slope[i]
        for k in range(1, min(BAND - 1, i) + 1):
            total -= matrix[i, k] * out[i - k]
        out[i] = total / matrix[i, 0]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(1, min(BAND - 1, n - 1 - i) + 1):
            total -= matrix[i + k, k] * out[i + k]
        out[i] = total / matrix[i, 0]
    return True


@inlined
def _allowed(knots, step, farthest, fastest):  # type: ignore[no-untyped-def]
    """The share of a step (3 N,) that moves no knot too far [m], as bodies see it that go so fast, nor turns time."""
    share = 1.0
    for i in range(knots.shape[0] - 1):
        moved = math.hypot(step[3 * i], step[3 * i + 1]) + fastest * abs(step[3 * i + 2])
        if moved > farthest:
            share = min(share, farthest / moved)
        dt, change = knots[i + 1, 2] - knots[i, 2], step[3 * i + 2] - (step[3 * i - 1] if i > 0 else 0.0)
        if change < 0.0:
            share = min(share, (LEAST - 1.0) * dt / change)
    return share


@kernel
def relax(around, numbers, knots, margin, thin):  # type: ignore[no-untyped-def]
    """Move the knots (N + 1, 3) of a path but the first, in place, to where it costs least.

    Args:
        around: of `TimedSurroundings`.
        numbers: q, r and the limit of speeds.
        knots: their places and times, which increase [m, m, s].
        margin: clearance that is wanted [m].
        thin: radius of the robot [m].
    """
    n, fastest = 3 * (knots.shape[0] - 1), 0.0
    matrix, slope, step, moved = np.empty((n, BAND)), np.empty(n), np.empty(n), knots.copy()
    for j in range(around.traffic.fastest.shape[0]):
        fastest = max(fastest, around.traffic.fastest[j])
    for weight in WEIGHTS:
        damping = DAMPING[0]
        for _ in range(STEPS):
            before = modelled(around, numbers, knots, weight, margin, True, matrix, slope)
            if not _solved(matrix, damping, slope, step):
                damping = 10.0 * damping
                continue
            share, after = _allowed(knots, step, THIN * thin, fastest), np.inf
            for _ in range(HALVINGS):
                for i in range(n):
                    moved[1 + i // 3, i % 3] = knots[1 + i // 3, i % 3] + share * step[i]
                after = modelled(around, numbers, moved, weight, margin, False, matrix, slope)
                if after < before:
                    break
                share *= 0.5
            if not after < before:
                damping *= 30.0
                if damping > DAMPING[1]:
                    break
                continue
            damping = max(0.3 * damping, DAMPING[0])
            knots[:] = moved
            if before - after < SETTLED * before:
                break
