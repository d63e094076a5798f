"""Gather the boundaries that paths from a place can meet within a step, and the grid points where they end.

Solids in one direction from a place are one wall, at the clearance of the nearest; each direction has its own. Around a
boundary that is alone psi is known: K_0(k rho)/K_0(k r) around the goal's disc, exp(-(m + n) d) at a flat wall from
which noise and its own speed carry a path away with a drift of m b^2, n^2 = m^2 + k^2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.exact.bodies import Bodies, clearance_and_slope, clearance_from
from pirrht.exact.grid import TUNING, Frame, polynomial, to_rim
from pirrht.geometry.walls import stands_apart
from pirrht.jit.jit import inlined, kernel

GOAL, WALL, LEFT, RIGHT, LOW, HIGH = range(6)  # kinds of boundaries


class Surroundings(NamedTuple):
    """Boundaries of paths without the poses of bodies."""

    frame: Frame  # of the grid, and the goal's disc
    left: float  # border of the workspace [m]
    low: float  # [m]
    right: float  # [m]
    high: float  # [m]
    bodies: Bodies
    around_goal: Array  # (n,) K_0(k rho)/K_0(k r) at distances rho - r ...
    pitch: float  # ... of so much times 0, 1, ... [m]


class Step(NamedTuple):
    """A step in time."""

    dt: float  # [s]
    b: float  # noise [m/sqrt(s)]
    deviation: float  # b sqrt(dt) along each axis [m]
    rate: float  # q/lambda [nats/s]
    wall: float  # phi/lambda [nats]; may be infinite
    cutoff: float  # boundaries and ends further away do not matter [m]


class Patch(NamedTuple):
    """Points that paths from a rectangle of the grid can reach in a step, and the solids that they can meet."""

    i0: int  # grid indices of its first point
    j0: int
    margin: int  # points around the rectangle
    psi: Array  # (k, l) at the end of the step, over exp(base)
    base: float  # [nats]
    rim: Array  # (k, l) distance from the goal's disc [m]
    around_goal: Array  # (k, l) psi if nothing but the goal is near
    near: IntArray  # (c,) solids within reach
    ahead: Array  # (c, k, l) clearances from them at the end of the step [m]
    begin: Array  # (1 + J, 4) poses of bodies at the beginning of the step, as of `frames_of`
    end: Array  # (1 + J, 4) and at its end


class Boundaries(NamedTuple):
    """Boundaries within reach of a place, and what a path's survival and payment depend on."""

    kind: IntArray  # (B,) GOAL, WALL, LEFT, ...
    distance: Array  # (B,) [m]
    speed: Array  # (B,) growth of the distance while a path stays [m/s]
    steepness: Array  # (B,) m + n of psi at a wall that is alone [1/m]
    member: IntArray  # (c,) boundary that a solid belongs to; -1: none


@inlined
def step_of(dt, b, rate, wall):  # type: ignore[no-untyped-def]
    """Return a step of dt [s] for noise b [m/sqrt(s)], q/lambda [nats/s] and phi/lambda [nats]."""
    deviation = b * math.sqrt(dt)
    return Step(dt, b, deviation, rate, wall, (TUNING.cutoff + math.sqrt(2.0 * rate * dt)) * deviation)


@inlined
def to_border(surroundings, x, y):  # type: ignore[no-untyped-def]
    """Distance of (x, y) from the border of the workspace [m], negative outside."""
    return min(min(x - surroundings.left, surroundings.right - x), min(y - surroundings.low, surroundings.high - y))


@kernel
def solids_near(bodies, begin, end, x, y, cutoff):  # type: ignore[no-untyped-def]
    """Solids that are within reach of (x, y) [m] at the beginning or the end of a step."""
    near, count = np.empty(bodies.owner.shape[0], dtype=np.int64), 0
    for k in range(near.shape[0]):
        d = clearance_from(bodies, k, begin, x, y)
        if min(d, clearance_from(bodies, k, end, x, y)) < cutoff:
            near[count] = k
            count += 1
    return near[:count]


@kernel
def patch_of(surroundings, later, near, begin, end, corners, margin):  # type: ignore[no-untyped-def]
    """Return the `Patch` of grid points from (i0, j0) to (i1, j1), end excluded."""
    i0, j0 = corners[0] - margin, corners[1] - margin
    k, m, frame, bodies = corners[2] - i0 + margin, corners[3] - j0 + margin, surroundings.frame, surroundings.bodies
    psi, rim, ahead = np.zeros((k, m)), np.empty((k, m)), np.empty((near.shape[0], k, m))
    around_goal, table, pitch = np.ones((k, m)), surroundings.around_goal, surroundings.pitch
    a0, b0, a1, b1 = max(i0, 0), max(j0, 0), min(i0 + k, later.shape[0]), min(j0 + m, later.shape[1])
    base = -math.inf
    for i in range(a0, a1):
        for j in range(b0, b1):
            base = max(base, float(later[i, j]))
    for i in range(k):
        for j in range(m):
            a, b = i0 + i, j0 + j
            x, y = frame.x0 + a * frame.spacing, frame.y0 + b * frame.spacing
            rim[i, j] = to_rim(frame, x, y)
            if rim[i, j] > 0.0:
                around_goal[i, j] = psi_around_goal(table, pitch, rim[i, j])
            for n in range(near.shape[0]):
                ahead[n, i, j] = clearance_from(bodies, near[n], end, x, y)
            if base > -math.inf and a0 <= a < a1 and b0 <= b < b1:
                psi[i, j] = math.exp(later[a, b] - base)
    return Patch(i0, j0, margin, psi, base, rim, around_goal, near, ahead, begin, end)


