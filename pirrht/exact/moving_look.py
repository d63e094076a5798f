"""Evaluate psi among moving obstacles at any place and time, between the frames of a march.

It is one more step of the march, from the place itself to the next frame: with the march's walls the control grows as
1/distance at each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.exact import point
from pirrht.exact.bridges import WALLS, Room, Step, log_paid, log_sum, missed, outside, walls_around
from pirrht.exact.grid import Frame, in_goal
from pirrht.jit.jit import kernel
from pirrht.moving.bodies import clearance_from

BEYOND = 6.0  # a step is cut off so many deviations beyond the one that the law asks for


class March(NamedTuple):
    """log psi in time: frames of it, and the solution once all stands still."""

    frame: Frame
    room: Room
    step: Step  # the longest of the march
    rest: point.Expansion  # after `last`; of a motion that starts over unused
    last: float  # when all stands still for good [s]; infinite where motions start over
    first: float  # when what starts over begins to repeat itself [s] ...
    period: float  # ... every so many seconds; 0 where nothing does
    ahead: float  # the next frame is at least so much later [s]
    times: Array  # (F + 1,) ends of steps [s]
    begin: Array  # (F, 1 + J, 3) poses at the beginnings of steps [m, m, rad]
    end: Array  # (F, 1 + J, 3) and at their ends
    kept: IntArray  # (G,) places in `times` of the frames
    arriving: Array  # (G, 1 + J, 4) poses of the bodies then, as `frames_of` has them
    log_psi: NDArray[np.float32]  # (G, nx, ny) [nats]; minus infinity inside of walls and of the goal


@kernel
def in_wall(room, pose, x, y):  # type: ignore[no-untyped-def]
    """Tell whether (x, y) [m] is in a solid, posed (1 + J, 4), or not inside the border."""
    for k in range(room.bodies.owner.shape[0]):
        if clearance_from(room.bodies, k, pose, x, y) <= 0.0:
            return True
    return outside(room, x, y)


@kernel
def look(grid, x, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at x (3,) [m, m, s]; its gradient [1/m] goes to slope (2,). -phi/lambda in walls."""
    slope[0], slope[1] = 0.0, 0.0
    if in_goal(grid.frame, x):
        return 0.0
    t = max(x[2], 0.0)
    if t < grid.last and grid.period > 0.0 and t >= grid.first + grid.period:
        t = grid.first + (t - grid.first) % grid.period
    pose = np.empty((grid.begin.shape[1], 4))
    poses_of(grid, t, pose)
    if t >= grid.last:
        if in_wall(grid.room, pose, x[0], x[1]):
            return -grid.step.wall
        return point.look(grid.rest, x, slope)
    g, high = 0, grid.kept.shape[0] - 1
    while g < high:
        middle = (g + high) // 2
        if grid.times[grid.kept[middle]] >= t + grid.ahead:
            high = middle
        else:
            g = middle + 1
    b, rate = grid.step.b, grid.step.rate
    dt = grid.times[grid.kept[g]] - t
    deviation = b * math.sqrt(dt)
    reach = (BEYOND + math.sqrt(2.0 * rate * dt)) * deviation
    step = Step(dt, deviation, b, rate, grid.step.wall, reach)
    return _from(grid, grid.log_psi[g], pose, grid.arriving[g], step, x[0], x[1], slope)


@kernel
def poses_of(grid, t, pose):  # type: ignore[no-untyped-def]
    """Fill `pose` (1 + J, 4), as `frames_of` has it, with that of all bodies at t [s]."""
    if grid.period > 0.0 and t >= grid.first + grid.period:
        t = grid.first + (t - grid.first) % grid.period
    f = min(max(np.searchsorted(grid.times, t, side="right") - 1, 0), grid.begin.shape[0] - 1)
    share = min(max((t - grid.times[f]) / (grid.times[f + 1] - grid.times[f]), 0.0), 1.0)
    for j in range(pose.shape[0]):
        yaw = (1.0 - share) * grid.begin[f, j, 2] + share * grid.end[f, j, 2]
        pose[j, 0] = (1.0 - share) * grid.begin[f, j, 0] + share * grid.end[f, j, 0]
        pose[j, 1] = (1.0 - share) * grid.begin[f, j, 1] + share * grid.end[f, j, 1]
        pose[j, 2], pose[j, 3] = math.cos(yaw), math.sin(yaw)


