"""Where a body that moves is within spans of time, as boxes: what rules far ones out without a look at their rows."""

from __future__ import annotations

import math

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.addresses import load_float64
from pirrht.compiled.jit import inlined, kernel

SPAN = 0.5  # of a body's own clock, where it is asked whether it is near [s]
BOX = 4  # numbers of a box: least x and y, greatest x and y [m]
MOMENT = 1e-9  # least time by which a walk from span to span advances [s]


def boxes_of(rows: Array, *, repeat: bool, span: float = SPAN) -> Array:
    """Boxes (k, BOX) [m] of the places of a motion with rows (n, 3 or more) of t, x, y, span by span from 0 on.

    The first is right for earlier times as well. If the motion does not start over, the last is where it stays.
    """
    count = max(1, math.ceil(rows[-1, 0] / span))
    edges = span * np.arange(count + 1)
    times = np.union1d(edges, rows[:, 0])
    places = np.column_stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2)])
    first = np.searchsorted(times, edges)
    low, high = (reduce(reduce.reduceat(places, first[:-1]), places[first[1:]]) for reduce in (np.minimum, np.maximum))
    boxes = np.hstack([low, high])
    return boxes if repeat else np.vstack([boxes, np.tile(rows[-1, 1:3], 2)])


@inlined
def span_at(own, period, count, span):  # type: ignore[no-untyped-def]
    """Which of so many boxes, of a span [s] each, holds at a time of a body's clock [s], and for how much longer [s].

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
    return i, max(left, MOMENT)


@kernel
def comes_by(boxes, count, own, period, duration, frame, radius):  # type: ignore[no-untyped-def]
    """Whether the origin of a body may come within a radius of a frame (x, y, X, Y) [m] during a time [s].

    The others are as `keeps_off` takes them.
    """
    past = 0.0
    while True:
        i, left = span_at(own + past, period, count, SPAN)
        across = (
            load_float64(boxes, BOX * i) < frame[2] + radius and load_float64(boxes, BOX * i + 2) > frame[0] - radius
        )
        if across and (
            load_float64(boxes, BOX * i + 1) < frame[3] + radius
            and load_float64(boxes, BOX * i + 3) > frame[1] - radius
        ):
            return True
        past += left
        if past >= duration:
            return False


@kernel
def keeps_off(boxes, count, own, period, x, y, ux, uy, duration, radius):  # type: ignore[no-untyped-def]
    """Whether a straight way surely stays farther than a radius [m] from the origin of a body, whose boxes say so.

    Args:
        boxes: address of its boxes.
        count: their number.
        own: time on its clock when the way begins [s].
        period: after which the clock starts over [s]; 0: never.
        x, y, ux, uy, duration: the way, [m], [m/s] and [s].
        radius: of the disc that it stays out of [m].
    """
    past = 0.0
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
