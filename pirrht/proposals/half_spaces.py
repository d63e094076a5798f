"""Gates, the walls that a point has yet to pass, which bend its psi more than any linear feedback can.

A noisy path from x that would pass a wall in a time t at a distance m does so with probability Phi(z), z = m / (b
sqrt(t)): far from it a path is free, and one that would run into it aims at its edge. At every row of a law the wall
with the least z on the rest of the guide is a gate, and so is the one of the least z in another direction. The part of
gates that a law contains already, to first order, is taken off it.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import two_walls
from pirrht.jit.jit import kernel
from pirrht.jit.vectors import copy_row
from pirrht.moving.broad_phase_cache import held_of
from pirrht.moving.exits import walls_along, with_walls
from pirrht.moving.tuning import WALL
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.general.law import GATE, GATES, gate_slope, mills


def constraints_of(setup: object, places: Array, times: Array, noise: float, within: float) -> Array:
    """Return gates (k, GATES, GATE) at places (k, 2) [m] of a guide at times (k,) [s] under noise b [m/sqrt(s)].

    Walls farther than `within` [m] are skipped.
    """
    k = len(places)
    walls, gates = np.full((k, TUNING.walls, 3), np.inf), np.zeros((k, GATES, GATE))
    _walls(setup, places, times, within, walls)
    _gates(walls, times, noise, gates)
    return gates


@kernel
def _walls(setup, places, times, within, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k, W, 3) with clearances and directions (x, y) away from walls at places (k, 2), times (k,)."""
    J, many = setup.traffic.J, 0
    held, listed, near = held_of(J), np.empty(J, np.int64), np.zeros((J, WALL))
    for i in range(places.shape[0]):
        x, y = places[i]
        c, nx, ny, d, mx, my = two_walls(setup.arena.field, x, y)
        out[i, 0, 0], out[i, 0, 1], out[i, 0, 2] = c, nx, ny
        out[i, 1, 0], out[i, 1, 1], out[i, 1, 2] = d, mx, my
        many, count = walls_along(setup.traffic, x, y, times[i], within, held, listed, many, near)
        for k in range(min(count, TUNING.walls - 2)):
            copy_row(near[k, :3], out[i, 2 + k])


@kernel
def _gates(walls, times, noise, gates):  # type: ignore[no-untyped-def]
    """Fill gates (k, GATES, GATE): direction (x, y), z of the guide itself, and what z changes by per meter."""
    last, count = times.shape[0], 0
    most = last * TUNING.walls
    place, clear, nx, ny = np.empty(most, np.int64), np.empty(most), np.empty(most), np.empty(most)
    for k in range(1, last):  # most walls are none
        near = TUNING.careless * noise * math.sqrt(times[k] - times[0]) * (1.0 + 1e-9)
        for w in range(TUNING.walls):
            if walls[k, w, 0] < near and walls[k, w, 1] ** 2 + walls[k, w, 2] ** 2 >= 0.5:  # else: out of reach
                place[count], clear[count] = k, walls[k, w, 0]
                nx[count], ny[count] = walls[k, w, 1], walls[k, w, 2]
                count += 1
    begin = 0
    for i in range(last):
        while begin < count and times[place[begin]] - times[i] < TUNING.soonest:
            begin += 1
        for g in range(GATES):
            best = TUNING.careless
            for e in range(begin, count):
                ahead = times[place[e]] - times[i]
                if clear[e] > 0.0 and clear[e] * clear[e] > best * best * noise * noise * ahead * (1.0 + 1e-9):
                    continue  # without a root: no better
                per = 1.0 / (noise * math.sqrt(ahead))
                z = clear[e] * per
                if not z < best:
                    continue
                if g > 0 and nx[e] * gates[i, 0, 0] + ny[e] * gates[i, 0, 1] > TUNING.other_wall:
                    continue
                best = z
                gates[i, g, 0], gates[i, g, 1], gates[i, g, 2], gates[i, g, 3] = nx[e], ny[e], z, per
            if best == TUNING.careless:
                break


