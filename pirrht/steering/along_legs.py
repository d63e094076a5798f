"""Move in space and time: straight at a constant speed from a place at a time to another later, or waiting."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.certify import BLOCKED, FREE, UNSURE, certify_segment
from pirrht.geometry.field import Field
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.certify import certify_leg, certify_some, list_passed, note_unsure
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.steering.motion import Motion, MotionKernels
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import Cuts, crossed
from pirrht.topology.homology import Homology, write_base
from pirrht.topology.moving_crossings import BaseCache, crossings_of_leg, row_of, turns_between
from pirrht.topology.tracks import MarkerTrajectories


class TimedSurroundings(NamedTuple):
    """A scene as kernels that judge or shorten motions in space and time take it."""

    field: Field
    cuts: Cuts
    markers: Array  # (m, 2) of those that stand [m]
    weights: NDArray[np.int64]  # (M,) additive keys of one turn around each marker, those that move included
    goal_x: float  # goal point [m]
    goal_y: float
    reach: float  # radius of the goal's disc [m]
    traffic: MovingObstacleArrays
    tracks: MarkerTrajectories
    speed: float  # of bases [m/s]
    bases: BaseCache  # that are kept

    @classmethod
    def of(cls, space: FreeSpace, homology: Homology) -> TimedSurroundings:
        """Take those of an examined scene and its classes."""
        goal = space.scene.goal
        x, y, reach = (float(v) for v in (*goal.center, goal.radius))
        return cls(
            field=space.field, cuts=homology.cuts, markers=homology.markers, weights=homology.hash_weights,
            goal_x=x, goal_y=y, reach=reach, traffic=space.moving, tracks=homology.tracks, speed=homology.speed,
            bases=BaseCache.room(homology.J, 0),
        )  # fmt: skip


class LegRecord(NamedTuple):
    """The arrays of k `Legs` that kernels need."""

    path: Array  # (k, 6): x, y [m], t [s] of both ends
    cost: Array  # (k,) [cost]; infinite where there is no such motion
    heads: Array  # (k, n) last states


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Legs:
    """k straight ways at a constant speed, one row each."""

    path: Array  # (k, 6): x, y [m], t [s] of both ends
    cost: Array  # (k,) integral of q + (r/2) |v|^2 [cost]
    tails: Array  # (k, 3) first states, x, y [m], t [s]
    heads: Array  # (k, 3) last states; an open time is not a number

    @property
    def duration(self) -> Array:
        """Durations (k,) [s]."""
        return np.asarray(self.path[:, 5] - self.path[:, 2])

    @property
    def knots(self) -> Array:
        """Begins of consecutive legs and the end of the last one, (k + 1, 3) [m, m, s]."""
        return np.vstack([self.path[:, :3], self.path[-1:, 3:]])

    @property
    def start(self) -> Array:
        """Begin and heading of each, x, y [m], heading [rad], (k, 3); waiting ones have the next heading."""
        dx, dy = (self.path[:, 3:5] - self.path[:, :2]).T
        moves = np.flatnonzero(np.hypot(dx, dy) > 0.0)
        i = np.minimum(np.searchsorted(moves, np.arange(len(dx))), max(len(moves) - 1, 0))
        heading = np.arctan2(dy, dx)[moves[i]] if len(moves) else np.zeros(len(dx))
        return np.column_stack([self.path[:, :2], heading])

    def length(self) -> Array:
        """Lengths (k,) [m]."""
        return np.asarray(np.hypot(self.path[:, 3] - self.path[:, 0], self.path[:, 4] - self.path[:, 1]))

    def points(self, spacing: float) -> list[Array]:
        """Both ends of each, (2, 2) [m]; no others, whatever the `spacing`."""
        return [row[[0, 1, 3, 4]].reshape(2, 2) for row in self.path]

    def places(self, times: Array) -> Array:
        """Place a path of consecutive legs at times (l,) [s], (l, 2) [m]; it stays where it begins and ends."""
        knots = self.knots
        return np.column_stack([np.interp(times, knots[:, 2], knots[:, k]) for k in (0, 1)])


@inlined
def entered(around, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Share of a straight line from (ax, ay) to (bx, by) [m] after which it enters the goal; infinity if never."""
    dx, dy = bx - ax, by - ay
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return np.inf
    s = entry_of_piece(ax, ay, math.atan2(dy, dx), 0.0, length, around.goal_x, around.goal_y, around.reach)
    return s / length if s < np.inf else np.inf


