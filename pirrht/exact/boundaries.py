"""Gather the boundaries that paths from a place can meet within a step, and the grid points where they end.

Boundaries are rows of a table: the goal, four borders of the workspace, then solids. Solids of the static world are
body 0, and each moving obstacle is one. Solids and borders in one direction from a place are one wall, at the clearance
of the nearest; each direction has its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.exact.grid import TUNING, Frame, to_rim
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Scene
from pirrht.geometry.walls import stands_apart
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import clearance_of_solid, offset_of_solid, piece_of
from pirrht.moving.obstacles import MovingObstacleArrays

SOLID = 5  # row of the first solid; the goal's is 0
JUMP = 1e-9  # a repeated motion is judged so much away from where it starts over [s]


class Surroundings(NamedTuple):
    """Everything that paths can meet."""

    frame: Frame  # of the grid, and the goal's disc
    left: float  # border of the workspace [m]
    low: float  # [m]
    right: float  # [m]
    high: float  # [m]
    solids: MovingObstacleArrays  # K solids of 1 + J bodies, each in its body's frame
    owner: IntArray  # (K,) body of each
    around_goal: Array  # (n,) psi around a goal that is alone, K_0(k rho)/K_0(k r) at distances rho - r ...
    pitch: float  # ... of so much times 0, 1, ... [m]


class Patch(NamedTuple):
    """Points that paths from a rectangle of the grid can reach in a step, and the solids that they can meet."""

    i0: int  # grid indices of its first point
    j0: int
    width: int  # points that a path from one place can reach, along each axis
    psi: Array  # (k, l) at the end of the step, over exp(base)
    base: float  # [nats]
    near: IntArray  # (c,) solids within reach
    ahead: Array  # (5 + c, k, l) clearances from boundaries at the end of the step [m]
    begin: Array  # (1 + J, 4) poses of bodies at the beginning of the step, as of `poses_at`
    end: Array  # (1 + J, 4) and at its end


class Boundaries(NamedTuple):
    """B boundaries within reach of a place, and the dependence of a path's survival and payment on them."""

    goals: int  # 1 if the first is the goal, else 0; others are walls
    solid: bool  # whether any is a solid
    member: IntArray  # (5 + c,) boundary that a row of the table belongs to; -1: none
    distance: Array  # (B,) [m]
    speed: Array  # (B,) growth of the distance while a path stays [m/s]
    steepness: Array  # (B,) m + n of psi at a wall that is alone [1/m]


def surroundings_of(scene: Scene, frame: Frame, cutoff: float, around_goal: Array, pitch: float) -> Surroundings:
    """Gather what surrounds paths in a scene, for distances up to a cutoff [m]; psi around the goal as a table."""
    static = Mover(name="static", solids=tuple(scene.obstacles), motion=Motion(rows=np.zeros((1, 4))))
    every = static, *scene.movers
    owner = np.repeat(np.arange(len(every)), [len(body.solids) for body in every])
    (left, low), (right, high) = scene.lower.astype(float).tolist(), scene.upper.astype(float).tolist()
    solids = MovingObstacleArrays.around(scene.footprint, every, cutoff)
    return Surroundings(frame, left, low, right, high, solids, owner, around_goal, pitch)


@kernel
def poses_at(solids, t):  # type: ignore[no-untyped-def]
    """Return x, y [m], cosine and sine of the yaw of all bodies at t [s], (1 + J, 4)."""
    out = np.empty((solids.J, 4))
    for j in range(solids.J):
        out[j, 0], out[j, 1], yaw, _, _, _, _ = piece_of(solids, j, t)
        out[j, 2], out[j, 3] = math.cos(yaw), math.sin(yaw)
    return out


