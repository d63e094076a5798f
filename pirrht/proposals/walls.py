"""Walls next to guides: the cost of clearance along a step with two derivatives, and the wall drift of a point.

A step leads from one pose to another, and where its velocity changes by b, along the parabola that bows by b dt / 8
from the chord: the pose at a share t of it is (1 - t) x_0 + t x_1 + t (1 - t) b dt / 2 with b = v_0 - v_1. Moving
obstacles count where they are when the step passes a point; each is a wall of its own.
"""

from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.space import SpaceKernels
from pirrht.geometry.world import NOTHING_MOVES, WALL, MovingKernels, merging
from pirrht.jit import vectors
from pirrht.jit.jit import as_tuple, borrowing, inlined, kernel
from pirrht.proposals.tuning import TUNING


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


@cache
def clearance_costs(space: SpaceKernels, numbers: int, moving: MovingKernels | None) -> tuple[Any, Any, Any]:
    """Build the kernels `scratch`, `cost` and `expand` of the clearance cost, with or without moving obstacles.

    Poses have so many `numbers`. A step is (pose, change, loss, begin, dt): pose and displacement, loss of their rates,
    and times [s].
    """
    among = moving is not None
    watch, _, moving_walls, *_ = moving or NOTHING_MOVES
    clearance, static_walls, most, turns = space.clearance, space.near, space.near_most, numbers > space.position
    combined, extent, wide = vectors.combined(numbers), space.extent, max(WALL, 1 + numbers)

    @kernel
    def scratch(setup):  # type: ignore[no-untyped-def]
        """Allocate the walls at one place, and notes on moving obstacles."""
        return np.empty((most + setup.world.moving.J, wide)), watch(setup.world.moving)

    @borrowing
    def walls_at(setup, task, step, t, space):  # type: ignore[no-untyped-def]
        """Write the walls at a share t of a step; return their number, and the weight of its bow there [s]."""
        (pose, change, loss, begin, dt), (walls, notes) = step, space
        w = 0.5 * t * (1.0 - t) * dt
        at = combined(1.0, combined(1.0, pose, t, change), w, loss)
        count = static_walls(setup.world.static, at, task.margin, walls)
        if among:
            rows = walls[count:]
            more = moving_walls(setup.world.moving, notes, at[0], at[1], begin + t * dt, task.margin, rows)[0]
            for k in range(more if turns else 0):
                rows[k, 3] = 0.0  # no heading brings it nearer
            count += more
        return count, w

    @borrowing
    def unpriced(setup, task, step):  # type: ignore[no-untyped-def]
        """Check whether no wall has a price anywhere on a step, by the clearance of its middle."""
        pose, change, loss, _, dt = step
        w = 0.125 * dt
        middle = combined(1.0, combined(1.0, pose, 0.5, change), w, loss)
        far = task.margin + 0.5 * extent(setup.world.static, change) + w * extent(setup.world.static, loss)
        return clearance(setup.world.static, middle) > far

    @borrowing
    def cost(setup, task, step, points, space):  # type: ignore[no-untyped-def]
        """Return the clearance cost of a step [cost] at some points, its end the last."""
        total, walls = 0.0, space[0]
        if not among and unpriced(setup, task, step):
            return 0.0
        for k in range(1, points + 1):
            count, _ = walls_at(setup, task, step, k / points, space)
            for i in range(count):
                total += barrier(walls[i, 0], task)[0]
        return task.price * total * step[4] / points

    @borrowing
    def expand(setup, task, step, points, space, g, H):  # type: ignore[no-untyped-def]
        """Differentiate `cost` in both poses and b: gradient to g (3 k,), Gauss-Newton Hessian to H (3 k, 3 k).

        Returns: whether there are any walls; otherwise nothing is written.
        """
        found, walls = False, space[0]
        if not among and unpriced(setup, task, step):
            return False
        for k in range(1, points + 1):
            t = k / points
            count, w = walls_at(setup, task, step, t, space)
            share = (1.0 - t, t, w)
            scale = task.price * step[4] / points

            for e in range(count):
                if not found:
                    g[:], H[:, :], found = 0.0, 0.0, True
                _, rise, bend = barrier(walls[e, 0], task)
                for i in range(3):
                    one = scale * share[i]
                    for a in range(numbers):
                        g[numbers * i + a] += one * rise * walls[e, 1 + a]
                    for j in range(3):
                        both = one * bend * share[j]
                        for a in range(numbers):
                            for b in range(numbers):
                                H[numbers * i + a, numbers * j + b] += (
                                    both * walls[e, 1 + min(a, b)] * walls[e, 1 + max(a, b)]
                                )
        return found

    return scratch, cost, expand


@cache
def drift_along(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel (setup, places (k, d), times (k,), offset) of a point's wall drift along a guide.

    It returns the slope of log psi (k, d) [1/m] by near walls of an offset [m], and its derivatives (k, d, d) [1/m^2],
    at places [m] and at times [s] on the clock of moving obstacles.
    """
    among, d = moving is not None, space.position
    watch, _, near, *_ = moving or NOTHING_MOVES
    two_walls, with_walls = space.walls, merging(d)

    @kernel
    def drift(setup, places, times, offset):  # type: ignore[no-untyped-def]
        k = places.shape[0]
        notes = watch(setup.world.moving)
        rows = np.zeros((setup.world.moving.J, WALL))

        slopes = np.zeros((k, d))
        bends = np.zeros((k, d, d))
        within = TUNING.drift_near * offset

        for i in range(k):
            walls = two_walls(setup.world.static, as_tuple(places[i], d))
            if among:
                count, _ = near(setup.world.moving, notes, places[i, 0], places[i, 1], times[i], within, rows)
                walls = with_walls(walls, rows, count, 0.0)
            for gap, away in (walls[:2], walls[2:]):
                least = max(float(gap), TUNING.drift_gap * offset)
                push = offset / (least * (least + offset))
                fall = -push * (1.0 / least + 1.0 / (least + offset))
                for j in range(d):
                    slopes[i, j] += push * away[j]
                    for e in range(d):
                        bends[i, j, e] += fall * away[j] * away[e]
        return slopes, bends

    return drift
