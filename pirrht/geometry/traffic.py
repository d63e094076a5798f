"""Bodies that move, as compiled kernels ask about them: where each is at a time, and how far the robot is from it.

All is asked on one clock, on which 0 is now. Between two rows of its motion a body keeps its velocity: such a piece of
a motion is known by the pose at a time, the rates at which it changes, and until when it does so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.bodies import gathered
from pirrht.geometry.crowd import jumps, reach_of, speed_bound
from pirrht.geometry.motion import Mover
from pirrht.geometry.scene import Scene
from pirrht.geometry.shapes import offset_of, outside
from pirrht.geometry.spans import BOX, boxes_of
from pirrht.jit.addresses import load_float64, load_int64
from pirrht.jit.jit import inlined

REACH = 8.0  # no clearance above so many robot radii is told ...
LEAST = 1.0  # ... and one of so many meters, if that is more [m]
BODY = 5  # numbers of a body: how much later than now its rows' clock is [s], when it starts over [s] (0: never),
# whether elsewhere than it ends, radius of the disc outside of which the robot is free [m], greatest speed [m/s]
LEAD, PERIOD, JUMPING, RADIUS, FASTEST = range(BODY)
MOTIONS = 4  # of the arrays change with the motions: of bodies, parts, rows and boxes, the first
PARTS = 6  # of a body: where its rows begin and end, its solids, and its boxes
ROW = 7  # numbers of a row: t [s], x, y [m], yaw [rad], and the rates of these until the next [1/s]
SOLID = 15  # numbers of a solid: MuJoCo's sizes, place in the body's frame, and axes there as columns, row by row
TABLE = 4  # of a solid: form or -1, where its lattice begins in the table, and how many points that has along x and y


class MovingObstacleArrays(NamedTuple):
    """J bodies that move, as numbers and addresses that kernels can take cheaply."""

    J: int  # number of bodies
    body: int  # address of float64 (J, BODY)
    parts: int  # address of int64 (J, PARTS)
    rows: int  # address of float64 (k, ROW), of all bodies
    boxes: int  # address of float64 (l, BOX), of all bodies: where each is within spans of time (`spans`)
    solid: int  # address of float64 (K, SOLID)
    form: int  # address of int64 (K, TABLE)
    corner: int  # address of float64 (K, 2): where the lattice of a solid without a closed form begins [m]
    table: int  # address of float64: distances on these lattices, one after the other [m]
    pitch: float  # spacing of all lattices [m]
    height: float  # of the robot's centre [m]
    robot: float  # radius [m]
    speed: float  # the greatest of any point of any body, jumps aside [m/s]
    reach: float  # clearances are told up to this [m]


class Traffic(MovingObstacleArrays):
    """The same together with the arrays that the addresses point to."""

    arrays: Sequence[Array | IntArray]
    radius: Array  # (J,) of the disc around a body's origin outside of which the robot's centre is free [m]
    fastest: Array  # (J,) speed of any point of a body at most, jumps aside [m/s]

    @classmethod
    def of(cls, scene: Scene) -> Traffic:
        """What moves in a scene; J may be 0."""
        movers, footprint = scene.movers, scene.footprint
        reach = max(REACH * footprint.radius, LEAST)
        bodies = gathered([(), *(mover.solids for mover in movers)], footprint, reach)
        solids = bodies.solids
        shapes = np.hstack([solids.size, solids.position, solids.rotation.reshape(-1, 9)])
        form = np.column_stack([solids.form, bodies.first, bodies.shape])
        motions = _motions(movers, footprint.radius)
        arrays = *motions, shapes, form, bodies.corner, bodies.table
        return cls._holding(arrays, (bodies.pitch, bodies.height, bodies.radius, _fastest(motions[0]), reach))

    def moving(self, movers: Sequence[Mover]) -> Traffic:
        """The same bodies on other motions."""
        motions, shapes = _motions(movers, self.robot), self.arrays[MOTIONS:]
        numbers = self.pitch, self.height, self.robot, _fastest(motions[0]), self.reach
        return self._holding((*motions, *shapes), numbers)

    @classmethod
    def _holding(cls, arrays: Sequence[Array | IntArray], numbers: Sequence[float]) -> Traffic:
        arrays = tuple(map(np.ascontiguousarray, arrays))
        body = np.asarray(arrays[0], dtype=float)
        traffic = cls(len(body), *(array.ctypes.data for array in arrays), *numbers)
        traffic.arrays, traffic.radius, traffic.fastest = arrays, body[:, RADIUS], body[:, FASTEST]
        return traffic

    def after(self, time: float) -> Traffic:
        """The same on a clock that starts at a time [s] of this one's."""
        later = self.arrays[0].copy()
        later[:, LEAD] += time
        return self._holding((later, *self.arrays[1:]), (self.pitch, self.height, self.robot, self.speed, self.reach))


