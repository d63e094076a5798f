"""Measure how far the robot is from static and moving solids, each in its own body's frame.

Boxes, cylinders, spheres and capsules have closed forms. Other solids have a table: FCL's distances on
a lattice around each, sampled once, since in its own frame a shape is static. For a robot that is small against
these solids the lattices are coarser than it would need, and what interpolation may be too high by is taken off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.collision import Collision
from pirrht.geometry.motion import Mover
from pirrht.geometry.scene import Footprint, Obstacle, Scene, Workspace
from pirrht.geometry.shapes import Solids, distance_from, offset_from
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.tuning import TUNING


class Bodies(NamedTuple):
    """K solids: those of the static world, which is body 0, then those of J movers, bodies 1 to J."""

    solids: Solids  # (K,) each in its own body's frame
    owner: IntArray  # (K,) body of each
    table: Array  # (k,) distances of solids without a closed form, one lattice after the other [m]
    first: IntArray  # (K,) where a solid's lattice begins in `table`
    shape: IntArray  # (K, 2) points of its lattice
    corner: Array  # (K, 2) place of its first point [m]
    pitch: float  # spacing of all lattices [m]
    height: float  # of the robot's centre [m]
    radius: float  # of the robot [m]


def bodies_of(scene: Scene, cutoff: float) -> Bodies:
    """Gather the solids of a scene, distances from which are right up to a cutoff [m] and greater than it beyond."""
    return gathered([scene.obstacles, *(mover.solids for mover in scene.movers)], scene.footprint, cutoff)


def gathered(groups: Sequence[Sequence[Obstacle]], footprint: Footprint, cutoff: float) -> Bodies:
    """Gather any solids by bodies; those of body 0, which is static, come first."""
    every = [solid for group in groups for solid in group]
    solids = Solids.of(every)
    K, tables, fine = len(every), np.flatnonzero(solids.form < 0), TUNING.table_pitch * footprint.radius
    margin = cutoff + footprint.radius + 2.0 * fine
    area = float(np.prod(solids.high[tables] - solids.low[tables] + 2.0 * margin, axis=1).sum())
    pitch = max(fine, math.sqrt(area / TUNING.table_points))
    first, shape, corner = np.zeros(K, dtype=np.int64), np.zeros((K, 2), dtype=np.int64), np.zeros((K, 2))
    parts: list[Array] = [np.zeros(0)]
    plane = np.full(2, 1e3)  # beyond any solid [m]
    for k in tables:
        corner[k] = solids.low[k] - cutoff - footprint.radius - pitch
        shape[k] = np.ceil((solids.high[k] + cutoff + footprint.radius - corner[k]) / pitch).astype(int) + 2
        first[k] = sum(map(len, parts))
        alone = Collision(Workspace(-plane, plane, (every[k],)), footprint)
        index = np.stack(np.meshgrid(*map(np.arange, shape[k]), indexing="ij"), axis=-1).reshape(-1, 2)
        distance = alone.distance(corner[k] + pitch * index)
        parts.append(distance if pitch == fine else np.maximum(distance - _excess(distance, pitch), 0.0))
    return Bodies(
        solids=solids,
        owner=np.repeat(np.arange(len(groups)), [len(group) for group in groups]),
        table=np.concatenate(parts),
        first=first,
        shape=shape,
        corner=corner,
        pitch=pitch,
        height=float(footprint.height),
        radius=float(footprint.radius),
    )


def _excess(distance: Array, pitch: float) -> Array:
    """Bound how much too high bilinear interpolation next to a point may be, from the distance there [m].

    A distance changes by no more than the way to the corners of a cell, and its second derivative is at most 1 over it.
    """
    nearest = np.maximum(distance - math.sqrt(2.0) * pitch, 1e-9 * pitch)
    excess: Array = np.minimum(pitch / math.sqrt(2.0), pitch**2 / (8.0 * nearest))
    return excess


def poses_at(movers: tuple[Mover, ...], times: Array) -> Array:
    """Return x, y [m] and yaw [rad] of all bodies at times (k,) [s], (k, 1 + J, 3); body 0 stays where it is."""
    still = np.zeros((len(times), 1, 3))
    return np.concatenate([still, *(mover.motion.pose(times)[:, None, :] for mover in movers)], axis=1)


def frames_of(poses: Array) -> Array:
    """Return poses (..., 3) as x, y [m], cosine and sine of the yaw, (..., 4)."""
    return np.concatenate([poses[..., :2], np.cos(poses[..., 2:]), np.sin(poses[..., 2:])], axis=-1)


@inlined
def clearance_from(bodies, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Return the clearance of the robot's centre at (x, y) [m] from solid k [m], minus the robot's radius deep inside.

    Args:
        bodies: of `Bodies`.
        k: index of the solid.
        pose: of all bodies, (1 + J, 4), as `frames_of` has it.
        x, y: position [m].
    """
    u, v = _in_body(pose, bodies.owner[k], x, y)
    return clearance_of(bodies, k, u, v)


