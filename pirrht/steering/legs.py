"""Move in space and time: straight at a constant speed from a place at a time to another later, or waiting."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import BLOCKED, FREE, certify_segment, entry_of_piece
from pirrht.geometry.world import NOTHING_MOVES, MovingKernels
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import Motion, MotionKernels, Trajectory
from pirrht.topology.crossings import crossed
from pirrht.topology.moving_crossings import crossings_of_leg, row_of, turns_between


class Legs(NamedTuple):
    """k straight motions at a constant speed, one row each."""

    path: Array  # (k, 6): x, y [m], t [s] of both ends
    cost: Array  # (k,) integral of q + (r/2) |v|^2 [cost]; infinite where there is no such motion
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
    s = entry_of_piece(ax, ay, math.atan2(dy, dx), 0.0, length, around.goal_x, around.goal_y, around.goal_radius)
    return s / length if s < np.inf else np.inf


@cache
def free_leg(moving: MovingKernels | None) -> Any:
    """Build the kernel (around, leg) that judges a leg (ax, ay, s, bx, by, t) [m, s]: FREE, BLOCKED or UNSURE."""
    among, certify = moving is not None, (moving or NOTHING_MOVES).certify

    @inlined
    def judged(around, leg):  # type: ignore[no-untyped-def]
        static = certify_segment(around.field, leg[0], leg[1], leg[3], leg[4])
        if among and static != BLOCKED:
            return min(static, certify(around.traffic, leg))
        return static

    return judged


@inlined
def _ends(motions, i):  # type: ignore[no-untyped-def]
    p = motions.path
    return p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5]


@inlined
def _entry(motions, i, around):  # type: ignore[no-untyped-def]
    ax, ay, _, bx, by, _ = _ends(motions, i)
    return entered(around, ax, ay, bx, by)


@inlined
def _cut(motions, i, share):  # type: ignore[no-untyped-def]
    ax, ay, s, bx, by, t = _ends(motions, i)
    motions.path[i, 3], motions.path[i, 4] = ax + share * (bx - ax), ay + share * (by - ay)
    motions.path[i, 5] = s + share * (t - s)
    motions.cost[i] *= share


@kernel
def _pairs(motions, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    ax, ay, s, bx, by, t = _ends(motions, i)
    if around.bases.state.shape[0] == 0 or to_goal:
        tail, head = (ax, ay, s), (bx, by, t)
        return crossings_of_leg(around, tail, head, to_goal, marker, turn, count)
    count = crossed(around.cuts, ax, ay, bx, by, marker, turn, count)
    goal, static = (around.goal_x, around.goal_y), around.markers.shape[0]
    one = row_of(around.bases, around.tracks, goal, around.speed, ax, ay, s, -1)
    two = row_of(around.bases, around.tracks, goal, around.speed, bx, by, t, one)
    for j in range(around.tracks.J):
        whole = turns_between(around.bases, around.tracks, j, one, two)
        if whole != 0:
            marker[count], turn[count] = static + j, whole
            count += 1
    return count


@inlined
def _most(motions):  # type: ignore[no-untyped-def]
    return 1


@inlined
def _between(motions, i, share, out):  # type: ignore[no-untyped-def]
    for k in range(3):
        out[k] = motions.path[i, k] + share * (motions.path[i, 3 + k] - motions.path[i, k])
    return True


def _free(motions: Legs, i: int, space: FreeSpace) -> bool:
    """Sweep a capsule among static obstacles where that is not certain; moving ones have their own."""
    ax, ay, s, bx, by, t = motions.path[i].tolist()
    a, b = np.array([ax, ay]), np.array([bx, by])
    if certify_segment(space.field, ax, ay, bx, by) != FREE and not space.collision.segments_free(a[None], b[None])[0]:
        return False
    return not space.moving.meets(a, s, b, t)


def _trajectory(steering: Any, path: Legs) -> Trajectory:
    """Make one control for each leg; waiting is no control for a while."""
    duration, length = path.duration, path.length()
    keep = duration > 0.0
    velocity = (path.path[keep, 3:5] - path.path[keep, :2]) / duration[keep, None]
    return Trajectory(
        controls=velocity, durations=duration[keep], path=path, cost=float(path.cost.sum()), length=float(length.sum())
    )


@cache
def legs_among(moving: MovingKernels | None) -> Motion:
    """Return the kind of motions that legs are, by kernels of moving obstacles; None: there are none."""
    judged = free_leg(moving)

    @inlined
    def certify(motions, i, around):  # type: ignore[no-untyped-def]
        return judged(around, _ends(motions, i))

    @inlined
    def sure(motions, i, around):  # type: ignore[no-untyped-def]
        return judged(around, _ends(motions, i)) == FREE

    return Motion(MotionKernels(_entry, _cut, certify, sure, _pairs, _most, _between), _free, _trajectory)
