"""A second member of the interface of footprints: a disc whose centre lies ahead of the robot's position."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pirrht import FreeSpace
from pirrht.arrays import Array
from pirrht.geometry.certify import certificates
from pirrht.geometry.disc import DISC, Disc
from pirrht.geometry.field import border
from pirrht.geometry.space import BLOCKED, FREE, UNSURE, SpaceKernels
from pirrht.geometry.world import World
from pirrht.jit.jit import inlined, kernel

WORLD: Any = World
of_place, walls_of_place, near_place = DISC.clearance, DISC.walls, DISC.near
sweep_place, bridge_place, end_of_place = DISC.sweep, DISC.bridge, DISC.end
rim_of_place, exit_of_place, certify_of_place = DISC.rim, DISC.exit, DISC.certify


class OffsetDisc(NamedTuple):
    """Numbers of the member."""

    field: Disc  # of the disc's centre
    reach: float  # by which that lies ahead [m]
    spacing: float

    @property
    def kernels(self) -> SpaceKernels:
        return KERNELS


@inlined
def middle(static, pose):
    return pose[0] + static.reach * math.cos(pose[2]), pose[1] + static.reach * math.sin(pose[2])


@inlined
def turned(static, pose, nx, ny):
    """The part of a gradient for the heading [m/rad]."""
    return static.reach * (math.cos(pose[2]) * ny - math.sin(pose[2]) * nx)


@inlined
def seen(world, pose):
    """The world as the disc's centre sees it: the goal shifted by as much as that is off the position."""
    static, (x, y) = world.static, middle(world.static, pose)
    goal = (world.goal[0] + x - pose[0], world.goal[1] + y - pose[1])
    return WORLD(static.field, goal, world.radius, world.moving)


@inlined
def clearance(static, pose):
    return of_place(static.field, middle(static, pose))


@inlined
def place(static, place):
    return of_place(static.field, place) - static.reach


@inlined
def walls(static, pose):
    c, (nx, ny), d, (mx, my) = walls_of_place(static.field, middle(static, pose))
    n = (nx, ny, np.float32(turned(static, pose, nx, ny)))
    return c, n, d, (mx, my, np.float32(turned(static, pose, mx, my)))


@kernel
def near(static, pose, within, out):
    count = near_place(static.field, middle(static, pose), within, out)
    for k in range(count):
        out[k, 3] = turned(static, pose, out[k, 1], out[k, 2])
    return count


@inlined
def distances(world, pose):
    x, y = middle(world.static, pose)
    to_goal = math.hypot(pose[0] - world.goal[0], pose[1] - world.goal[1]) - world.radius
    return clearance(world.static, pose), border(world.static.field, x, y), to_goal


@inlined
def facing(static, pose, known, cov):
    return max(clearance(static, pose), 0.0)


@inlined
def spread(static, cov, line):
    return cov[0] + cov[3] + static.reach**2 * cov[5]


@inlined
def extent(static, change):
    return math.hypot(change[0], change[1]) + static.reach * abs(change[2])


@kernel
def sweep(world, pose, moved, turn, clear):
    return sweep_place(seen(world, pose), middle(world.static, pose), middle(world.static, moved), turn, 0.0)


@kernel
def bridge(world, pose, moved, before, after, cov, weighed, state, line=False):
    ax, ay = -world.static.reach * math.sin(pose[2]), world.static.reach * math.cos(pose[2])
    xx, xy, xt, yy, yt, tt = cov
    own = (xx + 2 * ax * xt + ax * ax * tt, xy + ay * xt + ax * yt + ax * ay * tt, yy + 2 * ay * yt + ay * ay * tt)
    ends = middle(world.static, pose), middle(world.static, moved)
    return bridge_place(seen(world, pose), ends[0], ends[1], before, after, own, weighed, state, False)


@inlined
def end(world, pose):
    return end_of_place(seen(world, pose), middle(world.static, pose))


@inlined
def towards_exit(world, pose, outcome):
    return exit_of_place(seen(world, pose), middle(world.static, pose), outcome)


@inlined
def rim(world, pose, cov):
    return rim_of_place(world, (pose[0], pose[1]), (cov[0], cov[1], cov[3]))


@inlined
def refused(static, pose):
    return certify_of_place(static.field, middle(static, pose))


@inlined
def certify_place(static, place):
    away = of_place(static.field, place)
    return FREE if away > static.reach else (BLOCKED if away < -static.reach - static.spacing else UNSURE)


certify, piece, curve = certificates(clearance, refused, True)
KERNELS = SpaceKernels(
    position=2, turns=True, isotropic=False, near_most=DISC.near_most, clearance=clearance, place=place, walls=walls,
    near=near, distances=distances, facing=facing, spread=spread, extent=extent, sweep=sweep, bridge=bridge, end=end,
    exit=towards_exit, rim=rim, certify=certify, certify_place=certify_place, certify_piece=piece, certify_curve=curve,
)  # fmt: skip


class Exact:
    """FCL's verdicts on the disc at poses (k, 3), and at places (k, 2) as if it lay there."""

    def __init__(self, collision: Any, reach: float) -> None:
        self.collision, self.reach = collision, reach

    def __getattr__(self, name: str) -> Any:
        return getattr(self.collision, name)

    def middles(self, poses: Array) -> Array:
        if poses.shape[-1] == 2:
            return poses
        turned = np.stack([np.cos(poses[..., 2]), np.sin(poses[..., 2])], axis=-1)
        return np.ascontiguousarray(poses[..., :2] + self.reach * turned)

    def clearance(self, poses: Array) -> Array:
        return self.collision.clearance(self.middles(poses))

    def free(self, poses: Array) -> Array:
        return self.collision.free(self.middles(poses))

    def segments_free(self, tails: Array, heads: Array, more: float = 0.0) -> Array:
        along = np.arctan2(*(heads - tails).T[::-1])
        shift = self.reach * np.stack([np.cos(along), np.sin(along)], axis=-1)
        return self.collision.segments_free(tails + shift, heads + shift, more)

    def bisect_free(self, pose: Any, length: float, curvature: float = 0.0) -> bool:
        rate = 1.0 + self.reach * abs(curvature)
        return self.collision.bisect_free(lambda s: self.middles(pose(s / rate)), rate * length)


def offset(space: FreeSpace, reach: float) -> FreeSpace:
    """The free space of the disc of a scene, `reach` [m] ahead of the robot's position."""
    disc = OffsetDisc(Disc.over(space.field), reach, space.field.spacing)
    return replace(space, static=disc, collision=Exact(space.collision, reach))
