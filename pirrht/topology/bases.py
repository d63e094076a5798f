"""Bases of states in space and time, kept: edges begin and end at the same states many times while a graph grows.

What an edge adds to the class of its head is its own crossings of a marker's ray, and what the base of its head
crosses more than that of its tail (`in_time.whole_turns`). Kept are bases of as many states as there are rows; a state
whose row another one has taken is found anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.topology.in_time import crossings_of_base, seen_from
from pirrht.topology.tracks import crossings_of_step

ROWS = 8192  # of a tree that grows
SPREAD = (7919.3, 104729.7, 1299709.1)  # by which states are spread over rows


class Bases(NamedTuple):
    """Bases of states (R,) as they are seen from J markers that move; without rows nothing is kept."""

    state: Array  # (R, 3) x, y [m], t [s]; not a number where none is kept
    seen: Array  # (R, J, 2) where the state is seen [m]
    crossings: NDArray[np.int64]  # (R, J) as `in_time.crossings_of_base` has them

    @classmethod
    def room(cls, J: int, rows: int = ROWS) -> Bases:
        """Room for bases of so many states, none of which is known."""
        return cls(np.full((rows, 3), np.nan), np.empty((rows, J, 2)), np.empty((rows, J), np.int64))


@kernel
def row_of(bases, tracks, goal, speed, x, y, t, keep):  # type: ignore[no-untyped-def]
    """The row of the base from (x, y) [m] at t [s], which is written there unless it is known; not row `keep`.

    The others are as `in_time.whole_turns` takes them.
    """
    R, state = bases.state.shape[0], bases.state
    row = int(abs(x * SPREAD[0] + y * SPREAD[1] + t * SPREAD[2])) % R
    if row == keep:
        row = (row + 1) % R
    if state[row, 0] == x and state[row, 1] == y and state[row, 2] == t:
        return row
    state[row, 0], state[row, 1], state[row, 2] = x, y, t
    for j in range(tracks.J):
        fx, fy = seen_from(tracks, j, x, y, t)
        bases.seen[row, j, 0], bases.seen[row, j, 1] = fx, fy
        bases.crossings[row, j] = crossings_of_base(tracks, j, goal, speed, x, y, t, fx, fy)
    return row


@kernel
def turns_between(bases, tracks, j, one, two):  # type: ignore[no-untyped-def]
    """`in_time.whole_turns` about marker j of the edge between the states of two rows."""
    a, b = bases.state[one], bases.state[two]
    (fx, fy), (lx, ly) = bases.seen[one, j], bases.seen[two, j]
    own = crossings_of_step(tracks, j, a[0], a[1], a[2], b[0], b[1], b[2], fx, fy, lx, ly)
    return own + bases.crossings[two, j] - bases.crossings[one, j]