def drifts_of(setup: object, places: Array, times: Array, reach: float) -> tuple[Array, Array]:
    """Return the slope of log psi by near walls (k, 2) [1/m] at places (k, 2) [m] and times (k,) [s].

    Second come its derivatives (k, 2, 2) [1/m^2].
    """
    k = len(places)
    slopes, bends = np.zeros((k, 2)), np.zeros((k, 2, 2))
    _pushes(setup, places, times, np.float32(reach), slopes, bends)
    return slopes, bends


@kernel
def _pushes(setup, places, times, reach, slopes, bends):  # type: ignore[no-untyped-def]
    J, many, within = setup.traffic.J, 0, TUNING.drift_range * reach
    held, listed, near = held_of(J), np.empty(J, np.int64), np.zeros((J, WALL))
    for i in range(places.shape[0]):
        x, y = places[i]
        standing = two_walls(setup.arena.field, x, y)
        many, count = walls_along(setup.traffic, x, y, times[i], within, held, listed, many, near)
        c, nx, ny, d, mx, my = with_walls(standing, near, count, 0.0)
        for gap, wx, wy in ((c, nx, ny), (d, mx, my)):
            near_by = max(float(gap), TUNING.drift_gap * reach)
            push = reach / (near_by * (near_by + reach))
            fall = -push * (1.0 / near_by + 1.0 / (near_by + reach))
            slopes[i, 0] += push * wx
            slopes[i, 1] += push * wy
            bends[i, 0, 0] += fall * wx * wx
            bends[i, 0, 1] += fall * wx * wy
            bends[i, 1, 0] += fall * wx * wy
            bends[i, 1, 1] += fall * wy * wy


def beyond_linear(gates: Array, B: Array, gains: Array, off: Array) -> Array:
    """Return the control (2,) that gates (GATES, GATE) add at `off` (2,) [m] from a guide of gains (2, 2)."""
    modes, less, weighed = without(gates[None], B, np.zeros((1, 2)), gains[None])
    slope = np.array(gate_slope(weighed.reshape(1, 1, -1), 0, 0, 0, off[0], off[1]))
    extra: Array = modes[0] + (less[0] - gains) @ off + B.T @ slope
    return extra


def without(gates: Array, B: Array, modes: Array, gains: Array) -> tuple[Array, Array, Array]:
    """Take the part of gates (k, GATES, GATE) to first order off modes (k, 2) and gains (k, 2, 2); weigh the gates.

    A gate counts for no more than there is to take off. B (2, 2) is the noise [m/sqrt(s)].
    """
    modes, gains, gates = modes.copy(), gains.copy(), gates.copy()
    _take_off(gates, B, modes, gains)
    return modes, gains, gates


@kernel
def _take_off(gates, B, modes, gains):  # type: ignore[no-untyped-def]
    for i in range(gates.shape[0]):
        for g in range(GATES):
            nx, ny, z, per = gates[i, g, 0], gates[i, g, 1], gates[i, g, 2], gates[i, g, 3]
            if per == 0.0:
                continue
            h = mills(z)
            ax, ay = B[0, 0] * nx + B[1, 0] * ny, B[0, 1] * nx + B[1, 1] * ny
            stiff = per * per * h * (z + h)
            square, across = ax * ax + ay * ay, ax * gains[i, 0, 0] + ay * gains[i, 1, 0]
            known = -across * nx - (ax * gains[i, 0, 1] + ay * gains[i, 1, 1]) * ny
            weight = min(max(known / (square * stiff), 0.0), 1.0)
            gates[i, g, 4] = weight
            modes[i, 0] -= weight * per * h * ax
            modes[i, 1] -= weight * per * h * ay
            gains[i, 0, 0] += weight * stiff * ax * nx
            gains[i, 0, 1] += weight * stiff * ax * ny
            gains[i, 1, 0] += weight * stiff * ay * nx
            gains[i, 1, 1] += weight * stiff * ay * ny
