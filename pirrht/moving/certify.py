"""Certify straight steps at a constant speed and heading, in space and time, and turns, among moving obstacles.

Seen from an obstacle such a step is straight between two rows, and its clearance changes no faster than the relative
speed and the obstacle's turning times its radius let it. A march by that bound certifies it; the greatest speeds
of both rule out far obstacles first.
"""

import math

from pirrht.geometry.space import BLOCKED, FREE, LEAST_STEP, UNSURE
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.jit.jit import inlined, kernel, load_int64
from pirrht.moving.tuning import TABLE, TUNING

from pirrht.moving.distances import (  # isort: skip
    clearance_facing, disc_of, fastest_of, moving_clearance, outside_of, piece_of, restart_of, solids_of,
)  # fmt: skip


@kernel
def certify(moving, leg, heading):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight step (ax, ay, s, bx, by, t) from a [m] at s [s] to b at t."""
    verdict = FREE
    for j in range(moving.J):
        one = certify_past(moving, j, leg, heading)
        if one == BLOCKED:
            return BLOCKED
        verdict = min(verdict, one)
    return verdict


@kernel
def certify_turn(moving, pose, angle, t):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a turn on the spot from a pose by an angle [rad] at t [s]."""
    x, y, th = pose
    turned, verdict = 0.0, FREE
    while True:
        c = moving_clearance(moving, (x, y, th + math.copysign(turned, angle)), t)
        if c < LEAST_STEP:
            if c <= -moving.excess - 2.0 * moving.pitch:
                return BLOCKED
            verdict, c = UNSURE, TUNING.stride
        if turned >= abs(angle):
            return verdict
        turned = min(turned + c / moving.reach, abs(angle))


@kernel
def note_unsure(moving, leg, heading, out):  # type: ignore[no-untyped-def]
    """Write to `out` (J,) which obstacles a step does not surely pass."""
    for j in range(moving.J):
        out[j] = certify_past(moving, j, leg, heading) != FREE


@inlined
def certify_past(moving, j, leg, heading):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight step by obstacle j alone."""
    ax, ay, s, bx, by, t = leg

    per = 1.0 / (t - s) if t > s else 0.0
    half = 0.5 * (t - s)
    radius = disc_of(moving, j) + LEAST_STEP

    ux = (bx - ax) * per
    uy = (by - ay) * per
    now = s
    verdict = FREE

    if not restart_of(moving, j, s) < t:
        ox, oy, _, _, _, _, _ = piece_of(moving, j, s + half)
        reach = half * (math.sqrt(ux * ux + uy * uy) + fastest_of(moving, j)) + LEAST_STEP
        if outside_of(moving, j, ox, oy, 0.5 * (ax + bx), 0.5 * (ay + by)) > reach:
            return FREE
    while True:
        ox, oy, yaw, vx, vy, turn, until = piece_of(moving, j, now)

        x = ax + (now - s) * ux
        y = ay + (now - s) * uy
        end = min(max(until, now + GEOMETRY.moment), t)

        begin, leaves = within(x - ox, y - oy, ux - vx, uy - vy, end - now, radius)
        if begin <= leaves:
            speed = math.hypot(ux - vx, uy - vy) + abs(turn) * disc_of(moving, j)
            one = _marched(moving, j, (ox, oy, yaw, vx, vy, turn), (x, y, ux, uy, heading), begin, leaves, speed)
            if one == BLOCKED:
                return BLOCKED
            verdict = min(verdict, one)
        if end >= t:
            return verdict
        now = end


@inlined
def within(x, y, vx, vy, duration, radius):  # type: ignore[no-untyped-def]
    """Return from when to when [s] a point at (x, y) [m] that moves at (vx, vy) [m/s] is inside a circle.

    The circle is around the origin, `radius` in [m], the duration in [s]; the second time is the lesser if it never is.
    """
    gap = x * x + y * y - radius * radius
    along = x * vx + y * vy
    square = vx * vx + vy * vy

    if gap > 0.0 and (along >= 0.0 or along * along < square * gap):
        return 1.0, 0.0
    if square == 0.0:
        return 0.0, duration
    root = math.sqrt(max(along * along - square * gap, 0.0))
    return max((-along - root) / square, 0.0), min((-along + root) / square, duration)


@kernel
def _marched(moving, j, pose, way, now, end, speed):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a piece of the motion of obstacle j and one of a step, between two times [s].

    Pose [m, m, rad] and rates [1/s] of the obstacle (6,), place [m], velocity [m/s] and heading [rad] of the robot (5,)
    are those at time 0; clearances change at most at a speed [m/s].
    """
    (ox, oy, yaw, vx, vy, turn), (x, y, ux, uy, heading) = pose, way
    error, least, verdict = 0.0, TUNING.certain, FREE
    for k in solids_of(moving, j):
        if load_int64(moving.form, TABLE * k) < 0:  # distances are those of a table
            error, least = moving.pitch, LEAST_STEP
    while True:
        a = yaw + now * turn
        body = ox + now * vx, oy + now * vy, math.cos(a), math.sin(a)
        c = clearance_facing(moving, j, body, (x + now * ux, y + now * uy, heading)) - error
        if c < least:
            if c <= -moving.excess - 2.0 * error:
                return BLOCKED
            verdict, c = UNSURE, TUNING.stride
        if now >= end:
            return verdict
        now = min(now + c / speed, end) if speed > 0.0 else end
