"""Pose all solids of a scene together: those of the static world are one body, and each moving obstacle is one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.obstacle import Motion, Mover
from pirrht.geometry.scene import Scene
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import clearance_of_solid, offset_of_solid
from pirrht.moving.obstacles import MovingObstacleArrays


class Bodies(NamedTuple):
    """K solids: those of the static world, which is body 0, then those of J movers, bodies 1 to J."""

    solids: MovingObstacleArrays  # each in its own body's frame
    owner: IntArray  # (K,) body of each
    radius: float  # of the robot [m]


def bodies_of(scene: Scene, cutoff: float) -> Bodies:
    """Gather the solids of a scene, distances from which are right up to a cutoff [m] and greater than it beyond."""
    static = Mover(name="static", solids=tuple(scene.obstacles), motion=Motion(rows=np.zeros((1, 4))))
    every = static, *scene.movers
    owner = np.repeat(np.arange(len(every)), [len(body.solids) for body in every])
    return Bodies(MovingObstacleArrays.around(scene.footprint, every, cutoff), owner, float(scene.footprint.radius))


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

    `pose` is that of all bodies, (1 + J, 4), as `frames_of` has it.
    """
    u, v = _in_body(pose, bodies.owner[k], x, y)
    return clearance_of_solid(bodies.solids, k, u, v)


@kernel
def clearance_and_slope(bodies, k, pose, x, y):  # type: ignore[no-untyped-def]
    """Return the clearance from solid k [m], the vector (x, y) from its nearest point [m], and the distance's gradient.

    The vector is as seen from above, and zero inside.
    """
    owner = bodies.owner[k]
    u, v = _in_body(pose, owner, x, y)
    ex, ey, gx, gy = offset_of_solid(bodies.solids, k, u, v)
    c, s = pose[owner, 2], pose[owner, 3]
    return (
        clearance_of_solid(bodies.solids, k, u, v),
        c * ex - s * ey,
        s * ex + c * ey,
        c * gx - s * gy,
        s * gx + c * gy,
    )


@inlined
def _in_body(pose, owner, x, y):  # type: ignore[no-untyped-def]
    """Return a point (x, y) in a body's own frame [m]."""
    if owner == 0:
        return x, y
    dx, dy = x - pose[owner, 0], y - pose[owner, 1]
    c, s = pose[owner, 2], pose[owner, 3]
    return c * dx + s * dy, c * dy - s * dx
