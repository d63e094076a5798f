"""Legs: straight lines in space and time at a constant speed, and what is free, crossed and paid along them.

A robot that is no disc is headed along a leg, or backwards along it; at its ends it turns on the spot, in no time.
"""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import backwards, entry_of_piece, turns_of, wrapped
from pirrht.geometry.pieces import apart, share_into_ball
from pirrht.geometry.space import BLOCKED, FREE, SpaceKernels
from pirrht.geometry.world import NOTHING_MOVES, Moving, MovingKernels
from pirrht.jit.jit import as_tuple, inlined, kernel
from pirrht.steering.motion import Legs, MotionKernels, MotionKind, Surroundings, Trajectory
from pirrht.topology.signature import SignatureKernels

LATE = 1e-9  # share by which rounding may exceed the limit of speeds


@inlined
def entered(around, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Share of a straight line from (ax, ay) to (bx, by) [m] after which it enters the goal; infinity if never."""
    dx, dy = bx - ax, by - ay
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return np.inf
    s = entry_of_piece(ax, ay, math.atan2(dy, dx), 0.0, length, *around.goal, around.goal_radius)
    return s / length if s < np.inf else np.inf


@cache
def free_leg(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel (around, leg) that judges a leg (ax, ay, s, bx, by, t) [m, s]: FREE, BLOCKED or UNSURE."""
    among, certify = moving is not None, (moving or NOTHING_MOVES).certify
    certify_piece = space.certify_piece

    @kernel
    def judged(around, leg):  # type: ignore[no-untyped-def]
        static = certify_piece(around.static, (leg[0], leg[1]), (leg[3], leg[4]), True)
        return min(static, certify(around.traffic, leg, 0.0)) if among and static != BLOCKED else static

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
    half = motions.path.shape[1] // 2
    for k in range(half):
        motions.path[i, half + k] = motions.path[i, k] + share * (motions.path[i, half + k] - motions.path[i, k])
    motions.cost[i] *= share


@cache
def _pairs_of(classes: SignatureKernels) -> Any:
    """Build the kernel that counts the turns of legs, by kernels of a signature."""
    crossings = classes.crossings

    @kernel
    def pairs(motions, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
        ax, ay, s, bx, by, t = _ends(motions, i)
        return crossings(around.classes, (ax, ay, s), (bx, by, t), to_goal, marker, turn, count)

    return pairs


def _free(motions: Legs, i: int, space: FreeSpace) -> bool:
    """Sweep a capsule among static obstacles where that is not certain; moving ones have their own test."""
    (*tail, s), (*head, t) = motions.path[i].reshape(2, -1).tolist()
    a = np.array(tail)
    b = np.array(head)

    sure = space.static.kernels.certify_piece(space.static, tuple(tail), tuple(head), True) == FREE
    return bool(sure or space.collision.segments_free(a[None], b[None])[0]) and not space.moving.meets(a, s, b, t)


def _trajectory(steering: Any, path: Legs) -> Trajectory:
    """Make one control for each leg; waiting is no control for a while."""
    step = path.path[:, path.d + 1 :] - path.path[:, : path.d + 1]
    length = float(np.hypot.reduce(step[:, :-1], axis=1).sum())
    step = step[step[:, -1] > 0.0]

    return Trajectory(
        controls=step[:, :-1] / step[:, -1:], durations=step[:, -1], path=path, cost=float(path.cost.sum()),
        length=length,
    )  # fmt: skip


_most = inlined(lambda motions: 1)


@cache
def _certify_for(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel that certifies legs, by kernels of a footprint and of moving obstacles; None: nothing moves."""
    free = free_leg(space, moving)
    return inlined(lambda motions, i, around, patient: free(around, _ends(motions, i)))


def _kernels(around: Surroundings) -> MotionKernels:
    certify = _certify_for(around.static.kernels, around.traffic.kernels)
    return MotionKernels(_entry, _cut, certify, _pairs_of(around.classes.kernels), _most)


LEGS = MotionKind(_kernels, _free, _trajectory)


@cache
def free_turning(space: SpaceKernels, moving: MovingKernels | None) -> Any:
    """Build the kernel (around, leg, headings, back, patient) that judges a leg with turns on the spot at its ends.

    A leg is (ax, ay, s, bx, by, t) [m, s]; the headings are those before, along it and after [rad].
    """
    certify_piece, certify_turn = space.certify_piece, space.certify_turn
    among, (certify_leg, turn_among) = moving is not None, (moving or NOTHING_MOVES)[-2:]

    @kernel
    def turn_judged(around, pose, angle, t, patient):  # type: ignore[no-untyped-def]
        verdict = certify_turn(around.static, pose, angle, patient)
        return min(verdict, turn_among(around.traffic, pose, angle, t)) if among and verdict != BLOCKED else verdict

    @kernel
    def judged(around, leg, headings, back, patient):  # type: ignore[no-untyped-def]
        (ax, ay, s, bx, by, t), (before, way, after), verdict = leg, headings, FREE
        if ax != bx or ay != by:
            tail, head = ((bx, by), (ax, ay)) if back else ((ax, ay), (bx, by))
            verdict = certify_piece(around.static, tail, head, patient)
        if among and verdict != BLOCKED:
            verdict = min(verdict, certify_leg(around.traffic, leg, way))
        for begins in (True, False):
            if verdict == FREE or (patient and verdict != BLOCKED):
                pose, angle, now = ((ax, ay, before), way - before, s) if begins else ((bx, by, way), after - way, t)
                verdict = min(verdict, turn_judged(around, pose, wrapped(angle), now, patient))
        return verdict

    return judged


def is_free_turning(
    collision: Any, moving: Moving, leg: tuple[float, ...], headings: tuple[float, ...], back: bool
) -> bool:  # fmt: skip
    """Judge such a leg exactly."""
    (ax, ay, s, bx, by, t), (before, way, after) = leg, headings
    first = wrapped(way - before)
    last = wrapped(after - way)
    a, b = np.array([ax, ay]), np.array([bx, by])
    poses = [np.append(a, way - first), np.append(a, way), np.append(b, way), np.append(b, way + last)]
    tail, head = (b, a) if back else (a, b)
    return bool(
        (np.array_equal(a, b) or collision.segments_free(tail[None], head[None])[0])
        and collision.turn_free(poses[0], first)
        and collision.turn_free(poses[2], last)
        and not any(moving.meets(poses[k], (s, s, t)[k], poses[k + 1], (s, t, t)[k]) for k in range(3))
    )


@cache
def turned_legs(reverses: bool) -> MotionKind:
    """Return the kind of legs between places, times and headings, of robots that reverse or do not."""

    @inlined
    def headings_of(motions, i):  # type: ignore[no-untyped-def]
        """Return the headings before, along and after a leg [rad], and whether it is driven backwards."""
        ax, ay, _, bx, by, _ = _ends(motions, i)
        before = motions.tails[i, 3]
        after = motions.heads[i, 3]
        way, back = before, False
        if ax != bx or ay != by:
            way = math.atan2(by - ay, bx - ax)
            back = backwards(way, before, after, reverses)
            way = wrapped(way + math.pi) if back else way
        return (before, way, after), back

    @inlined
    def cut(motions, i, share):  # type: ignore[no-untyped-def]
        """End a leg after a share of it, as it is headed there: it has arrived."""
        motions.heads[i, 3] = headings_of(motions, i)[0][1]
        _cut(motions, i, share)

    @kernel
    def between(motions, i, share, out):  # type: ignore[no-untyped-def]
        for k in range(3):
            out[k] = motions.path[i, k] + share * (motions.path[i, 3 + k] - motions.path[i, k])
        out[3] = headings_of(motions, i)[0][1]
        return share >= 0.0  # numba hands no literal to Python

    @cache
    def certify_for(space: SpaceKernels, moving: MovingKernels | None) -> Any:
        judged = free_turning(space, moving)
        return inlined(
            lambda motions, i, around, patient: judged(around, _ends(motions, i), *headings_of(motions, i), patient)
        )

    def kernels(around: Surroundings) -> MotionKernels:
        certify = certify_for(around.static.kernels, around.traffic.kernels)
        return MotionKernels(_entry, cut, certify, _pairs_of(around.classes.kernels), _most, between)

    def free(motions: Legs, i: int, space: FreeSpace) -> bool:
        leg = tuple(motions.path[i].tolist())
        return is_free_turning(space.collision, space.moving, leg, *headings_of(motions, i))

    def trajectory(steering: Any, path: Legs) -> Trajectory:
        return replace(_trajectory(steering, path), between=between, reads=(0, 1, 3))

    return MotionKind(kernels, free, trajectory)


@inlined
def timed_cost(square, begin, end, numbers):  # type: ignore[no-untyped-def]
    """Cost and duration of a leg by the square of its length [m^2] and both times [s], of which the end may be open."""
    q, r, speed, pace = numbers
    dt = math.sqrt(square) / pace if math.isnan(end) else end - begin
    if math.isnan(begin) or not dt >= 0.0 or square > (speed * dt) ** 2 * (1.0 + LATE):
        return np.inf, 0.0
    if dt == 0.0:
        return (0.0 if math.isnan(end) else np.inf), 0.0
    return q * dt + 0.5 * r * square / dt, dt


@inlined
def cost_and_duration(tail, head, numbers):  # type: ignore[no-untyped-def]
    """Cost and duration of a leg; the time of its end may be open."""
    dx = head[0] - tail[0]
    dy = head[1] - tail[1]
    return timed_cost(dx * dx + dy * dy, tail[2], head[2], numbers)


@kernel
def connect(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair by one leg; the numbers are q, r, the limit of speeds and the best speed."""
    k = tails.shape[0]
    path = np.empty((k, 6))
    cost = np.empty(k)

    for i in range(k):
        cost[i], dt = cost_and_duration(as_tuple(tails[i], 3), as_tuple(heads[i], 3), numbers)
        for c in range(3):
            path[i, c] = tails[i, c]
            path[i, 3 + c] = heads[i, c]
        if math.isnan(heads[i, 2]):
            path[i, 5] = tails[i, 2] + dt
    return Legs(path, cost, tails, heads)


@inlined
def turning_cost(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    """Return the cost of a leg with the turns at its ends; more numbers are the cost per radian, and `reverses`."""
    cost, _ = cost_and_duration(tail, head, numbers[:4])
    if not cost < limit:
        return np.inf
    before, after = tail[3], head[3]
    if tail[0] == head[0] and tail[1] == head[1]:
        return cost + numbers[4] * abs(wrapped(after - before))
    way = math.atan2(head[1] - tail[1], head[0] - tail[0])
    turn = turns_of(way, before, after)
    if numbers[5] > 0.0:
        turn = min(turn, turns_of(way + math.pi, before, after))
    return cost + numbers[4] * turn


@kernel
def connect_turning(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair of places, times and headings by one leg; the numbers are those of `turning_cost`."""
    legs = connect(tails, heads, numbers[:4])
    for i in range(tails.shape[0]):
        legs.cost[i] = turning_cost(as_tuple(tails[i], 4), as_tuple(heads[i], 4), numbers, np.inf)
    return Legs(legs.path, legs.cost, tails, heads.copy())


@inlined
def _ends_in_space(motions, i):  # type: ignore[no-untyped-def]
    p = motions.path
    return (p[i, 0], p[i, 1], p[i, 2]), p[i, 3], (p[i, 4], p[i, 5], p[i, 6]), p[i, 7]


@inlined
def _entry_in_space(motions, i, around):  # type: ignore[no-untyped-def]
    a, _, b, _ = _ends_in_space(motions, i)
    return share_into_ball(a, b, around.goal, around.goal_radius)


@inlined
def _between_in_space(motions, i, share, out):  # type: ignore[no-untyped-def]
    """Write place and time on a leg, which are the whole state of a vertex."""
    for k in range(out.shape[0]):
        out[k] = motions.path[i, k] + share * (motions.path[i, out.shape[0] + k] - motions.path[i, k])
    return True


@cache
def _judges_in_space(space: SpaceKernels, moving: MovingKernels | None, classes: SignatureKernels) -> tuple[Any, Any]:
    """Build the kernels that certify legs in space and that count their turns, by kernels of a ball and a signature."""
    among, certify_among = moving is not None, (moving or NOTHING_MOVES).certify
    certify_piece, crossings = space.certify_piece, classes.crossings

    @kernel
    def certify(motions, i, around, patient):  # type: ignore[no-untyped-def]
        a, s, b, t = _ends_in_space(motions, i)
        verdict = certify_piece(around.static, a, b, True)
        return (
            min(verdict, certify_among(around.traffic, (*a, s, *b, t), 0.0))
            if among and verdict != BLOCKED
            else verdict
        )

    @kernel
    def pairs(motions, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
        a, s, b, t = _ends_in_space(motions, i)
        return crossings(around.classes, (*a, s), (*b, t), to_goal, marker, turn, count)

    return certify, pairs


def _kernels_in_space(around: Surroundings) -> MotionKernels:
    certify, pairs = _judges_in_space(around.static.kernels, around.traffic.kernels, around.classes.kernels)
    return MotionKernels(_entry_in_space, _cut, certify, pairs, _most, _between_in_space)


LEGS_IN_SPACE = MotionKind(_kernels_in_space, _free, _trajectory)


@inlined
def cost_in_space(tail, head, numbers, limit):  # type: ignore[no-untyped-def]
    """Cost of a leg in space; the time of its end may be open."""
    return timed_cost(apart(tail, head) ** 2, tail[3], head[3], numbers)[0]


@kernel
def connect_in_space(tails, heads, numbers):  # type: ignore[no-untyped-def]
    """Connect each pair of places and times in space by one leg; the numbers are those of `connect`."""
    k = tails.shape[0]
    path = np.hstack((tails, heads))
    cost = np.empty(k)
    for i in range(k):
        cost[i], dt = timed_cost(apart(tails[i], heads[i]) ** 2, tails[i, 3], heads[i, 3], numbers)
        if math.isnan(heads[i, 3]):
            path[i, 7] = tails[i, 3] + dt
    return Legs(path, cost, tails, heads)
