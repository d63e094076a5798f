"""Move a mass with an acceleration linear in time: the cubic paths of the double integrator's optimum.

p(s) = p0 + v0 s + c0 s^2 / 2 + c1 s^3 / 6. The acceleration is linear in time, so its magnitude is greatest at an end,
and in a time tau a path gets no farther than |v| tau + |a|max tau^2 / 2. That bound is what certificates march by.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import BLOCKED, FREE, LEAST_STEP, UNSURE, refused
from pirrht.geometry.field import clearance
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import Motion, MotionKernels, Trajectory
from pirrht.steering.tuning import TUNING
from pirrht.topology.crossings import crossed

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


class Cubic(NamedTuple):
    """One path of constant jerk, as numbers."""

    x: float  # [m]
    y: float
    vx: float  # [m/s]
    vy: float
    ax: float  # c0 [m/s^2]
    ay: float
    jx: float  # c1 [m/s^3]
    jy: float


@inlined
def place(c, s):  # type: ignore[no-untyped-def]
    """Return the position (x, y) [m] after s [s]."""
    return (
        c.x + s * (c.vx + s * (0.5 * c.ax + s * c.jx / 6.0)),
        c.y + s * (c.vy + s * (0.5 * c.ay + s * c.jy / 6.0)),
    )


@inlined
def speeds(c, s):  # type: ignore[no-untyped-def]
    """Return the velocity (vx, vy) [m/s] after s [s]."""
    return c.vx + s * (c.ax + 0.5 * s * c.jx), c.vy + s * (c.ay + 0.5 * s * c.jy)


@inlined
def _force(c, s):  # type: ignore[no-untyped-def]
    return math.hypot(c.ax + s * c.jx, c.ay + s * c.jy)


@inlined
def stride(c, s, most, free):  # type: ignore[no-untyped-def]
    """Return a time [s] in which the path surely gets no farther than `free` [m] from where it is after s [s].

    `most` is the greatest acceleration ahead [m/s^2].
    """
    vx, vy = speeds(c, s)
    v = math.sqrt(vx * vx + vy * vy)
    return 2.0 * free / max(v + math.sqrt(v * v + 2.0 * most * free), 1e-300)


@kernel
def greatest_force(c, begin, end):  # type: ignore[no-untyped-def]
    """Return the greatest magnitude of the acceleration between two times [s], [m/s^2]."""
    return max(_force(c, begin), _force(c, end))


@kernel
def entry_of_cubic(c, duration, gx, gy, radius):  # type: ignore[no-untyped-def]
    """Return the time [s] at which a path first touches the disc about (gx, gy) of a radius [m], or infinity."""
    most, s = greatest_force(c, 0.0, duration), 0.0
    while True:
        x, y = place(c, s)
        gap = math.hypot(x - gx, y - gy) - radius
        if gap <= 1e-7:  # [m]: rounding of a march to the rim
            return s
        if s >= duration:
            return np.inf
        s = min(s + stride(c, s, most, gap), duration)


@kernel
def certify_cubic(field, c, duration):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a path of a duration [s]: discs of certified clearance must cover it."""
    most, s, verdict = greatest_force(c, 0.0, duration), 0.0, FREE
    while True:
        x, y = place(c, s)
        free = clearance(field, x, y)
        if free < LEAST_STEP:
            if refused(field, x, y) == BLOCKED:
                return BLOCKED
            verdict, free = UNSURE, 0.5 * field.spacing
        if s >= duration:
            return verdict
        s = min(s + stride(c, s, most, free), duration)


def positions(c: Any, s: Any) -> Any:
    """Return positions (l, 2) [m] after times s (l,) [s]."""
    return np.column_stack(place(c, np.asarray(s)))


class Cubics(NamedTuple):
    """k motions of a mass with accelerations c0 + c1 s, one row each."""

    path: Array  # (k, 8): p0 [m], v0 [m/s], c0 [m/s^2], c1 [m/s^3]
    duration: Array  # (k,) [s]
    cost: Array  # (k,) integral of q + (r/2) |a|^2 [cost]
    tails: Array  # (k, 4) first states
    heads: Array  # (k, 4) last states; a free velocity is not a number
    rates: Array  # (k, 2): q [cost/s] and r

    def points(self, spacing: float) -> list[Array]:
        """Each motion as a polyline (l, 2) [m] with points at most `spacing` [m] apart."""
        lines = []
        for i, T in enumerate(self.duration.tolist()):
            c = self.curve(i)
            count = max(1, math.ceil(_top_speed(c, T) * T / spacing))
            lines.append(np.asarray(positions(c, np.linspace(0.0, T, count + 1))))
        return lines

    def curve(self, i: int) -> Cubic:
        """Motion i."""
        return Cubic(*self.path[i].tolist())

    def states_at(self, i: int, times: Array) -> Array:
        """States (l, 4) that motion i passes at times (l,) [s]."""
        c = self.curve(i)
        return np.column_stack([positions(c, times), np.column_stack(speeds(c, times))])

    def length(self) -> Array:
        """Lengths of the paths (k,) [m], by Gauss-Legendre quadrature."""
        times = 0.5 * self.duration[:, None] * (NODES + 1.0)
        first, linear, square = (self.path[:, k : k + 2, None] for k in (2, 4, 6))
        vx, vy = np.moveaxis(first + times[:, None] * (linear + 0.5 * times[:, None] * square), 1, 0)
        return np.asarray(0.5 * self.duration * (np.hypot(vx, vy) @ WEIGHTS))


