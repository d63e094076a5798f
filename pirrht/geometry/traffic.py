"""Bodies that move, as compiled kernels ask about them: where each is at a time, and how far the robot is from it.

All is asked on one clock, on which 0 is now. Between two rows of its motion a body keeps its velocity: such a piece of
a motion is known by the pose at a time, the rates at which it changes, and until when it does so.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.bodies import Bodies, clearance_and_slope_of, clearance_of, gathered
from pirrht.geometry.crowd import jumps, reach_of, speed_bound
from pirrht.geometry.scene import Scene

REACH = 8.0  # no clearance above so many robot radii is told ...
LEAST = 1.0  # ... and one of so many meters, if that is more [m]
WALL = 5  # numbers of a wall that moves


class Traffic(NamedTuple):
    """J bodies that move: their solids, the rows of their motions, and what bounds both."""

    bodies: Bodies  # the solids of body j are those of owner 1 + j
    solid: IntArray  # (J + 1,) where the solids of each body begin
    row: IntArray  # (J + 1,) where the rows of each body begin
    rows: Array  # (k, 4) t [s], x, y [m], yaw [rad] of all bodies
    lead: Array  # (J,) how much later than now the rows' clock is [s]
    period: Array  # (J,) after which a motion starts over [s]; 0 where it does not
    jumping: NDArray[np.bool_]  # (J,) whether it does so elsewhere than it ends
    radius: Array  # (J,) of the disc around a body's origin outside of which the robot's centre is free [m]
    fastest: Array  # (J,) speed of any point of a body at most, jumps aside [m/s]
    speed: float  # the greatest of these [m/s]
    reach: float  # clearances are told up to this [m]

    @classmethod
    def of(cls, scene: Scene) -> Traffic:
        """What moves in a scene; J may be 0."""
        movers, footprint = scene.movers, scene.footprint
        reach = max(REACH * footprint.radius, LEAST)
        motions = [mover.motion for mover in movers]
        reaches = [reach_of(mover) for mover in movers]
        fastest = np.array([speed_bound(m, r) for m, r in zip(motions, reaches, strict=True)], dtype=float)
        return cls(
            bodies=gathered([(), *(mover.solids for mover in movers)], footprint, reach),
            solid=np.cumsum([0, *(len(mover.solids) for mover in movers)]),
            row=np.cumsum([0, *(len(motion.rows) for motion in motions)]),
            rows=np.ascontiguousarray(np.vstack([np.zeros((0, 4)), *(motion.rows for motion in motions)])),
            lead=np.array([motion.lead for motion in motions], dtype=float),
            period=np.array([motion.rows[-1, 0] if motion.repeat else 0.0 for motion in motions], dtype=float),
            jumping=np.array([jumps(motion) for motion in motions], dtype=np.bool_),
            radius=np.array(reaches, dtype=float) + footprint.radius,
            fastest=fastest,
            speed=float(fastest.max(initial=0.0)),
            reach=reach,
        )

    @property
    def J(self) -> int:
        """Number of bodies."""
        return len(self.lead)

    def after(self, time: float) -> Traffic:
        """The same on a clock that starts at a time [s] of this one's."""
        return self._replace(lead=self.lead + time)


@inlined
def piece_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """Where body j is at t [s], x, y [m] and yaw [rad], at which rates that changes [1/s], and until when so [s].

    At a time at which it changes they are those from then on.
    """
    begin, end, now = traffic.row[j], traffic.row[j + 1], t + traffic.lead[j]
    period = traffic.period[j]
    if period > 0.0 and now > 0.0:
        now -= math.floor(now / period) * period
    rows = traffic.rows
    if now < rows[begin, 0]:
        return rows[begin, 1], rows[begin, 2], rows[begin, 3], 0.0, 0.0, 0.0, t + rows[begin, 0] - now
    low, high = begin, end  # the row that begins the piece is from low on and before high
    while high - low > 1:
        middle = (low + high) // 2
        if rows[middle, 0] <= now:
            low = middle
        else:
            high = middle
    if high == end:
        return rows[low, 1], rows[low, 2], rows[low, 3], 0.0, 0.0, 0.0, math.inf
    per, past = 1.0 / (rows[high, 0] - rows[low, 0]), now - rows[low, 0]
    vx, vy, turn = (
        (rows[high, 1] - rows[low, 1]) * per,
        (rows[high, 2] - rows[low, 2]) * per,
        (rows[high, 3] - rows[low, 3]) * per,
    )
    until = t + rows[high, 0] - now
    return rows[low, 1] + past * vx, rows[low, 2] + past * vy, rows[low, 3] + past * turn, vx, vy, turn, until


