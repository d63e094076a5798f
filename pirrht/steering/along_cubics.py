"""Move a mass with an acceleration linear in time: the cubic paths of the double integrator's optimum."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.certify import BLOCKED, UNSURE
from pirrht.geometry.cubics import (
    Cubic,
    certify_cubic,
    entry_of_cubic,
    greatest_force,
    place,
    positions,
    speeds,
    stride,
)
from pirrht.geometry.field import clearance
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import Motion, MotionKernels, Surroundings
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import crossed

CROSSINGS = 3  # a cubic path crosses a straight cut no more often
TAPE = 0.05  # pieces of constant control that a trajectory is told in [s]
SHORT = 1e-3  # where the field cannot certify a path, its turns are those of a polyline with sides of so much [m]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


class CubicRecord(NamedTuple):
    """The arrays of k `Cubics` that kernels need."""

    path: Array  # (k, 8): p0 [m], v0 [m/s], c0 [m/s^2], c1 [m/s^3]
    duration: Array  # (k,) [s]
    cost: Array  # (k,) [cost]
    heads: Array  # (k, n) last states
    rates: Array  # (k, 2): q [cost/s] and r of (r/2) |a|^2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cubics:
    """k motions of a mass with accelerations c0 + c1 s, one row each."""

    path: Array  # (k, 8): p0 [m], v0 [m/s], c0 [m/s^2], c1 [m/s^3]
    duration: Array  # (k,) [s]
    cost: Array  # (k,) integral of q + (r/2) |a|^2 [cost]
    rates: Array  # (k, 2): q [cost/s] and r
    tails: Array  # (k, 4) first states
    heads: Array  # (k, 4) last states; a free velocity is not a number

    def points(self, spacing: float) -> list[Array]:
        """Each motion as a polyline (l, 2) [m] with points at most `spacing` [m] apart."""
        return [self._line(i, spacing) for i in range(len(self.path))]

    def states_at(self, i: int, times: Array) -> Array:
        """States (l, 4) that motion i passes at times (l,) [s]."""
        c = Cubic(*self.path[i])
        return np.column_stack([positions(c, times), np.column_stack(speeds(c, times))])

    def length(self) -> Array:
        """Lengths of the paths (k,) [m]."""
        times = 0.5 * self.duration[:, None] * (NODES + 1.0)
        first, linear, square = (self.path[:, k : k + 2, None] for k in (2, 4, 6))
        vx, vy = np.moveaxis(first + times[:, None] * (linear + 0.5 * times[:, None] * square), 1, 0)
        return np.asarray(0.5 * self.duration * (np.hypot(vx, vy) @ WEIGHTS))

    def _line(self, i: int, spacing: float) -> Array:
        c, T = Cubic(*(float(v) for v in self.path[i])), float(self.duration[i])
        most = math.hypot(c.vx, c.vy) + T * greatest_force(c, 0.0, T)
        count = max(1, math.ceil(most * T / spacing))
        return np.asarray(positions(c, np.linspace(0.0, T, count + 1)))


@inlined
def _cubic(record, i):  # type: ignore[no-untyped-def]
    p = record.path
    return Cubic(p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5], p[i, 6], p[i, 7])


@kernel
def cost_until(record, i, s):  # type: ignore[no-untyped-def]
    """Cost of the first s [s] of motion i."""
    c, q, r = _cubic(record, i), record.rates[i, 0], record.rates[i, 1]
    still, cross = c.ax * c.ax + c.ay * c.ay, c.ax * c.jx + c.ay * c.jy
    square = still + s * (cross + s * (c.jx * c.jx + c.jy * c.jy) / 3.0)
    return s * (q + 0.5 * r * square)


@kernel
def _judge(record, into_goal, around, status, enters):  # type: ignore[no-untyped-def]
    unsure = 0
    for i in range(status.shape[0]):
        if not record.cost[i] < np.inf:
            status[i], enters[i] = BLOCKED, False
            continue
        c = _cubic(record, i)
        s = entry_of_cubic(c, record.duration[i], around.goal_x, around.goal_y, around.reach)
        enters[i] = s < np.inf
        if enters[i] and not into_goal[i]:
            status[i] = BLOCKED
            continue
        if enters[i]:
            record.duration[i] = s
            record.cost[i] = cost_until(record, i, s)
        status[i] = certify_cubic(around.field, c, record.duration[i])
        unsure += status[i] == UNSURE
    return unsure


@kernel
def _pairs(record, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append pairs of a polyline with the path in free discs about its corners, and so with the path's turns."""
    c, duration = _cubic(record, i), record.duration[i]
    most, s = greatest_force(c, 0.0, duration), 0.0
    ax, ay = place(c, 0.0)
    while s < duration:
        room = max(clearance(around.field, ax, ay), SHORT)
        s = min(s + stride(c, s, most, room), duration)
        bx, by = place(c, s)
        if s >= duration and not to_goal:  # the state itself: its side of a cut must not depend on rounding
            bx, by = record.heads[i, 0], record.heads[i, 1]
        count = crossed(around.cuts, ax, ay, bx, by, marker, turn, count)
        ax, ay = bx, by
    return count


@inlined
def _most(record):  # type: ignore[no-untyped-def]
    return CROSSINGS


def _record(motions: Cubics) -> CubicRecord:
    return CubicRecord(motions.path, motions.duration.copy(), motions.cost.copy(), motions.heads, motions.rates)


def _ask(record: CubicRecord, i: int, space: FreeSpace) -> bool:
    """Bisect by FCL's clearances, at a pace that the path nowhere exceeds."""
    c, T = Cubic(*(float(v) for v in record.path[i])), float(record.duration[i])
    pace = max(math.hypot(c.vx, c.vy) + T * greatest_force(c, 0.0, T), 1e-9)
    return space.collision.bisect_free(lambda length: np.array(place(c, length / pace)), T * pace)


def _until_goal(path: Cubics, around: Surroundings) -> Cubics:
    record, last = _record(path), len(path.path) - 1
    s = entry_of_cubic(_cubic(record, last), record.duration[last], around.goal_x, around.goal_y, around.reach)
    if s < np.inf:
        record.duration[last], record.cost[last] = s, cost_until(record, last, s)
    return replace(path, duration=record.duration, cost=record.cost)


def _trajectory(steering: Any, path: Cubics) -> Trajectory:
    """Take mean accelerations of short pieces of time."""
    controls, durations = [], []
    for row, T in zip(path.path, path.duration, strict=True):
        count = max(1, math.ceil(T / TAPE))
        middle = (np.arange(count) + 0.5) * T / count
        controls.append(row[4:6] + middle[:, None] * row[6:8])
        durations.append(np.full(count, T / count))
    return Trajectory(
        controls=np.vstack(controls), durations=np.concatenate(durations), path=path, cost=float(path.cost.sum()),
        length=float(path.length().sum()),
    )  # fmt: skip


def _between(path: Cubics, i: int, shares: Array) -> Array:
    return path.states_at(i, shares * path.duration[i])


CUBICS = Motion(MotionKernels(_judge, _pairs, _most), _record, _ask, _until_goal, _trajectory, _between)
