"""Which bodies that move may be near a path, known for as long as what moves and the path cannot have come nearer."""

from __future__ import annotations

import math

import numpy as np

from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import FASTEST, of_body, outside_of, piece_of, restart_of

ROUNDING = 1e-9  # of clearances that are known from before [m]
HELD = 5  # numbers of a list: distance within which all are on it, where and when that was known, until when it serves
SEEN = 5  # and of each body, after these: a clearance at least [m], where, when, and until when that tells anything [s]


@inlined
def surely(held, speed, x, y, t):  # type: ignore[no-untyped-def]
    """A lower bound of the clearance of (x, y) [m] at t [s] from all bodies that are not listed [m]."""
    if not t < held[4]:
        return -math.inf
    away = math.sqrt((x - held[1]) * (x - held[1]) + (y - held[2]) * (y - held[2]))
    return held[0] - away - speed * abs(t - held[3])


@inlined
def forget(held):  # type: ignore[no-untyped-def]
    """A list is no use any more, nor is what is known of any body: another path begins."""
    held[4] = -math.inf
    for k in range(HELD + SEEN - 1, held.shape[0], SEEN):
        held[k] = -math.inf


@inlined
def held_of(bodies):  # type: ignore[no-untyped-def]
    """Room for what is known of so many bodies; nothing is."""
    held = np.zeros(HELD + SEEN * bodies)
    forget(held)
    return held


@inlined
def far_from(traffic, j, held, x, y, t, within):  # type: ignore[no-untyped-def]
    """Whether by what is known of body j it is surely farther than `within` from (x, y) [m] at t [s]."""
    at = HELD + SEEN * j
    room = held[at] - within - of_body(traffic, j, FASTEST) * abs(t - held[at + 3]) - ROUNDING
    dx, dy = x - held[at + 1], y - held[at + 2]
    return room > 0.0 and dx * dx + dy * dy < room * room


@kernel
def listing(traffic, x, y, t, within, held, listed):  # type: ignore[no-untyped-def]
    """List bodies that may be so near (x, y) [m] at t [s]: numbers to `listed` (J,); returns how many.

    Those that surely are not, by what `held` knows of them from before, are not asked where they are.
    """
    count, until = 0, math.inf
    for j in range(traffic.J):
        at, ends = HELD + SEEN * j, restart_of(traffic, j, t)
        until = min(until, ends)
        if held[at + 3] <= t < held[at + 4] and far_from(traffic, j, held, x, y, t, within):
            continue
        ox, oy, _, _, _, _, _ = piece_of(traffic, j, t)
        d = outside_of(traffic, j, ox, oy, x, y)
        held[at], held[at + 1], held[at + 2], held[at + 3], held[at + 4] = d, x, y, t, ends
        if d < within:
            listed[count] = j
            count += 1
    held[0], held[1], held[2], held[3], held[4] = within, x, y, t, until
    return count
