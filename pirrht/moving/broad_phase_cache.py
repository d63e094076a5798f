"""List moving obstacles that may be near a path, and keep the list while none can have come nearer."""

from __future__ import annotations

import math

import numpy as np

from pirrht.jit.jit import inlined, kernel
from pirrht.moving.distances import FASTEST, of_body, outside_of, piece_of, restart_of
from pirrht.moving.tuning import CACHED_BODY, CACHED_LIST


@inlined
def surely(held, speed, x, y, t):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance of (x, y) [m] at t [s] from all obstacles that are not on the list [m]."""
    if not t < held[4]:
        return -math.inf
    away = math.sqrt((x - held[1]) * (x - held[1]) + (y - held[2]) * (y - held[2]))
    return held[0] - away - speed * abs(t - held[3])


@inlined
def forget(held):  # type: ignore[no-untyped-def]
    """Forget the list and the clearances of all obstacles: another path begins."""
    held[4] = -math.inf
    for k in range(CACHED_LIST + CACHED_BODY - 1, held.shape[0], CACHED_BODY):
        held[k] = -math.inf


@inlined
def held_of(bodies):  # type: ignore[no-untyped-def]
    """Allocate an empty cache for so many obstacles."""
    held = np.zeros(CACHED_LIST + CACHED_BODY * bodies)
    forget(held)
    return held


@inlined
def far_from(moving, j, held, x, y, t, within):  # type: ignore[no-untyped-def]
    """Return whether the cache certifies that obstacle j is farther than `within` from (x, y) [m] at t [s]."""
    at = CACHED_LIST + CACHED_BODY * j
    free = held[at] - within - of_body(moving, j, FASTEST) * abs(t - held[at + 3]) - 1e-9  # rounding
    dx, dy = x - held[at + 1], y - held[at + 2]
    return free > 0.0 and dx * dx + dy * dy < free * free


@kernel
def listing(moving, x, y, t, within, held, candidates):  # type: ignore[no-untyped-def]
    """List bodies that may be so near (x, y) [m] at t [s]: numbers to `candidates` (J,); return how many.

    Those that surely are not, by earlier clearances in `held`, are not posed.
    """
    count, until = 0, math.inf
    for j in range(moving.J):
        at, ends = CACHED_LIST + CACHED_BODY * j, restart_of(moving, j, t)
        until = min(until, ends)
        if held[at + 3] <= t < held[at + 4] and far_from(moving, j, held, x, y, t, within):
            continue
        ox, oy, _, _, _, _, _ = piece_of(moving, j, t)
        d = outside_of(moving, j, ox, oy, x, y)
        held[at], held[at + 1], held[at + 2], held[at + 3], held[at + 4] = d, x, y, t, ends
        if d < within:
            candidates[count] = j
            count += 1
    held[0], held[1], held[2], held[3], held[4] = within, x, y, t, until
    return count
