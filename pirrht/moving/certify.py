"""Certify straight steps at a constant speed, in space and time, among moving obstacles.

Seen from an obstacle such a step is straight between two rows, and its clearance changes no faster than the relative
speed and the obstacle's turning times its radius let it. A march by that bound certifies it; a closed form
rules out far obstacles first.
"""

from __future__ import annotations

import math

from pirrht.geometry.arcs import BLOCKED, FREE, LEAST_STEP, UNSURE
from pirrht.geometry.spans import BOX, keeps_off
from pirrht.geometry.tuning import TUNING as SPANS
from pirrht.jit.jit import inlined, kernel, load_int64
from pirrht.moving.distances import LEAD, PERIOD, clearance_of_body, disc_of, inexact, of_body, piece_of
from pirrht.moving.tuning import PARTS, TUNING


@kernel
def certify_leg(moving, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for the straight step from (ax, ay) [m] at s [s] to (bx, by) at t."""
    verdict = FREE
    for j in range(moving.J):
        one = certify_past(moving, j, ax, ay, s, bx, by, t)
        if one == BLOCKED:
            return BLOCKED
        if one == UNSURE:
            verdict = UNSURE
    return verdict


@inlined
def _boxes_of(moving, j, t):  # type: ignore[no-untyped-def]
    """Return address and number of the boxes of obstacle j, its own clock's time at t, and its period [s]."""
    first, last = load_int64(moving.parts, PARTS * j + 4), load_int64(moving.parts, PARTS * j + 5)
    own, period = t + of_body(moving, j, LEAD), of_body(moving, j, PERIOD)
    return moving.boxes + 8 * BOX * first, last - first, own, period


@kernel
def note_unsure(moving, ax, ay, s, bx, by, t, out):  # type: ignore[no-untyped-def]
    """Write to `out` (J,) which obstacles the step from (ax, ay) [m] at s [s] to (bx, by) at t does not surely pass."""
    for j in range(moving.J):
        out[j] = certify_past(moving, j, ax, ay, s, bx, by, t) != FREE


@inlined
def certify_past(moving, j, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a straight step by obstacle j alone."""
    per = 1.0 / (t - s) if t > s else 0.0
    ux, uy, now, verdict = (bx - ax) * per, (by - ay) * per, s, FREE
    boxes, count, own, period = _boxes_of(moving, j, s)
    if keeps_off(boxes, count, own, period, (ax, ay, ux, uy), t - s, disc_of(moving, j) + LEAST_STEP):
        return FREE
    while True:
        ox, oy, yaw, vx, vy, turn, until = piece_of(moving, j, now)
        x, y, end = ax + (now - s) * ux, ay + (now - s) * uy, min(max(until, now + SPANS.moment), t)
        begin, leaves = within(x - ox, y - oy, ux - vx, uy - vy, end - now, disc_of(moving, j) + LEAST_STEP)
        if begin <= leaves:
            speed = math.hypot(ux - vx, uy - vy) + abs(turn) * disc_of(moving, j)
            one = _marched(moving, j, (ox, oy, yaw, vx, vy, turn), (x, y, ux, uy), begin, leaves, speed)
            if one == BLOCKED:
                return BLOCKED
            if one == UNSURE:
                verdict = UNSURE
        if end >= t:
            return verdict
        now = end


@inlined
def within(x, y, vx, vy, duration, radius):  # type: ignore[no-untyped-def]
    """Return from when to when [s] a point at (x, y) [m] that moves at (vx, vy) [m/s] is inside a circle.

    The circle is around the origin, `radius` in [m], the duration in [s]; the second time is the lesser if it never is.
    """
    gap, along, square = x * x + y * y - radius * radius, x * vx + y * vy, vx * vx + vy * vy
    if gap > 0.0 and (along >= 0.0 or along * along < square * gap):
        return 1.0, 0.0
    if square == 0.0:
        return 0.0, duration
    root = math.sqrt(max(along * along - square * gap, 0.0))
    return max((-along - root) / square, 0.0), min((-along + root) / square, duration)


@kernel
def _marched(moving, j, pose, way, now, end, speed):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a piece of the motion of obstacle j and one of a step.

    Args:
        moving, j: the body's.
        pose: of the obstacle at time 0 [m, m, rad], and its rates [1/s], (6,).
        way: place at time 0 [m] and velocity [m/s], (4,).
        now, end: the times [s].
        speed: by which clearances change at most [m/s].
    """
    (ox, oy, yaw, vx, vy, turn), (x, y, ux, uy) = pose, way
    error, least, verdict = 0.0, TUNING.certain, FREE
    if inexact(moving, j):
        error, least = moving.pitch, LEAST_STEP
    while True:
        px, py, qx, qy = ox + now * vx, oy + now * vy, x + now * ux, y + now * uy
        c = clearance_of_body(moving, j, px, py, yaw + now * turn, qx, qy) - error
        if c < least:
            if c <= -2.0 * error:
                return BLOCKED
            verdict, c = UNSURE, TUNING.stride
        if now >= end:
            return verdict
        now = min(now + c / speed, end) if speed > 0.0 else end