@kernel
def _from(grid, later, begin, end, step, x, y, slope):  # type: ignore[no-untyped-def]
    """log psi [nats] at (x, y) [m] a step before the frame `later` (nx, ny); its gradient goes to slope (2,) [1/m].

    `begin` and `end` are poses of all bodies, 2 x (1 + J, 4), as of `frames_of`.
    """
    room, frame, bodies = grid.room, grid.frame, grid.room.bodies
    near, count = np.empty(bodies.owner.shape[0], dtype=np.int64), 0
    for k in range(near.shape[0]):
        d = clearance_from(bodies, k, begin, x, y)
        if min(d, clearance_from(bodies, k, end, x, y)) < step.reach:
            near[count] = k
            count += 1
    wall, which = np.empty(count, dtype=np.int64), np.empty(WALLS, dtype=np.int64)
    clear, away = np.empty(WALLS), np.empty((WALLS, 4))
    n = walls_around(bodies, near[:count], begin, x, y, step.reach, wall, which, clear, away)
    if n < 0 or outside(room, x, y):
        return -step.wall
    h = frame.spacing
    i0, j0 = max(math.ceil((x - step.reach - frame.x0) / h), 0), max(math.ceil((y - step.reach - frame.y0) / h), 0)
    i1 = min(math.floor((x + step.reach - frame.x0) / h) + 1, later.shape[0])
    j1 = min(math.floor((y + step.reach - frame.y0) / h) + 1, later.shape[1])
    along_x, slope_x = np.empty(max(i1 - i0, 0)), np.empty(max(i1 - i0, 0))
    along_y, slope_y = np.empty(max(j1 - j0, 0)), np.empty(max(j1 - j0, 0))
    _axis(along_x, slope_x, frame.x0 + i0 * h, h, x, room.left, room.right, step)
    _axis(along_y, slope_y, frame.y0 + j0 * h, h, y, room.low, room.high, step)
    to_rim = math.sqrt((x - frame.goal_x) ** 2 + (y - frame.goal_y) ** 2) - frame.radius
    out_x, out_y = (x - frame.goal_x) / (to_rim + frame.radius), (y - frame.goal_y) / (to_rim + frame.radius)
    base = -math.inf
    for i in range(i0, i1):
        for j in range(j0, j1):
            base = max(base, later[i, j])
    square = step.deviation * step.deviation
    total, gx, gy = 0.0, 0.0, 0.0
    for i in range(i0, i1):
        for j in range(j0, j1):
            if later[i, j] == -math.inf:
                continue
            weight = math.exp(later[i, j] - base)
            px, py = frame.x0 + i * h, frame.y0 + j * h
            lx, ly = slope_x[i - i0], slope_y[j - j0]
            if to_rim < step.reach:
                d = math.sqrt((px - frame.goal_x) ** 2 + (py - frame.goal_y) ** 2) - frame.radius
                share = missed(to_rim, d, step)
                weight *= share
                steep = _steep(to_rim, d, square)
                lx, ly = lx + steep * out_x, ly + steep * out_y
            for g in range(n):
                d = math.inf
                for k in range(count):
                    if wall[k] == g:
                        d = min(d, clearance_from(bodies, near[k], end, px, py))
                weight *= missed(clear[g], d, step)
                steep = _steep(clear[g], d, square)
                lx, ly = lx + steep * away[g, 2], ly + steep * away[g, 3]
            weight *= along_x[i - i0] * along_y[j - j0]
            total += weight
            gx += weight * lx
            gy += weight * ly
    loss = step.rate * step.dt
    value = base - loss + math.log(total) if total > 0.0 else -math.inf
    if total > 0.0:
        slope[0], slope[1] = gx / total, gy / total
    edge = min(min(x - room.left, room.right - x), min(y - room.low, room.high - y))
    if to_rim < step.reach or (step.wall < math.inf and (n > 0 or edge < step.reach)):
        here = log_paid(room, near[:count], begin, end, step, x, y, -1.0)
        whole = log_sum(value, here)
        if whole > -math.inf:
            e, rest = min(1e-3 * step.deviation, 0.5 * to_rim), math.exp(value - whole)
            right = math.exp(log_paid(room, near[:count], begin, end, step, x + e, y, -1.0) - whole)
            left = math.exp(log_paid(room, near[:count], begin, end, step, x - e, y, -1.0) - whole)
            above = math.exp(log_paid(room, near[:count], begin, end, step, x, y + e, -1.0) - whole)
            below = math.exp(log_paid(room, near[:count], begin, end, step, x, y - e, -1.0) - whole)
            slope[0] = rest * slope[0] + (right - left) / (2.0 * e)
            slope[1] = rest * slope[1] + (above - below) / (2.0 * e)
        value = whole
    return value


@kernel
def _steep(d, e, square):  # type: ignore[no-untyped-def]
    """Derivative by d of the logarithm of `missed` [1/m]."""
    if d <= 0.0 or e <= 0.0:
        return 0.0
    z = 2.0 * d * e / square
    return 2.0 * e / square / math.expm1(z) if z < 40.0 else 0.0


@kernel
def _axis(weight, steep, first, h, x, low, high, step):  # type: ignore[no-untyped-def]
    """Weights of points along an axis for x (`taps_along`), and derivatives of their logarithms [1/m]."""
    square = step.deviation * step.deviation
    scale = h / (step.deviation * math.sqrt(2.0 * math.pi))
    for a in range(len(weight)):
        y = first + a * h
        weight[a] = scale * math.exp(-0.5 * (y - x) ** 2 / square)
        weight[a] *= missed(x - low, y - low, step) * missed(high - x, high - y, step)
        steep[a] = (y - x) / square + _steep(x - low, y - low, square) - _steep(high - x, high - y, square)
