"""Terminal costs of MPPI: the cost to go along the shortest path to the goal, or along the straight line.

A `Remaining` takes positions (k, 2) [m] to vectors (k, 2) [m]: straight lines that are as long as the paths left to the
goal's disc and begin as those do. A cost without obstacles along that line is then a guess of the cost to go.

Shortest paths solve the eikonal equation |grad d| = 1 with d = 0 at the goal, on a grid of static free space, by fast
sweeping (Zhao, Mathematics of Computation 74, 2005). Like a global plan they know neither noise nor moving obstacles,
which samples meet within the horizon.
"""

import math
from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array
from pirrht.control.settings import TUNING
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.blocks import lattice
from pirrht.geometry.scene import Goal
from pirrht.geometry.space import clearances_of
from pirrht.jit.jit import kernel
from pirrht.problem import Problem
from pirrht.traits import Traits

Remaining = Callable[[Array], Array]


def straight_lines(goal: Goal) -> Remaining:
    """Return the straight lines to the goal's disc, through obstacles."""

    def remaining(positions: Array) -> Array:
        off = goal.center - positions
        return np.asarray(off * (1.0 - goal.radius / np.maximum(np.hypot.reduce(off, axis=1), goal.radius))[:, None])

    return remaining


def shortest_paths(space: FreeSpace) -> Remaining:
    """Return the shortest paths to the goal's disc through static free space, each unrolled to a straight line."""
    from scipy.ndimage import distance_transform_edt

    scene = space.scene
    if scene.dimension != 2:
        raise OptionError("shortest paths are those of robots on the ground; in space take straight lines")

    lower = scene.lower.astype(float)
    span = (scene.upper - scene.lower).astype(float)

    spacing = max(TUNING.path_radii * scene.robot_radius, math.sqrt(float(np.prod(span)) / TUNING.path_points))
    points = lower + spacing * lattice(*(np.ceil(span / spacing - 1e-9).astype(int) + 1))
    shape = points.shape[:2]
    free = np.empty(math.prod(shape))
    away = np.hypot(*np.moveaxis(points - scene.goal.center, -1, 0)) - scene.goal.radius
    clearances_of(space.field.kernels)(space.field, points.reshape(-1, 2), free)
    passable = free.reshape(shape) > -0.5 * spacing  # so that no passage falls between the points
    known = passable & (away < 2.0 * spacing)
    length = np.pad(np.where(known, away, np.inf), 1, constant_values=np.inf)
    sweep(length, np.pad(passable & ~known, 1), spacing)

    def towards(low: Array, high: Array) -> Array:
        """Return how much shorter the path is on the better side, negative on the low one; 0 if neither is better."""
        gain = np.nan_to_num(length[1:-1, 1:-1] - np.minimum(low, high), nan=0.0, posinf=0.0)
        return np.asarray(np.where(low < high, -1.0, 1.0) * np.maximum(gain, 0.0))

    with np.errstate(invalid="ignore"):  # inf - inf
        along = towards(length[:-2, 1:-1], length[2:, 1:-1]), towards(length[1:-1, :-2], length[1:-1, 2:])
    nearest = tuple(
        distance_transform_edt(~np.isfinite(length[1:-1, 1:-1]), return_distances=False, return_indices=True)
    )
    table = np.stack((length[1:-1, 1:-1], *along), axis=-1)[nearest]  # a path begins at the nearest free point

    def remaining(positions: Array) -> Array:
        at = (positions - lower) / spacing
        cell = np.clip(at.astype(int), 0, np.array(shape) - 2)
        i, j = cell.T
        u, v = (at - cell).T[:, :, None]
        low = (1.0 - v) * table[i, j] + v * table[i, j + 1]
        high = (1.0 - v) * table[i + 1, j] + v * table[i + 1, j + 1]
        left, x, y = ((1.0 - u) * low + u * high).T
        share = np.maximum(left, 0.0) / np.maximum(np.hypot(x, y), 1e-12)
        return np.column_stack((share * x, share * y))

    return remaining


@kernel
def sweep(length, passable, spacing):  # type: ignore[no-untyped-def]
    """Solve |grad length| = 1 for `length` (nx, ny) [m] at passable inner points of a grid, by sweeps from all corners.

    The other points keep their values; those out of reach stay infinite.
    """
    nx, ny = length.shape
    changed, corner = 4, 0  # changed: sweeps that are left before all four corners have changed nothing
    while changed > 0:
        changed = changed - 1
        right = corner % 2 == 0
        up = corner < 2

        for row in range(1, nx - 1):
            i = row if right else nx - 1 - row
            for column in range(1, ny - 1):
                j = column if up else ny - 1 - column
                if not passable[i, j]:
                    continue
                a = min(length[i - 1, j], length[i + 1, j])
                b = min(length[i, j - 1], length[i, j + 1])
                low = min(a, b)
                gap = abs(a - b)

                if low == math.inf:
                    continue
                new = 0.5 * (a + b + math.sqrt(2.0 * spacing * spacing - gap * gap)) if gap < spacing else low + spacing
                if new < length[i, j] - 1e-9 * spacing:
                    length[i, j] = new
                    changed = 4
        corner = (corner + 1) % 4


def cost_to_go(problem: Problem, remaining: Remaining) -> Callable[[Array], Array]:
    """Return the cost (k,) [cost] of going on from states (k, n) along their remaining paths, without noise.

    A robot whose position is controlled goes at the speed that balances q against u'Ru/2, helped by its drift, in its
    best direction; any other at the speed of its drift (OptionError: it has none at the start); and turning is free.
    """
    d, q = problem.dynamics, problem.least_rate
    x = d.state_of(problem.scene.start)
    drift = float(np.hypot.reduce(d.place(d.f(x))))
    if Traits.of(problem).noisy_position:
        G = d.whole(d.G_c(x))[list(d.position)]
        weight = 1.0 / float(np.linalg.eigvalsh(G @ np.linalg.solve(problem.control_cost(x), G.T))[-1])
        per_meter = weight * (np.sqrt(drift**2 + 2.0 * q / weight) - drift)  # least (q + weight (v - drift)^2 / 2) / v
    elif drift > 0.0:
        per_meter = q / drift
    else:
        raise OptionError(
            f"{type(d).__name__} has no speed at the start, so its cost to go is unknown; give a `terminal_cost`"
        )
    return lambda states: np.asarray(per_meter * np.hypot.reduce(remaining(d.place(states)), axis=1))