def _top_speed(c: Cubic, T: float) -> float:
    """A speed that a curve of T [s] nowhere exceeds [m/s]."""
    return math.hypot(c.vx, c.vy) + T * float(greatest_force(c, 0.0, T))


@inlined
def _cubic(motions, i):  # type: ignore[no-untyped-def]
    p = motions.path
    return Cubic(p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5], p[i, 6], p[i, 7])


@inlined
def _entry(motions, i, around):  # type: ignore[no-untyped-def]
    return entry_of_cubic(_cubic(motions, i), motions.duration[i], around.goal_x, around.goal_y, around.goal_radius)


@inlined
def _cut(motions, i, s):  # type: ignore[no-untyped-def]
    """End motion i after s [s]; its cost is the integral of q + (r/2) |c0 + c1 s|^2."""
    c, q, r = _cubic(motions, i), motions.rates[i, 0], motions.rates[i, 1]
    still, cross = c.ax * c.ax + c.ay * c.ay, c.ax * c.jx + c.ay * c.jy
    square = still + s * (cross + s * (c.jx * c.jx + c.jy * c.jy) / 3.0)
    motions.duration[i], motions.cost[i] = s, s * (q + 0.5 * r * square)


@inlined
def _certify(motions, i, around):  # type: ignore[no-untyped-def]
    return certify_cubic(around.field, _cubic(motions, i), motions.duration[i])


@inlined
def _sure(motions, i, around):  # type: ignore[no-untyped-def]
    return _certify(motions, i, around, 0) == FREE


@kernel
def _pairs(motions, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append pairs of a polyline with the path in free discs about its corners, and so with the path's turns."""
    c, duration = _cubic(motions, i), motions.duration[i]
    most, s = greatest_force(c, 0.0, duration), 0.0
    ax, ay = place(c, 0.0)
    while s < duration:
        room = max(clearance(around.field, ax, ay), TUNING.shortest_side)
        s = min(s + stride(c, s, most, room), duration)
        bx, by = place(c, s)
        if s >= duration and not to_goal:  # the state itself: its side of a cut must not depend on rounding
            bx, by = motions.heads[i, 0], motions.heads[i, 1]
        count = crossed(around.cuts, ax, ay, bx, by, marker, turn, count)
        ax, ay = bx, by
    return count


@inlined
def _most(motions):  # type: ignore[no-untyped-def]
    return 3  # a cubic path crosses a straight cut no more often


@inlined
def _between(motions, i, share, out):  # type: ignore[no-untyped-def]
    c, s = _cubic(motions, i), share * motions.duration[i]
    out[0], out[1] = place(c, s)
    out[2], out[3] = speeds(c, s)
    return True


def _free(motions: Cubics, i: int, space: FreeSpace) -> bool:
    """Bisect by FCL's clearances, at a speed that the path nowhere exceeds."""
    c, T = motions.curve(i), float(motions.duration[i])
    v = max(_top_speed(c, T), 1e-9)
    return space.collision.bisect_free(lambda length: np.array(place(c, length / v)), T * v)


def _trajectory(steering: Any, path: Cubics) -> Trajectory:
    """Take mean accelerations of short pieces of time."""
    controls, durations = [], []
    for row, T in zip(path.path, path.duration, strict=True):
        count = max(1, math.ceil(T / TUNING.control_piece))
        middle = (np.arange(count) + 0.5) * T / count
        controls.append(row[4:6] + middle[:, None] * row[6:8])
        durations.append(np.full(count, T / count))
    return Trajectory(
        controls=np.vstack(controls), durations=np.concatenate(durations), path=path, cost=float(path.cost.sum()),
        length=float(path.length().sum()),
    )  # fmt: skip


CUBICS = Motion(MotionKernels(_entry, _cut, _certify, _sure, _pairs, _most, _between), _free, _trajectory)