def _motions(movers: Sequence[Mover], radius: float) -> tuple[Array, IntArray, Array, Array]:
    """The first MOTIONS of the arrays, of bodies about a robot of a radius [m]."""
    body, parts, rows = np.zeros((len(movers), BODY)), np.zeros((len(movers), PARTS), dtype=np.int64), []
    boxes = [boxes_of(mover.motion.rows, repeat=mover.motion.repeat) for mover in movers]
    row = solid = box = 0
    for j, mover in enumerate(movers):
        motion, far = mover.motion, reach_of(mover)
        body[j] = (
            motion.lead, motion.rows[-1, 0] if motion.repeat else 0.0, jumps(motion), far + radius,
            speed_bound(motion, far),
        )  # fmt: skip
        many = len(motion.rows), len(mover.solids), len(boxes[j])
        parts[j] = row, row + many[0], solid, solid + many[1], box, box + many[2]
        row, solid, box = row + many[0], solid + many[1], box + many[2]
        rows.append(_with_rates(motion.rows))
    return body, parts, np.vstack([np.zeros((0, ROW)), *rows]), np.vstack([np.zeros((0, BOX)), *boxes])


def _fastest(body: Array) -> float:
    """The greatest speed of any point of bodies (J, BODY) [m/s]."""
    return float(body[:, FASTEST].max(initial=0.0))


def _with_rates(rows: Array) -> Array:
    """Rows (k, 4) of a motion with the rates at which it leaves each, (k, ROW); it stays at the last."""
    out, steps = np.zeros((len(rows), ROW)), rows[1:] - rows[:-1]
    out[:, :4] = rows
    out[:-1, 4:] = steps[:, 1:] * (1.0 / steps[:, :1])
    return out


@inlined
def of_body(traffic, j, what):  # type: ignore[no-untyped-def]
    """One of the numbers of body j."""
    return load_float64(traffic.body, BODY * j + what)


@inlined
def disc_of(traffic, j):  # type: ignore[no-untyped-def]
    """Radius of the disc around the origin of body j outside of which the robot's centre is free [m]."""
    return load_float64(traffic.body, BODY * j + RADIUS)


@inlined
def piece_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """Where body j is at t [s], x, y [m] and yaw [rad], at which rates that changes [1/s], and until when so [s].

    At a time at which it changes they are those from then on.
    """
    begin, end = load_int64(traffic.parts, PARTS * j), load_int64(traffic.parts, PARTS * j + 1)
    now, period = t + load_float64(traffic.body, BODY * j + LEAD), load_float64(traffic.body, BODY * j + PERIOD)
    if period > 0.0 and now > 0.0:
        now -= math.floor(now / period) * period
    low, high = begin, end  # the row that begins the piece is from low on and before high
    while high - low > 1:
        middle = (low + high) // 2
        if load_float64(traffic.rows, ROW * middle) <= now:
            low = middle
        else:
            high = middle
    at = traffic.rows + 8 * ROW * low
    past, x, y, yaw = now - load_float64(at, 0), load_float64(at, 1), load_float64(at, 2), load_float64(at, 3)
    if past < 0.0:
        return x, y, yaw, 0.0, 0.0, 0.0, t - past
    if high == end:
        return x, y, yaw, 0.0, 0.0, 0.0, math.inf
    vx, vy, turn, until = load_float64(at, 4), load_float64(at, 5), load_float64(at, 6), t + load_float64(at, ROW) - now
    return x + past * vx, y + past * vy, yaw + past * turn, vx, vy, turn, until


