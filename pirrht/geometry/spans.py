"""Bound moving obstacles within spans of time by boxes, which rule far ones out without their rows."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.tuning import TUNING
from pirrht.jit.jit import inlined, kernel, load_float64

BOX = 4  # numbers of a box: least x and y, greatest x and y [m]
SPAN = TUNING.span


def boxes_of(rows: Array, *, repeat: bool, span: float = SPAN) -> Array:
    """Return boxes (k, BOX) [m] of the places of a motion with rows (n, 3 or more) of t, x, y, span by span from 0 on.

    The first is right for earlier times as well. If the motion does not start over, the last is where it stays.
    """
    count = max(1, math.ceil(rows[-1, 0] / span))
    boxes = np.empty((count + (not repeat), BOX))
    _write_boxes(rows, span, count, boxes)
    if not repeat:
        boxes[-1, :2] = boxes[-1, 2:] = rows[-1, 1:3]
    return boxes


@kernel
def _write_boxes(rows, span, count, out):  # type: ignore[no-untyped-def]
    """Write so many boxes of `boxes_of` to `out` (k, BOX) [m]."""
    i = 0
    for k in range(count):
        low, high = k * span, (k + 1) * span
        ax, ay = _place(rows, i, low)
        while i < rows.shape[0] and rows[i, 0] <= low:
            i += 1
        first = i
        while i < rows.shape[0] and rows[i, 0] < high:
            i += 1
        bx, by = _place(rows, i, high)
        x0, y0, x1, y1 = min(ax, bx), min(ay, by), max(ax, bx), max(ay, by)
        for j in range(first, i):
            x0, x1 = min(x0, rows[j, 1]), max(x1, rows[j, 1])
            y0, y1 = min(y0, rows[j, 2]), max(y1, rows[j, 2])
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = x0, y0, x1, y1


@inlined
def _place(rows, i, t):  # type: ignore[no-untyped-def]
    """Return the place (x, y) [m] of a motion at t [s], if no row before i comes after that."""
    while i < rows.shape[0] and rows[i, 0] <= t:
        i += 1
    if i == 0 or i == rows.shape[0]:
        j = max(i - 1, 0)
        return rows[j, 1], rows[j, 2]
    share = (t - rows[i - 1, 0]) / (rows[i, 0] - rows[i - 1, 0])
    a, b = rows[i - 1, 1], rows[i - 1, 2]
    return a + share * (rows[i, 1] - a), b + share * (rows[i, 2] - b)


@inlined
def span_at(own, period, count, span):  # type: ignore[no-untyped-def]
    """Return which of so many boxes, of a span [s] each, holds at a time of an obstacle's clock, and how long [s].

    `period` [s] is after which the clock starts over; 0: never.
    """
    if period > 0.0 and own > 0.0:
        own -= math.floor(own / period) * period
    i = min(max(int(own / span), 0), count - 1)
    left = (i + 1) * span - own
    if period > 0.0:
        left = min(left, period - own)
    elif i == count - 1:
        left = math.inf
    return i, max(left, TUNING.moment)


@kernel
def keeps_off(boxes, count, own, period, way, duration, radius):  # type: ignore[no-untyped-def]
    """Return whether boxes certify that a straight step stays farther than a radius [m] from an obstacle's origin.

    Args:
        boxes: address of its boxes.
        count: their number.
        own: time on its clock when the way begins [s].
        period: after which the clock starts over [s]; 0: never.
        way: where it begins and its velocity, (x, y, ux, uy) [m, m/s].
        duration: of the way [s].
        radius: of the disc that it stays out of [m].
    """
    (x, y, ux, uy), past = way, 0.0
    while True:
        i, left = span_at(own + past, period, count, SPAN)
        until = min(past + left, duration)
        ax, ay, bx, by = x + past * ux, y + past * uy, x + until * ux, y + until * uy
        low_x, low_y = load_float64(boxes, BOX * i) - radius, load_float64(boxes, BOX * i + 1) - radius
        high_x, high_y = load_float64(boxes, BOX * i + 2) + radius, load_float64(boxes, BOX * i + 3) + radius
        if min(ax, bx) < high_x and max(ax, bx) > low_x and min(ay, by) < high_y and max(ay, by) > low_y:
            return False
        if until >= duration:
            return True
        past = until