@kernel
def pose_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """Where body j is at t [s]: x, y [m] and yaw [rad]."""
    x, y, yaw, _, _, _, _ = piece_of(traffic, j, t)
    return x, y, yaw


@inlined
def outside_of(traffic, j, ox, oy, x, y):  # type: ignore[no-untyped-def]
    """A lower bound of the clearance of (x, y) [m] from body j at (ox, oy) [m], whichever way that is turned [m]."""
    return math.sqrt((x - ox) * (x - ox) + (y - oy) * (y - oy)) - traffic.radius[j]


@kernel
def clearance_of_body(traffic, j, ox, oy, yaw, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from body j at (ox, oy) [m] and yaw [rad], up to the reach [m]."""
    c, s, dx, dy = math.cos(yaw), math.sin(yaw), x - ox, y - oy
    u, v, best = c * dx + s * dy, c * dy - s * dx, traffic.reach
    for k in range(traffic.solid[j], traffic.solid[j + 1]):
        best = min(best, clearance_of(traffic.bodies, k, u, v))
    return best


@kernel
def wall_of_body(traffic, j, ox, oy, yaw, x, y):  # type: ignore[no-untyped-def]
    """The same, the unit vector (x, y) away from the nearest point of it, and the vector (x, y) from there [m].

    Both vectors are zero inside of the body, and where nothing is within reach.
    """
    c, s, dx, dy = math.cos(yaw), math.sin(yaw), x - ox, y - oy
    u, v, best, which = c * dx + s * dy, c * dy - s * dx, traffic.reach, -1
    for k in range(traffic.solid[j], traffic.solid[j + 1]):
        d = clearance_of(traffic.bodies, k, u, v)
        if d < best:
            best, which = d, k
    if which < 0:
        return best, 0.0, 0.0, 0.0, 0.0
    _, ex, ey, gx, gy = clearance_and_slope_of(traffic.bodies, which, u, v)
    size = math.sqrt(gx * gx + gy * gy)
    if size > 0.0:
        gx, gy = gx / size, gy / size
    return best, c * gx - s * gy, s * gx + c * gy, c * ex - s * ey, s * ex + c * ey


@kernel
def traffic_clearance(traffic, x, y, t):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all bodies at t [s], up to the reach [m]."""
    best = traffic.reach
    for j in range(traffic.lead.shape[0]):
        ox, oy, yaw = pose_of(traffic, j, t)
        if outside_of(traffic, j, ox, oy, x, y) < best:
            best = min(best, clearance_of_body(traffic, j, ox, oy, yaw, x, y))
    return best


@kernel
def moving_walls(traffic, x, y, t, within, out):  # type: ignore[no-untyped-def]
    """Write the bodies less than so far from (x, y) [m] at t [s] to rows of `out` (J, WALL); returns how many.

    A row is the clearance [m], the unit vector (x, y) away from the nearest point, and the velocity (x, y) that the
    body has there [m/s]; at a time at which that changes, that from then on.
    """
    count = 0
    for j in range(traffic.lead.shape[0]):
        ox, oy, yaw, vx, vy, turn, _ = piece_of(traffic, j, t)
        if outside_of(traffic, j, ox, oy, x, y) < within:
            d, nx, ny, ex, ey = wall_of_body(traffic, j, ox, oy, yaw, x, y)
            if d < within:
                out[count, 0], out[count, 1], out[count, 2] = d, nx, ny
                out[count, 3], out[count, 4] = vx - turn * (y - ey - oy), vy + turn * (x - ex - ox)
                count += 1
    return count