@kernel
def free_leg(around, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """Judge the leg from (ax, ay) [m] at s [s] to (bx, by) at t: FREE, BLOCKED or UNSURE."""
    standing = certify_segment(around.field, ax, ay, bx, by)
    return standing if standing == BLOCKED else min(standing, certify_leg(around.traffic, ax, ay, s, bx, by, t))


@inlined
def _extent(record):  # type: ignore[no-untyped-def]
    """Frame (x, y, X, Y) [m] of all legs, and from when to when they go [s]."""
    path = record.path
    x, y, begin, far_x, far_y, end = math.inf, math.inf, math.inf, -math.inf, -math.inf, -math.inf
    for i in range(path.shape[0]):
        if record.cost[i] < np.inf:
            x, far_x = min(x, path[i, 0], path[i, 3]), max(far_x, path[i, 0], path[i, 3])
            y, far_y = min(y, path[i, 1], path[i, 4]), max(far_y, path[i, 1], path[i, 4])
            begin, end = min(begin, path[i, 2]), max(end, path[i, 5])
    return (x, y, far_x, far_y), begin, end


@kernel
def _judge(record, into_goal, around, status, enters):  # type: ignore[no-untyped-def]
    unsure, path = 0, record.path
    (frame, begin, end), listed = _extent(record), np.empty(around.traffic.J, np.int64)
    count = list_passed(around.traffic, frame, begin, end, listed) if begin <= end else 0
    for i in range(status.shape[0]):
        if not record.cost[i] < np.inf:
            status[i], enters[i] = BLOCKED, False
            continue
        ax, ay, s, bx, by, t = path[i, 0], path[i, 1], path[i, 2], path[i, 3], path[i, 4], path[i, 5]
        share = entered(around, ax, ay, bx, by)
        enters[i] = share < np.inf
        if enters[i]:
            if not into_goal[i]:
                status[i] = BLOCKED
                continue
            bx, by, t = ax + share * (bx - ax), ay + share * (by - ay), s + share * (t - s)
            path[i, 3], path[i, 4], path[i, 5] = bx, by, t
            record.cost[i] *= share
        status[i] = certify_segment(around.field, ax, ay, bx, by)
        if status[i] != BLOCKED:
            status[i] = min(status[i], certify_some(around.traffic, listed, count, ax, ay, s, bx, by, t))
        unsure += status[i] == UNSURE
    return unsure


@kernel
def _pairs(record, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    path = record.path
    ax, ay, s, bx, by, t = path[i, 0], path[i, 1], path[i, 2], path[i, 3], path[i, 4], path[i, 5]
    if around.bases.state.shape[0] == 0 or to_goal:
        leg = (ax, ay, s), (bx, by, t)
        return crossings_of_leg(around.cuts, around.tracks, around.speed, leg[0], leg[1], to_goal, marker, turn, count)
    count = crossed(around.cuts, ax, ay, bx, by, marker, turn, count)
    goal, standing = (around.goal_x, around.goal_y), around.markers.shape[0]
    one = row_of(around.bases, around.tracks, goal, around.speed, ax, ay, s, -1)
    two = row_of(around.bases, around.tracks, goal, around.speed, bx, by, t, one)
    for j in range(around.tracks.J):
        whole = turns_between(around.bases, around.tracks, j, one, two)
        if whole != 0:
            marker[count], turn[count] = standing + j, whole
            count += 1
    return count


@inlined
def _most(record):  # type: ignore[no-untyped-def]
    return 1


@inlined
def _straight(around, x, out):  # type: ignore[no-untyped-def]
    write_base(around.markers, around.tracks, (around.goal_x, around.goal_y), around.speed, x, out)


def _record(motions: Legs) -> LegRecord:
    return LegRecord(motions.path.copy(), motions.cost.copy(), motions.heads)


def _ask(record: LegRecord, i: int, space: FreeSpace) -> bool:
    """Sweep capsules where that is not certain: one among static obstacles, others in the frame of each moving one."""
    ax, ay, s, bx, by, t = (float(v) for v in record.path[i])
    a, b, unsure = np.array([ax, ay]), np.array([bx, by]), np.zeros(space.moving.J, dtype=np.bool_)
    if certify_segment(space.field, ax, ay, bx, by) != FREE and not space.collision.segments_free(a[None], b[None])[0]:
        return False
    note_unsure(space.moving, ax, ay, s, bx, by, t, unsure)
    return not (unsure.any() and space.moving_collision.meets(a, s, b, t, unsure))


def _until_goal(path: Legs, around: Any) -> Legs:
    ax, ay, s, bx, by, t = (float(v) for v in path.path[-1])
    share = entered(around, ax, ay, bx, by)
    if share == np.inf:
        return path
    rows, cost = path.path.copy(), path.cost.copy()
    rows[-1, 3:] = ax + share * (bx - ax), ay + share * (by - ay), s + share * (t - s)
    cost[-1] *= share
    return replace(path, path=rows, cost=cost)


def _trajectory(steering: Any, path: Legs) -> Trajectory:
    """Make one control for each leg; waiting is no control for a while."""
    duration, length = path.duration, path.length()
    keep = duration > 0.0
    velocity = (path.path[keep, 3:5] - path.path[keep, :2]) / duration[keep, None]
    return Trajectory(
        controls=velocity, durations=duration[keep], path=path, cost=float(path.cost.sum()), length=float(length.sum())
    )


def _between(path: Legs, i: int, shares: Array) -> Array:
    tail, head = path.path[i, :3], path.path[i, 3:]
    return np.asarray(tail + shares[:, None] * (head - tail))


LEGS = Motion(MotionKernels(_judge, _pairs, _most, _straight), _record, _ask, _until_goal, _trajectory, _between)