@inlined
def clearance_from(surroundings, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Return the clearance of the robot's centre at (x, y) [m] from solid k [m], minus its radius deep inside."""
    u, v = _in_body(pose, surroundings.owner[k], x, y)
    return clearance_of_solid(surroundings.solids, k, u, v)


@inlined
def _in_body(pose, owner, x, y):  # type: ignore[no-untyped-def]
    """Return a point (x, y) in a body's own frame [m]."""
    dx, dy, c, s = x - pose[owner, 0], y - pose[owner, 1], pose[owner, 2], pose[owner, 3]
    return c * dx + s * dy, c * dy - s * dx


@inlined
def to_border(surroundings, x, y):  # type: ignore[no-untyped-def]
    """Distance of (x, y) from the border of the workspace [m], negative outside."""
    return min(min(x - surroundings.left, surroundings.right - x), min(y - surroundings.low, surroundings.high - y))


@kernel
def clearance_at(surroundings, pose, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all solids, posed (1 + J, 4), and from the border [m]."""
    out = to_border(surroundings, x, y)
    for k in range(surroundings.owner.shape[0]):
        out = min(out, clearance_from(surroundings, k, pose, x, y))
    return out


@kernel
def solids_near(surroundings, begin, end, x, y, cutoff):  # type: ignore[no-untyped-def]
    """Solids that are within reach of (x, y) [m] at the beginning or the end of a step."""
    near, count = np.empty(surroundings.owner.shape[0], dtype=np.int64), 0
    for k in range(near.shape[0]):
        d = clearance_from(surroundings, k, begin, x, y)
        if min(d, clearance_from(surroundings, k, end, x, y)) < cutoff:
            near[count] = k
            count += 1
    return near[:count]


@kernel
def patch_of(surroundings, later, near, begin, end, corners, margin):  # type: ignore[no-untyped-def]
    """Return the `Patch` of grid points from (i0, j0) to (i1, j1), end excluded, and a margin around them."""
    i0, j0, frame = corners[0] - margin, corners[1] - margin, surroundings.frame
    k, m = corners[2] - i0 + margin, corners[3] - j0 + margin
    psi, ahead = np.zeros((k, m)), np.empty((SOLID + near.shape[0], k, m))
    a0, b0, a1, b1 = max(i0, 0), max(j0, 0), min(i0 + k, later.shape[0]), min(j0 + m, later.shape[1])
    base = later[a0:a1, b0:b1].max() if a0 < a1 and b0 < b1 else -math.inf
    for i in range(k):
        for j in range(m):
            x, y = frame.x0 + (i0 + i) * frame.spacing, frame.y0 + (j0 + j) * frame.spacing
            _to_rows(surroundings, near, end, x, y, ahead[:, i, j])
            if base > -math.inf and a0 <= i0 + i < a1 and b0 <= j0 + j < b1:
                psi[i, j] = math.exp(later[i0 + i, j0 + j] - base)
    return Patch(i0, j0, 2 * margin + 1, psi, base, near, ahead, begin, end)


@inlined
def _to_rows(surroundings, near, pose, x, y, out):  # type: ignore[no-untyped-def]
    """Fill `out` (5 + c,) with distances of (x, y) [m] from goal, borders and solids."""
    out[0] = to_rim(surroundings.frame, x, y)
    out[1], out[2] = x - surroundings.left, surroundings.right - x
    out[3], out[4] = y - surroundings.low, surroundings.high - y
    for n in range(near.shape[0]):
        out[SOLID + n] = clearance_from(surroundings, near[n], pose, x, y)


@kernel
def boundaries_of(surroundings, step, patch, x, y):  # type: ignore[no-untyped-def]
    """Tell whether (x, y) [m] is free, and return the `Boundaries` within reach of it."""
    rows, most, noise = SOLID + len(patch.near), 1 + TUNING.directions, step.b * step.b
    now, then, away, slope = np.empty(rows), np.empty(rows), np.zeros((rows, 2)), np.zeros((rows, 2))
    _to_rows(surroundings, patch.near, patch.begin, x, y, now)
    _to_rows(surroundings, patch.near, patch.end, x, y, then)
    away[1, 0], away[2, 0], away[3, 1], away[4, 1] = now[1], -now[2], now[3], -now[4]
    for k in range(len(patch.near)):
        owner = surroundings.owner[patch.near[k]]
        u, v = _in_body(patch.begin, owner, x, y)
        ex, ey, gx, gy = offset_of_solid(surroundings.solids, patch.near[k], u, v)
        c, s = patch.begin[owner, 2], patch.begin[owner, 3]
        away[SOLID + k, 0], away[SOLID + k, 1] = c * ex - s * ey, s * ex + c * ey
        slope[SOLID + k, 0], slope[SOLID + k, 1] = c * gx - s * gy, s * gx + c * gy
    member, n, solid = np.full(rows, -1), 0, False
    distance, speed, steepness = np.empty(most), np.zeros(most), np.zeros(most)
    if now[0] < step.cutoff:
        member[0], distance[0], n = 0, now[0], 1
    goals = n
    while n < most:
        at = -1
        for k in range(1, rows):
            if member[k] < 0 and now[k] < step.cutoff and (at < 0 or now[k] < now[at]):
                at = k
        if at < 0:
            break
        later = math.inf
        for k in range(1, rows):
            apart = stands_apart(away[k, 0], away[k, 1], away[at, 0], away[at, 1])
            if member[k] < 0 and (k == at or (now[k] < step.cutoff and not apart)):
                member[k], later, solid = n, min(later, then[k]), solid or k >= SOLID
        distance[n], speed[n] = now[at], (later - now[at]) / step.dt
        drift = speed[n] / noise
        if step.wall < math.inf and at >= SOLID:
            px, py = x - 0.5 * now[at] * slope[at, 0], y - 0.5 * now[at] * slope[at, 1]  # half-way to it
            drift += 0.5 * _curvature(surroundings, patch.near[at - SOLID], patch.begin, px, py)
        steepness[n] = drift + math.sqrt(drift * drift + 2.0 * step.rate / noise)
        n += 1
    return now.min() > 0.0, Boundaries(goals, solid, member, distance[:n], speed[:n], steepness[:n])


@kernel
def _curvature(surroundings, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Laplacian [1/m] of the clearance from solid k at (x, y) [m], by differences; at least 0."""
    e = TUNING.curvature_arm * surroundings.solids.robot
    total = -4.0 * clearance_from(surroundings, k, pose, x, y)
    for side in (-e, e):
        total += clearance_from(surroundings, k, pose, x + side, y) + clearance_from(surroundings, k, pose, x, y + side)
    return max(total / (e * e), 0.0)
