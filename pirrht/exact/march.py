"""Step psi back in time: `psi(x, t) = e^(-q dt/lambda) sum_y N(y - x) prod_g (missed g) psi(y, t + dt) + paid`.

A sum over points closer than the Gaussian is wide is exact but for rounding even where psi is a steep exponential; far
from walls it is taken axis by axis. Kept is log psi: each tile of 16 x 16 points is summed relative to the greatest psi
around it. Inside of walls and goal log psi is minus infinity: no path goes on from there, and the payment of one that
ends there is added where it began.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.exact.bridges import WALLS, Step, log_paid, log_sum, missed, outside, walls_around
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.bodies import clearance_from

TILE = 16  # points along each side of a tile
LITTLE = 1e-250  # sums below this are taken again, relative to the greatest psi within reach of the point itself
SMALL = 575.0  # minus its logarithm [nats]


def taps_along(count: int, first: float, spacing: float, low: float, high: float, step: Step) -> Array:
    """Weights that each of `count` points along an axis gives those up to R before and after it, (count, 2 R + 1).

    Args: `first`, coordinate of the first point, `spacing` h, `low` and `high` border [m]; `step`, whose reach is R.
    """
    R = math.ceil(step.reach / spacing)
    offset = spacing * np.arange(-R, R + 1)
    weight = spacing / (step.deviation * math.sqrt(2.0 * math.pi)) * np.exp(-0.5 * (offset / step.deviation) ** 2)
    here = first + spacing * np.arange(count)
    there = here[:, None] + offset
    out = np.broadcast_to(weight, there.shape).copy()
    for d, e in ((here[:, None] - low, there - low), (high - here[:, None], high - there)):
        z = 2.0 * np.maximum(d, 0.0) * np.maximum(e, 0.0) / step.deviation**2
        out *= -np.expm1(-z)
    out[(there > first + spacing * (count - 0.5)) | (there < first - 0.5 * spacing)] = 0.0
    return out


@kernel
def march(later, out, room, begin, end, taps_x, taps_y, alone, step):  # type: ignore[no-untyped-def]
    """Fill `out` with log psi at the beginning of a step.

    Args: `later` and `out`, log psi at its end and its beginning, 2 x (nx, ny) [nats]; `Room` and `Step`; `begin` and
        `end`, poses of all bodies, 2 x (1 + J, 4), as of `frames_of`; `taps_x` and `taps_y` of `taps_along`, (nx, 2 R +
        1) and (ny, 2 R + 1); `alone` of `at_goal`, (nx, ny).
    """
    nx, ny = later.shape
    R = taps_x.shape[1] // 2
    wide = TILE + 2 * R
    block, half = np.empty((wide, wide)), np.empty((wide, TILE))
    near = np.empty(room.bodies.owner.shape[0], dtype=np.int64)
    frame, bodies = room.frame, room.bodies
    h = frame.spacing
    across = 0.5 * math.sqrt(2.0) * TILE * h
    for i0 in range(0, nx, TILE):
        for j0 in range(0, ny, TILE):
            i1, j1 = min(i0 + TILE, nx), min(j0 + TILE, ny)
            base = _block(later, i0 - R, j0 - R, i1 + R, j1 + R, block)
            x, y = frame.x0 + 0.5 * (i0 + i1 - 1) * h, frame.y0 + 0.5 * (j0 + j1 - 1) * h
            count = 0
            for k in range(near.shape[0]):
                d = clearance_from(bodies, k, begin, x, y)
                if min(d, clearance_from(bodies, k, end, x, y)) < step.reach + across:
                    near[count] = k
                    count += 1
            _plain(block, half, i0, j0, i1, j1, taps_x, taps_y, base, step.rate * step.dt, out)
            rim = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
            edge = min(min(x - room.left, room.right - x), min(y - room.low, room.high - y))
            if count > 0 or rim < step.reach + across or (step.wall < math.inf and edge < step.reach + across):
                _careful(
                    later, block, i0, j0, i1, j1, base, out, room, begin, end, near[:count], taps_x, taps_y, alone, step
                )


@inlined
def _block(later, i0, j0, i1, j1, block):  # type: ignore[no-untyped-def]
    """Copy psi of points (i0, j0) to (i1, j1), end excluded, relative to the greatest, whose logarithm is returned."""
    nx, ny = later.shape
    base = -math.inf
    for i in range(max(i0, 0), min(i1, nx)):
        for j in range(max(j0, 0), min(j1, ny)):
            base = max(base, later[i, j])
    for i in range(i0, i1):
        for j in range(j0, j1):
            inside = 0 <= i < nx and 0 <= j < ny and base > -math.inf
            block[i - i0, j - j0] = math.exp(later[i, j] - base) if inside else 0.0
    return base


@kernel
def _plain(block, half, i0, j0, i1, j1, taps_x, taps_y, base, loss, out):  # type: ignore[no-untyped-def]
    """Sum axis by axis, for points from which only the border is within reach."""
    width = taps_x.shape[1]
    if base == -math.inf:
        out[i0:i1, j0:j1] = -math.inf
        return
    for i in range(i1 - i0 + width - 1):
        for j in range(j1 - j0):
            total = 0.0
            for t in range(width):
                total += taps_y[j0 + j, t] * block[i, j + t]
            half[i, j] = total
    row = np.empty(j1 - j0)
    for i in range(i1 - i0):
        row[:] = 0.0
        for t in range(width):
            weight = taps_x[i0 + i, t]
            for j in range(j1 - j0):
                row[j] += weight * half[i + t, j]
        for j in range(j1 - j0):
            out[i0 + i, j0 + j] = base - loss + math.log(row[j]) if row[j] > 0.0 else -math.inf


@kernel
def _careful(later, block, i0, j0, i1, j1, base, out, room, begin, end, near, taps_x, taps_y, alone, step):  # type: ignore[no-untyped-def]
    """Sum point by point for a tile with walls or the goal within reach; arguments as of `march`."""
    frame, bodies = room.frame, room.bodies
    h, width, count = frame.spacing, taps_x.shape[1], near.shape[0]
    R = width // 2
    rows, columns = i1 - i0 + 2 * R, j1 - j0 + 2 * R
    free_by, rim = np.empty((count, rows, columns)), np.empty((rows, columns))
    for i in range(rows):
        for j in range(columns):
            x, y = frame.x0 + (i0 - R + i) * h, frame.y0 + (j0 - R + j) * h
            rim[i, j] = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
            for k in range(count):
                free_by[k, i, j] = clearance_from(bodies, near[k], end, x, y)
    wall, clear, slope = np.empty(count, dtype=np.int64), np.empty(WALLS), np.empty((WALLS, 4))
    which, own = np.empty(WALLS, dtype=np.int64), np.empty((width, width))
    for i in range(R, rows - R):
        for j in range(R, columns - R):
            x, y = frame.x0 + (i0 - R + i) * h, frame.y0 + (j0 - R + j) * h
            to_rim = rim[i, j]
            n = -1 if to_rim <= 0.0 else walls_around(bodies, near, begin, x, y, step.reach, wall, which, clear, slope)
            if n < 0 or outside(room, x, y):
                out[i0 - R + i, j0 - R + j] = -math.inf
                continue
            edge = min(min(x - room.left, room.right - x), min(y - room.low, room.high - y))
            ends = to_rim < step.reach or (step.wall < math.inf and (n > 0 or edge < step.reach))
            a, c = i0 - R + i, j0 - R + j
            if n == 0 and not ends and (out[a, c] > base - SMALL or base == -math.inf):
                continue
            top, around = base, block[i - R : i + R + 1, j - R : j + R + 1]
            total = _alive(around, rim, free_by, i, j, to_rim, n, wall, clear, taps_x[a], taps_y[c], step)
            if total < LITTLE and base > -math.inf:  # too little beside what is behind a wall: relative to its own
                top = _block(later, a - R, c - R, a + R + 1, c + R + 1, own)
                total = _alive(own, rim, free_by, i, j, to_rim, n, wall, clear, taps_x[a], taps_y[c], step)
            value = top - step.rate * step.dt + math.log(total) if total > 0.0 else -math.inf
            if ends:
                value = log_sum(value, log_paid(room, near, begin, end, step, x, y, alone[a, c]))
            out[a, c] = value


@kernel
def _alive(around, rim, free_by, i, j, to_rim, n, wall, clear, taps_x, taps_y, step):  # type: ignore[no-untyped-def]
    """Sum psi around a point over paths that miss the goal and n walls.

    Args: `around`, psi (2 R + 1, 2 R + 1); `rim` (k, l) and `free_by` (count, k, l), clearances from goal and solids at
        the end of the step [m]; i, j, the point's place in them; `to_rim` and `clear` (WALLS,), its clearances at the
        beginning [m]; `wall` (count,) of each solid; taps, 2 x (2 R + 1,); `Step`.
    """
    width, total = taps_x.shape[0], 0.0
    R = width // 2
    for a in range(width):
        for c in range(width):
            weight = taps_x[a] * taps_y[c] * around[a, c]
            if weight == 0.0:
                continue
            p, q = i - R + a, j - R + c
            if to_rim < step.reach:
                weight *= missed(to_rim, rim[p, q], step)
            for g in range(n):
                d = math.inf
                for k in range(wall.shape[0]):
                    if wall[k] == g:
                        d = min(d, free_by[k, p, q])
                weight *= missed(clear[g], d, step)
            total += weight
    return total
