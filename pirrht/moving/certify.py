"""What surely passes bodies that move: straight ways at a constant speed, in space and time.

Seen from a body such a way is straight between two rows, and its clearance changes no faster than the body's relative
speed and its turning times its reach let it. A march by that bound certifies it; where bodies are too far to matter a
closed form says so first.
"""

from __future__ import annotations

import math

from pirrht.geometry.certify import BLOCKED, FREE, LEAST_STEP, UNSURE
from pirrht.jit.addresses import load_int64
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import LEAD, PARTS, PERIOD, clearance_of_body, disc_of, inexact, of_body, piece_of
from pirrht.moving.spans import BOX, MOMENT, comes_by, keeps_off

STRIDE = 5e-3  # of a march on where nothing is certain [m]
CLOSE = 1e-5  # where distances are closed forms a march may come so close before it is uncertain [m]


@kernel
def certify_leg(traffic, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """FREE, BLOCKED or UNSURE for the straight way from (ax, ay) [m] at s [s] to (bx, by) at t, by all of `Traffic`."""
    return certify_some(traffic, None, traffic.J, ax, ay, s, bx, by, t)


@kernel
def list_passed(traffic, frame, begin, end, listed):  # type: ignore[no-untyped-def]
    """Write to `listed` (J,) which bodies may touch what is in a frame (x, y, X, Y) [m] at times [s]; their number."""
    count = 0
    for j in range(traffic.J):
        boxes, many, own, period = _boxes_of(traffic, j, begin)
        if comes_by(boxes, many, own, period, end - begin, frame, disc_of(traffic, j) + LEAST_STEP):
            listed[count] = j
            count += 1
    return count


@kernel
def certify_some(traffic, listed, count, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """The same by the first so many bodies of a list, or of all where there is none."""
    verdict = FREE
    for k in range(count):
        one = certify_past(traffic, k if listed is None else listed[k], ax, ay, s, bx, by, t)
        if one == BLOCKED:
            return BLOCKED
        if one == UNSURE:
            verdict = UNSURE
    return verdict


@inlined
def _boxes_of(traffic, j, t):  # type: ignore[no-untyped-def]
    """Address and number of the boxes of body j, its own clock's time at t, and when that starts over [s]."""
    first, last = load_int64(traffic.parts, PARTS * j + 4), load_int64(traffic.parts, PARTS * j + 5)
    own, period = t + of_body(traffic, j, LEAD), of_body(traffic, j, PERIOD)
    return traffic.boxes + 8 * BOX * first, last - first, own, period


@kernel
def note_unsure(traffic, ax, ay, s, bx, by, t, out):  # type: ignore[no-untyped-def]
    """Write which bodies the way from (ax, ay) [m] at s [s] to (bx, by) at t does not surely pass to `out` (J,)."""
    for j in range(traffic.J):
        out[j] = certify_past(traffic, j, ax, ay, s, bx, by, t) != FREE


@inlined
def certify_past(traffic, j, ax, ay, s, bx, by, t):  # type: ignore[no-untyped-def]
    """The same for body j alone."""
    per = 1.0 / (t - s) if t > s else 0.0
    ux, uy, now, verdict = (bx - ax) * per, (by - ay) * per, s, FREE
    boxes, count, own, period = _boxes_of(traffic, j, s)
    if keeps_off(boxes, count, own, period, ax, ay, ux, uy, t - s, disc_of(traffic, j) + LEAST_STEP):
        return FREE
    while True:
        ox, oy, yaw, vx, vy, turn, until = piece_of(traffic, j, now)
        x, y, end = ax + (now - s) * ux, ay + (now - s) * uy, min(max(until, now + MOMENT), t)
        begin, leaves = within(x - ox, y - oy, ux - vx, uy - vy, end - now, disc_of(traffic, j) + LEAST_STEP)
        if begin <= leaves:
            pace = math.hypot(ux - vx, uy - vy) + abs(turn) * disc_of(traffic, j)
            one = _marched(traffic, j, ox, oy, yaw, vx, vy, turn, x, y, ux, uy, begin, leaves, pace)
            if one == BLOCKED:
                return BLOCKED
            if one == UNSURE:
                verdict = UNSURE
        if end >= t:
            return verdict
        now = end


@inlined
def within(x, y, vx, vy, duration, radius):  # type: ignore[no-untyped-def]
    """From when to when, of a duration [s], what is at (x, y) [m] and moves at (vx, vy) [m/s] is inside a circle.

    The circle is around the origin, `radius` in [m]; the second time is before the first if it never is.
    """
    gap, along, square = x * x + y * y - radius * radius, x * vx + y * vy, vx * vx + vy * vy
    if gap > 0.0 and (along >= 0.0 or along * along < square * gap):
        return 1.0, 0.0
    if square == 0.0:
        return 0.0, duration
    root = math.sqrt(max(along * along - square * gap, 0.0))
    return max((-along - root) / square, 0.0), min((-along + root) / square, duration)


@kernel
def _marched(traffic, j, ox, oy, yaw, vx, vy, turn, x, y, ux, uy, now, end, pace):  # type: ignore[no-untyped-def]
    """FREE, BLOCKED or UNSURE from a time to another, of a piece of the motion of body j and one of a way.

    Args:
        traffic, j: the body's.
        ox, oy, yaw, vx, vy, turn: its pose at time 0 [m, m, rad] and the rates of it [1/s].
        x, y, ux, uy: the way at time 0 [m] and its velocity [m/s].
        now, end: the times [s].
        pace: by which clearances change at most [m/s].
    """
    error, least, verdict = 0.0, CLOSE, FREE
    if inexact(traffic, j):
        error, least = traffic.pitch, LEAST_STEP
    while True:
        px, py, qx, qy = ox + now * vx, oy + now * vy, x + now * ux, y + now * uy
        c = clearance_of_body(traffic, j, px, py, yaw + now * turn, qx, qy) - error
        if c < least:
            if c <= -2.0 * error:
                return BLOCKED
            verdict, c = UNSURE, STRIDE
        if now >= end:
            return verdict
        now = min(now + c / pace, end) if pace > 0.0 else end
