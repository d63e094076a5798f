"""Walls next to guides: the cost of clearance along a step with two derivatives, and the wall drift of a point.

A step leads from one position to another, and where its velocity changes by b, along the parabola that bows by b dt / 8
from the chord: the point at a share t of it is (1 - t) x_0 + t x_1 + t (1 - t) b dt / 2 with b = v_0 - v_1. Moving
obstacles count where they are when the step passes a point; each is a wall of its own.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.field import border, clearance, two_walls, with_slope
from pirrht.geometry.world import NOTHING_MOVES, WALL, MovingKernels, with_walls
from pirrht.jit.jit import borrowing, inlined, kernel
from pirrht.proposals.tuning import TUNING

STATIC = 6  # static walls at one place: two components and four sides of the border


@inlined
def barrier(c, task):  # type: ignore[no-untyped-def]
    """c^p less its tangent at the margin, and two derivatives; zero beyond it and quadratic below `Task.least`."""
    margin, p = task.margin, task.exponent
    at = max(c, task.least)
    value = at**p
    edge = margin**p

    rise = p * value / at
    bend = p * (p - 1.0) * value / (at * at)
    down = p * edge / margin

    below = c - at
    value = value + rise * below + 0.5 * bend * below * below - edge - down * (c - margin)
    return value, rise + bend * below - down, bend


@borrowing
def static_walls(field, margin, x, y, walls):  # type: ignore[no-untyped-def]
    """Write clearance and direction away (x, y) of the walls nearer than `margin` [m] to `walls`; return their number.

    They are the two nearest components and the sides of the border; all at most STATIC.
    """
    count = 0
    for side in range(4 if border(field, x, y) < margin else 0):
        c = (x - field.left, field.right - x, y - field.low, field.high - y)[side]
        if c < margin:
            walls[count, 0], walls[count, 1] = c, (1.0, -1.0, 0.0, 0.0)[side]
            walls[count, 2] = (0.0, 0.0, 1.0, -1.0)[side]
            count += 1
    for k in range(2):
        c, nx, ny = with_slope(field, field.nearest if k == 0 else field.second, x, y)
        if c >= margin:
            break
        walls[count, 0], walls[count, 1], walls[count, 2] = c, nx, ny
        count += 1
    return count


@cache
def clearance_costs(moving: MovingKernels | None) -> tuple[Any, Any, Any]:
    """Build the kernels `scratch`, `cost` and `expand` of the clearance cost, with or without moving obstacles."""
    among = moving is not None
    watch, _, moving_walls, *_ = moving or NOTHING_MOVES

    @kernel
    def scratch(setup):  # type: ignore[no-untyped-def]
        """Allocate the walls at one place, and notes on moving obstacles."""
        return np.empty((STATIC + setup.world.moving.J, WALL)), watch(setup.world.moving)

    @borrowing
    def walls_at(setup, task, step, t, space):  # type: ignore[no-untyped-def]
        """Write the walls at a share t of a step; return their number, and the weight of its bow there [s]."""
        (x, y, dx, dy, bx, by, begin, dt), (walls, notes) = step, space
        w = 0.5 * t * (1.0 - t) * dt
        at = x + t * dx + w * bx
        to = y + t * dy + w * by
        count = static_walls(setup.world.field, task.margin, at, to, walls)
        if among:
            rows = walls[count:]
            count += moving_walls(setup.world.moving, notes, at, to, begin + t * dt, task.margin, rows)[0]
        return count, w

    @borrowing
    def unpriced(setup, task, step):  # type: ignore[no-untyped-def]
        """Check whether no wall has a price anywhere on a step, by the clearance of its middle."""
        x, y, dx, dy, bx, by, _, dt = step
        w = 0.125 * dt
        most = task.margin + 0.5 * math.sqrt(dx * dx + dy * dy) + w * math.sqrt(bx * bx + by * by)
        return clearance(setup.world.field, x + 0.5 * dx + w * bx, y + 0.5 * dy + w * by) > most

    @borrowing
    def cost(setup, task, step, points, space):  # type: ignore[no-untyped-def]
        """Return the clearance cost of a step [cost] at some points, its end the last.

        A step is (x, y, dx, dy, bx, by, begin, dt): start and displacement [m], loss of velocity [m/s], times [s].
        """
        total, walls = 0.0, space[0]
        if not among and unpriced(setup, task, step):
            return 0.0
        for k in range(1, points + 1):
            count, _ = walls_at(setup, task, step, k / points, space)
            for i in range(count):
                total += barrier(walls[i, 0], task)[0]
        return task.price * total * step[7] / points

    @borrowing
    def expand(setup, task, step, points, space, g, H):  # type: ignore[no-untyped-def]
        """Differentiate `cost` in both positions and b: gradient to g (6,), Gauss-Newton Hessian to H (6, 6).

        Returns: whether there are any walls; otherwise nothing is written.
        """
        found, walls = False, space[0]
        if not among and unpriced(setup, task, step):
            return False
        for k in range(1, points + 1):
            t = k / points
            count, w = walls_at(setup, task, step, t, space)
            share = (1.0 - t, t, w)
            scale = task.price * step[7] / points

            for e in range(count):
                if not found:
                    g[:], H[:, :], found = 0.0, 0.0, True
                _, rise, bend = barrier(walls[e, 0], task)
                nx, ny = walls[e, 1], walls[e, 2]
                for i in range(3):
                    one = scale * share[i]
                    g[2 * i] += one * rise * nx
                    g[2 * i + 1] += one * rise * ny
                    for j in range(3):
                        both = one * bend * share[j]
                        H[2 * i, 2 * j] += both * nx * nx
                        H[2 * i, 2 * j + 1] += both * nx * ny
                        H[2 * i + 1, 2 * j] += both * nx * ny
                        H[2 * i + 1, 2 * j + 1] += both * ny * ny
        return found

    return scratch, cost, expand


@cache
def drift_along(moving: MovingKernels) -> Any:
    """Build the kernel (setup, places (k, 2), times (k,), offset) of wall drift along a guide.

    It returns the slope of log psi (k, 2) [1/m] by near walls of an offset [m], and its derivatives (k, 2, 2) [1/m^2],
    at places [m] and at times [s] on the clock of moving obstacles.
    """
    watch, near = moving.watch, moving.walls

    @kernel
    def drift(setup, places, times, offset):  # type: ignore[no-untyped-def]
        k = places.shape[0]
        notes = watch(setup.world.moving)
        rows = np.zeros((setup.world.moving.J, WALL))

        slopes = np.zeros((k, 2))
        bends = np.zeros((k, 2, 2))
        within = TUNING.drift_near * offset

        for i in range(k):
            x, y = places[i]
            count, _ = near(setup.world.moving, notes, x, y, times[i], within, rows)
            c, nx, ny, d, mx, my = with_walls(two_walls(setup.world.field, x, y), rows, count, 0.0)
            for gap, wx, wy in ((c, nx, ny), (d, mx, my)):
                least = max(float(gap), TUNING.drift_gap * offset)
                push = offset / (least * (least + offset))
                fall = -push * (1.0 / least + 1.0 / (least + offset))
                for j, one in ((0, wx), (1, wy)):
                    slopes[i, j] += push * one
                    bends[i, j, 0] += fall * one * wx
                    bends[i, j, 1] += fall * one * wy
        return slopes, bends

    return drift