@inlined
def restart_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """When body j is suddenly elsewhere, next after t [s]; infinity if it never is."""
    if of_body(traffic, j, JUMPING) == 0.0:
        return math.inf
    lead, period = of_body(traffic, j, LEAD), of_body(traffic, j, PERIOD)
    return max(math.floor((t + lead) / period) + 1.0, 1.0) * period - lead


@inlined
def pose_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """Where body j is at t [s]: x, y [m] and yaw [rad]."""
    x, y, yaw, _, _, _, _ = piece_of(traffic, j, t)
    return x, y, yaw


@inlined
def outside_of(traffic, j, ox, oy, x, y):  # type: ignore[no-untyped-def]
    """A lower bound of the clearance of (x, y) [m] from body j at (ox, oy) [m], whichever way that is turned [m]."""
    return math.sqrt((x - ox) * (x - ox) + (y - oy) * (y - oy)) - disc_of(traffic, j)


@inlined
def _in_solid(traffic, k, u, v):  # type: ignore[no-untyped-def]
    """A place (u, v) [m] in the frame of a body, at the height of the robot, as its solid k has it [m]."""
    at = traffic.solid + 8 * SOLID * k
    dx, dy, dz = u - load_float64(at, 3), v - load_float64(at, 4), traffic.height - load_float64(at, 5)
    return (
        load_float64(at, 6) * dx + load_float64(at, 9) * dy + load_float64(at, 12) * dz,
        load_float64(at, 7) * dx + load_float64(at, 10) * dy + load_float64(at, 13) * dz,
        load_float64(at, 8) * dx + load_float64(at, 11) * dy + load_float64(at, 14) * dz,
    )


@inlined
def _clearance_of(traffic, k, u, v):  # type: ignore[no-untyped-def]
    """Clearance of the robot at (u, v) [m] in the frame of a body from its solid k [m], minus its radius inside."""
    form = load_int64(traffic.form, TABLE * k)
    if form < 0:
        return _in_table(traffic, k, u, v)[0] - traffic.robot
    at = traffic.solid + 8 * SOLID * k
    x, y, z = _in_solid(traffic, k, u, v)
    far = outside(form, load_float64(at, 0), load_float64(at, 1), load_float64(at, 2), x, y, z)
    return max(far, 0.0) - traffic.robot


@inlined
def _in_table(traffic, k, u, v):  # type: ignore[no-untyped-def]
    """Distance [m] and its gradient at (u, v) [m] in the frame of solid k; beside the lattice that of its margin."""
    first, nx = load_int64(traffic.form, TABLE * k + 1), load_int64(traffic.form, TABLE * k + 2)
    ny, pitch = load_int64(traffic.form, TABLE * k + 3), traffic.pitch
    fx, fy = (u - load_float64(traffic.corner, 2 * k)) / pitch, (v - load_float64(traffic.corner, 2 * k + 1)) / pitch
    gx, gy = min(max(fx, 0.0), nx - 1.0), min(max(fy, 0.0), ny - 1.0)
    i, j = min(int(gx), nx - 2), min(int(gy), ny - 2)
    p, q = gx - i, gy - j
    at = first + i * ny + j
    a, b = load_float64(traffic.table, at), load_float64(traffic.table, at + 1)
    c, d = load_float64(traffic.table, at + ny), load_float64(traffic.table, at + ny + 1)
    low, high = a * (1.0 - q) + b * q, c * (1.0 - q) + d * q
    away = math.sqrt((fx - gx) ** 2 + (fy - gy) ** 2) * pitch
    slope_x, slope_y = (high - low) / pitch, ((b - a) * (1.0 - p) + (d - c) * p) / pitch
    return low * (1.0 - p) + high * p + away, slope_x, slope_y