@inlined
def clearance_of(bodies, k, u, v):  # type: ignore[no-untyped-def]
    """Return the clearance of a place (u, v) [m] in the frame of the solid's body from solid k [m]."""
    if bodies.solids.form[k] >= 0:
        return distance_from(bodies.solids, k, u, v, bodies.height) - bodies.radius
    return _in_table(bodies, k, u, v)[0] - bodies.radius


@kernel
def clearance_and_slope(bodies, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Return the clearance from solid k [m], the vector (x, y) from its nearest point [m], and the distance's gradient.

    The vector is as seen from above, and zero inside.
    """
    owner = bodies.owner[k]
    u, v = _in_body(pose, owner, x, y)
    d, ex, ey, gx, gy = clearance_and_slope_of(bodies, k, u, v)
    c, s = pose[owner, 2], pose[owner, 3]
    return d, c * ex - s * ey, s * ex + c * ey, c * gx - s * gy, s * gx + c * gy


@kernel
def clearance_and_slope_of(bodies, k, u, v):  # type: ignore[no-untyped-def]
    """Return clearance, vector and gradient of a place (u, v) [m] in the frame of solid k's body, in that frame."""
    if bodies.solids.form[k] >= 0:
        d = distance_from(bodies.solids, k, u, v, bodies.height)
        if d <= 0.0:
            return -bodies.radius, 0.0, 0.0, 0.0, 0.0
        ex, ey = offset_from(bodies.solids, k, u, v, bodies.height)
        gx, gy = ex / d, ey / d
    else:
        d, gx, gy = _in_table(bodies, k, u, v)
        ex, ey = d * gx, d * gy
    return d - bodies.radius, ex, ey, gx, gy


@inlined
def _in_body(pose, owner, x, y):  # type: ignore[no-untyped-def]
    """Return a point (x, y) in a body's own frame [m]."""
    if owner == 0:
        return x, y
    dx, dy = x - pose[owner, 0], y - pose[owner, 1]
    c, s = pose[owner, 2], pose[owner, 3]
    return c * dx + s * dy, c * dy - s * dx


@kernel
def _in_table(bodies, k, u, v):  # type: ignore[no-untyped-def]
    """Return the distance [m] and its gradient at (u, v) [m] in solid k's frame; off the lattice that of its margin."""
    nx, ny = bodies.shape[k, 0], bodies.shape[k, 1]
    fx, fy = (u - bodies.corner[k, 0]) / bodies.pitch, (v - bodies.corner[k, 1]) / bodies.pitch
    gx, gy = min(max(fx, 0.0), nx - 1.0), min(max(fy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    p, q = gx - i, gy - j
    at = bodies.first[k] + i * ny + j
    a, b, c, d = bodies.table[at], bodies.table[at + 1], bodies.table[at + ny], bodies.table[at + ny + 1]
    low, high = a * (1.0 - q) + b * q, c * (1.0 - q) + d * q
    away = math.sqrt((fx - gx) ** 2 + (fy - gy) ** 2) * bodies.pitch
    slope_x, slope_y = (high - low) / bodies.pitch, ((b - a) * (1.0 - p) + (d - c) * p) / bodies.pitch
    return low * (1.0 - p) + high * p + away, slope_x, slope_y
