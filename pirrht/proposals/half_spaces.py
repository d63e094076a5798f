"""Half-space constraints: walls that a point has yet to pass bend its psi more than any linear feedback can.

A noisy path from x that would pass a wall in a time t at a distance m does so with probability Phi(z), z = m / (b
sqrt(t)): far from it a path is free, and one that would run into it aims at its edge. At every row of a law the wall
with the least z on the rest of the guide is a constraint, and so is the one of the least z in another direction. The
part of constraints that a law contains already, to first order, is taken off it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import two_walls
from pirrht.geometry.world import WALL, MovingKernels, with_walls
from pirrht.jit.jit import borrowing, kernel
from pirrht.jit.vectors import copy_row
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.general.law import GATE, GATES, gate_slope, mills
from pirrht.rollouts.tables import Setup


def constraints_of(setup: Setup, places: Array, times: Array, noise: float, within: float) -> Array:
    """Return half-spaces (k, GATES, GATE) at places (k, 2) [m] of a guide at times (k,) [s] under noise b [m/sqrt(s)].

    Their rows are direction (x, y), z of the guide itself, and the change of z per meter. Walls farther than `within`
    [m] are skipped.
    """
    walls, out = np.full((len(places), TUNING.walls, 3), np.inf), np.zeros((len(places), GATES, GATE))
    _walls_with(setup.world.moving.kernels)(setup, places, times, within, walls)
    _choose(walls, times, noise, out)
    return out


@cache
def _walls_with(moving: MovingKernels) -> Any:
    """Build the kernel that fills `out` (k, W, 3) with clearances and directions (x, y) away from walls.

    They are those at places (k, 2) [m] and times (k,) [s].
    """
    watch, near = moving.watch, moving.walls

    @kernel
    def walls_along(setup, places, times, within, out):  # type: ignore[no-untyped-def]
        notes, rows = watch(setup.world.moving), np.zeros((setup.world.moving.J, WALL))
        for i in range(places.shape[0]):
            x, y = places[i]
            out[i, 0, 0], out[i, 0, 1], out[i, 0, 2], out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = two_walls(
                setup.world.field, x, y
            )
            count, _ = near(setup.world.moving, notes, x, y, times[i], within, rows)
            for k in range(min(count, TUNING.walls - 2)):
                copy_row(rows[k, :3], out[i, 2 + k])

    return walls_along


@borrowing
def _nearest(walls, times, i, noise, g, out):  # type: ignore[no-untyped-def]
    """Write the wall of least z at row i as constraint g of `out` (GATES, GATE); return whether there is any."""
    (place, clear, nx, ny), best = walls, TUNING.careless
    for e in range(place.shape[0]):
        ahead = times[place[e]] - times[i]
        if clear[e] > 0.0 and clear[e] * clear[e] > best * best * noise * noise * ahead * (1.0 + 1e-9):
            continue  # without a root: no better
        per = 1.0 / (noise * math.sqrt(ahead))
        z = clear[e] * per
        alike = g > 0 and nx[e] * out[0, 0] + ny[e] * out[0, 1] > TUNING.other_wall
        if z < best and not alike:
            best = z
            out[g, 0], out[g, 1], out[g, 2], out[g, 3] = nx[e], ny[e], z, per
    return best < TUNING.careless


@kernel
def _choose(walls, times, noise, out):  # type: ignore[no-untyped-def]
    """Choose the constraints `out` (k, GATES, GATE) among walls ahead (k, W, 3)."""
    last, count = times.shape[0], 0
    most = last * TUNING.walls
    place, clear, nx, ny = np.empty(most, np.int64), np.empty(most), np.empty(most), np.empty(most)
    for k in range(1, last):  # most walls are none
        near = TUNING.careless * noise * math.sqrt(times[k] - times[0]) * (1.0 + 1e-9)
        for w in range(TUNING.walls):
            if walls[k, w, 0] < near and walls[k, w, 1] ** 2 + walls[k, w, 2] ** 2 >= 0.5:  # else: out of reach
                place[count], clear[count], nx[count], ny[count] = k, walls[k, w, 0], walls[k, w, 1], walls[k, w, 2]
                count += 1
    begin = 0
    for i in range(last):
        while begin < count and times[place[begin]] - times[i] < TUNING.soonest:
            begin += 1
        ahead = place[begin:count], clear[begin:count], nx[begin:count], ny[begin:count]
        for g in range(GATES):
            if not _nearest(ahead, times, i, noise, g, out[i]):
                break


def drifts_of(setup: Setup, places: Array, times: Array, offset: float) -> tuple[Array, Array]:
    """Return the slope of log psi by near walls (k, 2) [1/m] at places (k, 2) [m] and times (k,) [s].

    Second come its derivatives (k, 2, 2) [1/m^2].
    """
    slopes, bends = np.zeros((len(places), 2)), np.zeros((len(places), 2, 2))
    _drifts_with(setup.world.moving.kernels)(setup, places, times, np.float32(offset), slopes, bends)
    return slopes, bends


@cache
def _drifts_with(moving: MovingKernels) -> Any:
    """Build the kernel that writes slopes and their derivatives."""
    watch, near = moving.watch, moving.walls

    @kernel
    def drifts(setup, places, times, offset, slopes, bends):  # type: ignore[no-untyped-def]
        notes, rows = watch(setup.world.moving), np.zeros((setup.world.moving.J, WALL))
        for i in range(places.shape[0]):
            x, y = places[i]
            static = two_walls(setup.world.field, x, y)
            count, _ = near(setup.world.moving, notes, x, y, times[i], TUNING.drift_range * offset, rows)
            c, nx, ny, d, mx, my = with_walls(static, rows, count, 0.0)
            for gap, wx, wy in ((c, nx, ny), (d, mx, my)):
                gap_least = max(float(gap), TUNING.drift_gap * offset)
                push = offset / (gap_least * (gap_least + offset))
                fall = -push * (1.0 / gap_least + 1.0 / (gap_least + offset))
                slopes[i, 0] += push * wx
                slopes[i, 1] += push * wy
                bends[i, 0, 0] += fall * wx * wx
                bends[i, 0, 1] += fall * wx * wy
                bends[i, 1, 0] += fall * wx * wy
                bends[i, 1, 1] += fall * wy * wy

    return drifts


def beyond_linear(half_spaces: Array, B: Array, gains: Array, off: Array) -> Array:
    """Return the control (2,) that half-spaces (GATES, GATE) add at `off` (2,) [m] from a guide of gains (2, 2)."""
    modes, less, weighed = without(half_spaces[None], B, np.zeros((1, 2)), gains[None])
    slope = np.array(gate_slope(weighed.reshape(1, 1, -1), 0, 0, 0, off[0], off[1]))
    extra: Array = modes[0] + (less[0] - gains) @ off + B.T @ slope
    return extra


@kernel
def without(half_spaces, B, modes, gains):  # type: ignore[no-untyped-def]
    """Take the first order of half-spaces (k, GATES, GATE) off modes (k, 2) and gains (k, 2, 2); weigh half-spaces.

    One counts for no more than there is to take off. B (2, 2) is the noise [m/sqrt(s)].
    """
    left, rest, weighed = modes.copy(), gains.copy(), half_spaces.copy()
    for i in range(weighed.shape[0]):
        for g in range(GATES):
            nx, ny, z, per = weighed[i, g, 0], weighed[i, g, 1], weighed[i, g, 2], weighed[i, g, 3]
            if per == 0.0:
                continue
            h = mills(z)
            ax, ay = B[0, 0] * nx + B[1, 0] * ny, B[0, 1] * nx + B[1, 1] * ny
            stiff = per * per * h * (z + h)
            square, across = ax * ax + ay * ay, ax * rest[i, 0, 0] + ay * rest[i, 1, 0]
            known = -across * nx - (ax * rest[i, 0, 1] + ay * rest[i, 1, 1]) * ny
            weight = min(max(known / (square * stiff), 0.0), 1.0)
            weighed[i, g, 4] = weight
            left[i, 0] -= weight * per * h * ax
            left[i, 1] -= weight * per * h * ay
            rest[i, 0, 0] += weight * stiff * ax * nx
            rest[i, 0, 1] += weight * stiff * ax * ny
            rest[i, 1, 0] += weight * stiff * ay * nx
            rest[i, 1, 1] += weight * stiff * ay * ny
    return left, rest, weighed