@inlined
def _slope_of(traffic, k, u, v):  # type: ignore[no-untyped-def]
    """The vector (x, y) to (u, v) [m] from the nearest point of solid k seen from above [m], in the frame of its body.

    And the gradient (x, y) of the distance; all are zero inside.
    """
    form, at = load_int64(traffic.form, TABLE * k), traffic.solid + 8 * SOLID * k
    if form < 0:
        d, gx, gy = _in_table(traffic, k, u, v)
        return d * gx, d * gy, gx, gy
    a, b, c = load_float64(at, 0), load_float64(at, 1), load_float64(at, 2)
    x, y, z = _in_solid(traffic, k, u, v)
    d = max(outside(form, a, b, c, x, y, z), 0.0)
    if d <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    x, y, z = offset_of(form, a, b, c, x, y, z)
    ex = load_float64(at, 6) * x + load_float64(at, 7) * y + load_float64(at, 8) * z
    ey = load_float64(at, 9) * x + load_float64(at, 10) * y + load_float64(at, 11) * z
    return ex, ey, ex / d, ey / d


@inlined
def inexact(traffic, j):  # type: ignore[no-untyped-def]
    """Whether distances from a solid of body j are those of a table."""
    found = False
    for k in range(load_int64(traffic.parts, PARTS * j + 2), load_int64(traffic.parts, PARTS * j + 3)):
        found |= load_int64(traffic.form, TABLE * k) < 0
    return found


@inlined
def clearance_of_body(traffic, j, ox, oy, yaw, x, y):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from body j at (ox, oy) [m] and yaw [rad], up to the reach [m]."""
    return clearance_facing(traffic, j, ox, oy, math.cos(yaw), math.sin(yaw), x, y)


@inlined
def clearance_facing(traffic, j, ox, oy, c, s, x, y):  # type: ignore[no-untyped-def]
    """The same from cosine and sine of the yaw."""
    dx, dy = x - ox, y - oy
    u, v, best = c * dx + s * dy, c * dy - s * dx, traffic.reach
    for k in range(load_int64(traffic.parts, PARTS * j + 2), load_int64(traffic.parts, PARTS * j + 3)):
        best = min(best, _clearance_of(traffic, k, u, v))
    return best


@inlined
def wall_of_body(traffic, j, ox, oy, yaw, x, y):  # type: ignore[no-untyped-def]
    """Clearance, the unit vector (x, y) away from the nearest point of body j, and the vector (x, y) from there [m].

    Both vectors are zero inside of the body, and where nothing is within reach.
    """
    return wall_facing(traffic, j, ox, oy, math.cos(yaw), math.sin(yaw), x, y)


@inlined
def wall_facing(traffic, j, ox, oy, c, s, x, y):  # type: ignore[no-untyped-def]
    """The same from cosine and sine of the yaw."""
    dx, dy = x - ox, y - oy
    u, v, best, which = c * dx + s * dy, c * dy - s * dx, traffic.reach, -1
    for k in range(load_int64(traffic.parts, PARTS * j + 2), load_int64(traffic.parts, PARTS * j + 3)):
        d = _clearance_of(traffic, k, u, v)
        if d < best:
            best, which = d, k
    if which < 0:
        return best, 0.0, 0.0, 0.0, 0.0
    ex, ey, gx, gy = _slope_of(traffic, which, u, v)
    size = math.sqrt(gx * gx + gy * gy)
    if size > 0.0:
        gx, gy = gx / size, gy / size
    return best, c * gx - s * gy, s * gx + c * gy, c * ex - s * ey, s * ex + c * ey


@inlined
def traffic_clearance(traffic, x, y, t):  # type: ignore[no-untyped-def]
    """Clearance of the robot's centre at (x, y) [m] from all bodies at t [s], up to the reach [m]."""
    best = traffic.reach
    for j in range(traffic.J):
        ox, oy, yaw = pose_of(traffic, j, t)
        if outside_of(traffic, j, ox, oy, x, y) < best:
            best = min(best, clearance_of_body(traffic, j, ox, oy, yaw, x, y))
    return best
