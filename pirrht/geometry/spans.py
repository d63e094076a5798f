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
    edges = span * np.arange(max(1, math.ceil(rows[-1, 0] / span)) + 1)
    times = np.union1d(edges, rows[:, 0])
    places = np.column_stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2)])
    at = np.searchsorted(times, edges)
    low, high = (extreme(extreme.reduceat(places, at[:-1]), places[at[1:]]) for extreme in (np.minimum, np.maximum))
    boxes = np.hstack([low, high])
    return boxes if repeat else np.vstack([boxes, np.tile(rows[-1, 1:3], 2)])


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