@kernel
def boundaries_of(surroundings, step, patch, x, y):  # type: ignore[no-untyped-def]
    """Tell whether (x, y) [m] is free, and return the `Boundaries` within reach of it."""
    count, most, frame = len(patch.near), 5 + TUNING.directions, surroundings.frame
    kind, distance = np.zeros(most, dtype=np.int64), np.empty(most)
    speed, steepness, member = np.zeros(most), np.empty(most), np.full(count, -1)
    clear, n, rim = np.empty((count, 5)), 0, to_rim(frame, x, y)
    free = rim > 0.0 and to_border(surroundings, x, y) > 0.0
    for k in range(count):
        clear[k, 0], clear[k, 1], clear[k, 2], clear[k, 3], clear[k, 4] = clearance_and_slope(
            surroundings.bodies, patch.near[k], patch.begin, x, y
        )
        free = free and clear[k, 0] > 0.0
    if free and rim < step.cutoff:
        distance[0], n = rim, 1
    while free and n < most - 4:
        at = _nearest_left(clear, member, step.cutoff)
        if at < 0:
            break
        then = _join_wall(surroundings.bodies, patch, clear, member, (at, n), (x, y, step.cutoff))
        kind[n], distance[n], speed[n] = WALL, clear[at, 0], (then - clear[at, 0]) / step.dt
        drift = speed[n] / (step.b * step.b)
        if step.wall < math.inf:
            drift += 0.5 * _curvature(surroundings.bodies, patch.near[at], patch.begin, x, y, clear[at])
        steepness[n] = drift + math.sqrt(drift * drift + 2.0 * step.rate / (step.b * step.b))
        n += 1
    sides = (x - surroundings.left, surroundings.right - x, y - surroundings.low, surroundings.high - y)
    for k in range(4):
        if sides[k] < step.cutoff:
            kind[n], distance[n], steepness[n] = LEFT + k, sides[k], math.sqrt(2.0 * step.rate) / step.b
            n += 1
    return free, Boundaries(kind[:n], distance[:n], speed[:n], steepness[:n], member)


@kernel
def _join_wall(bodies, patch, clear, member, which, place):  # type: ignore[no-untyped-def]
    """Gather the solids in the direction of solid `at` as wall n; its clearance at the end of the step [m]."""
    (at, n), (x, y, cutoff), then = which, place, math.inf
    for k in range(len(patch.near)):
        apart = stands_apart(clear[k, 1], clear[k, 2], clear[at, 1], clear[at, 2])
        if member[k] < 0 and (k == at or (clear[k, 0] < cutoff and not apart)):
            member[k] = n
            then = min(then, clearance_from(bodies, patch.near[k], patch.end, x, y))
    return then


@inlined
def _nearest_left(clear, member, cutoff):  # type: ignore[no-untyped-def]
    """Index of the nearest solid within reach [m] that belongs to no wall; -1: none."""
    at = -1
    for k in range(clear.shape[0]):
        if member[k] < 0 and clear[k, 0] < cutoff and (at < 0 or clear[k, 0] < clear[at, 0]):
            at = k
    return at


@kernel
def _curvature(bodies, k, pose, x, y, clear):  # type: ignore[no-untyped-def]
    """Laplacian [1/m] of the clearance from solid k half-way from (x, y) [m] to it, by differences; at least 0.

    `clear` (5,) is that of `clearance_and_slope` at (x, y).
    """
    x, y, e = x - 0.5 * clear[0] * clear[3], y - 0.5 * clear[0] * clear[4], TUNING.curvature_arm * bodies.radius
    total = clearance_from(bodies, k, pose, x - e, y) + clearance_from(bodies, k, pose, x + e, y)
    total += clearance_from(bodies, k, pose, x, y - e) + clearance_from(bodies, k, pose, x, y + e)
    return max((total - 4.0 * clearance_from(bodies, k, pose, x, y)) / (e * e), 0.0)


@kernel
def distances_ahead(surroundings, patch, met, i0, j0, out):  # type: ignore[no-untyped-def]
    """Fill `out` (B, w, w) with distances [m] of boundaries from points from (i0, j0) of a patch on."""
    width, frame = out.shape[1], surroundings.frame
    for g in range(out.shape[0]):
        kind = met.kind[g]
        if kind == GOAL:
            out[g] = patch.rim[i0 : i0 + width, j0 : j0 + width]
        elif kind == WALL:
            out[g], table = math.inf, patch.ahead
            for k in range(met.member.shape[0]):
                if met.member[k] == g:
                    for a in range(width):
                        for c in range(width):
                            out[g, a, c] = min(out[g, a, c], table[k, i0 + a, j0 + c])
        else:
            for a in range(width):
                x = frame.x0 + (patch.i0 + i0 + a) * frame.spacing
                y = frame.y0 + (patch.j0 + j0 + a) * frame.spacing
                if kind <= RIGHT:
                    out[g, a, :] = x - surroundings.left if kind == LEFT else surroundings.right - x
                else:
                    out[g, :, a] = y - surroundings.low if kind == LOW else surroundings.high - y


@kernel
def psi_around_goal(table, pitch, e):  # type: ignore[no-untyped-def]
    """psi at a distance e [m] from the goal's disc if nothing else is near."""
    i, value = min(max(int(e / pitch), 1), table.shape[0] - 3), 0.0
    for c in range(-1, 3):
        value += polynomial(min(e / pitch - i, 2.0), c) * table[i + c]
    return value
