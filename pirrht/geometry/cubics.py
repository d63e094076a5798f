"""Follow planar paths of constant jerk, certify them, and find where they enter the goal.

p(s) = p0 + v0 s + c0 s^2 / 2 + c1 s^3 / 6. The acceleration is linear in time, so its magnitude is greatest at an end,
and in a time tau a path gets no farther than |v| tau + |a|max tau^2 / 2. That bound is what certificates march by.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.geometry.arcs import BLOCKED, FREE, LEAST_STEP, UNSURE, refused
from pirrht.geometry.field import clearance
from pirrht.jit.jit import inlined, kernel


class Cubic(NamedTuple):
    """One path of constant jerk, as numbers."""

    x: float  # [m]
    y: float
    vx: float  # [m/s]
    vy: float
    ax: float  # c0 [m/s^2]
    ay: float
    jx: float  # c1 [m/s^3]
    jy: float


@inlined
def place(c, s):  # type: ignore[no-untyped-def]
    """Return the position (x, y) [m] after s [s]."""
    return (
        c.x + s * (c.vx + s * (0.5 * c.ax + s * c.jx / 6.0)),
        c.y + s * (c.vy + s * (0.5 * c.ay + s * c.jy / 6.0)),
    )


@inlined
def speeds(c, s):  # type: ignore[no-untyped-def]
    """Return the velocity (vx, vy) [m/s] after s [s]."""
    return c.vx + s * (c.ax + 0.5 * s * c.jx), c.vy + s * (c.ay + 0.5 * s * c.jy)


@inlined
def _force(c, s):  # type: ignore[no-untyped-def]
    return math.hypot(c.ax + s * c.jx, c.ay + s * c.jy)


@inlined
def stride(c, s, most, free):  # type: ignore[no-untyped-def]
    """Return a time [s] in which the path surely gets no farther than `free` [m] from where it is after s [s].

    `most` is the greatest acceleration ahead [m/s^2].
    """
    vx, vy = speeds(c, s)
    v = math.sqrt(vx * vx + vy * vy)
    return 2.0 * free / max(v + math.sqrt(v * v + 2.0 * most * free), 1e-300)


@kernel
def greatest_force(c, begin, end):  # type: ignore[no-untyped-def]
    """Return the greatest magnitude of the acceleration between two times [s], [m/s^2]."""
    return max(_force(c, begin), _force(c, end))


@kernel
def entry_of_cubic(c, duration, gx, gy, radius):  # type: ignore[no-untyped-def]
    """Return the time [s] at which a path first touches the disc about (gx, gy) of a radius [m], or infinity."""
    most, s = greatest_force(c, 0.0, duration), 0.0
    while True:
        x, y = place(c, s)
        gap = math.hypot(x - gx, y - gy) - radius
        if gap <= 1e-7:  # [m]: rounding of a march to the rim
            return s
        if s >= duration:
            return np.inf
        s = min(s + stride(c, s, most, gap), duration)


@kernel
def certify_cubic(field, c, duration):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a path of a duration [s]: discs of certified clearance must cover it."""
    most, s, verdict = greatest_force(c, 0.0, duration), 0.0, FREE
    while True:
        x, y = place(c, s)
        free = clearance(field, x, y)
        if free < LEAST_STEP:
            if refused(field, x, y) == BLOCKED:
                return BLOCKED
            verdict, free = UNSURE, 0.5 * field.spacing
        if s >= duration:
            return verdict
        s = min(s + stride(c, s, most, free), duration)


def positions(c: Any, s: Any) -> Any:
    """Return positions (l, 2) [m] after times s (l,) [s]."""
    return np.column_stack(place(c, np.asarray(s)))
