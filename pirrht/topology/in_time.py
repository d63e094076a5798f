"""Tell classes of paths in space and time: whole turns about the static markers, then about the moving ones.

The integers of static markers are those of the path's places alone. About a moving one an edge adds its own turn, and
the turn of its head's base more than its tail's; the base that arrives earlier waits for the other. That is whole, and
summed along a path it is `MovingHomology.winding`. As edges begin and end at the same states many times while a graph
grows, `BaseCache` keeps the bases of as many states as it has rows; a state whose row is taken is computed anew.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array, IntArray
from pirrht.jit.addresses import load_float64, load_int64
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.spans import BOX, span_at
from pirrht.topology.cuts import straight_turns
from pirrht.topology.homology import Homology, class_id, hash_weights
from pirrht.topology.moving import MovingHomology
from pirrht.topology.tracks import (
    LONG,
    crossing,
    crossings_of_step,
    crossings_of_waiting,
    lane_of,
    place_at,
    turns_of_step,
)

BESIDE = 1e-9  # a marker must be farther than this from a triangle to lie outside of it [m^2]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedHomology:
    """Classes of paths (k, 3) of x, y [m] and t [s] among M - J static and J moving markers."""

    standing: Homology
    moving: MovingHomology

    @property
    def M(self) -> int:
        """Number of all markers, M."""
        return self.standing.M + self.moving.J

    @property
    def named(self) -> None:
        """None: names of classes contain all turns, as with `Homology.named`."""
        return None

    def name(self, winding: Sequence[int]) -> str:
        """The public name of a class (M,)."""
        return class_id(winding)

    @property
    def hash_weights(self) -> IntArray:
        """Odd integers r (M,) such that a class has the additive key sum k_l r_l (mod 2^64)."""
        return hash_weights(self.M)

    def asked(self, x: Array, time: float) -> Array:
        """Return x (n,) at a time [s] as classes take it: place and time, (3,) [m, m, s]."""
        return np.array([x[0], x[1], time])

    def straight(self, points: Array) -> Array:
        """H of the bases from points (k, 3) [m, m, s] until they arrive, (k, M) [turns], without the leading 1.

        About moving markers it is 0 where the time is left open.
        """
        out = np.zeros((len(points), self.M))
        standing, moving = self.standing, self.moving
        for row, point in zip(out, points, strict=True):
            write_straight(standing.markers, moving.tracks, moving.goal, moving.speed, point, row)
        return out

    def winding(self, path: Array) -> tuple[int, ...]:
        """Class, M [turns], of a path (k, 3), completed straight to the goal point, where it then waits."""
        return self.standing.winding(path[:, :2]) + self.moving.winding(path)

    def signature(self, start: Array, winding: Sequence[int]) -> Array:
        """The paper's H = 1 + H(sigma) of a class (M,) seen from start (3,) [m, m, s], (M,) [turns].

        About moving markers, waiting longer than the base takes to arrive does not count.
        """
        value: Array = 1.0 + self.straight(start[None, :3])[0] + np.asarray(winding, dtype=float)
        return value

    def key(self, winding: Sequence[int]) -> int:
        """The additive key of a class (M,), as kernels carry it (a wrapped 64-bit integer)."""
        with np.errstate(over="ignore"):
            return int(np.sum(np.asarray(winding, dtype=np.int64) * self.hash_weights, dtype=np.int64))


@kernel
def write_straight(markers, tracks, goal, speed, x, out):  # type: ignore[no-untyped-def]
    """Write H of the base from x (3,) [m, m, s] to `out` (M,) [turns]: about `markers` (m, 2) [m], then `tracks`."""
    gx, gy, standing = goal[0], goal[1], markers.shape[0]
    for k in range(standing):
        out[k] = straight_turns(x[0], x[1], markers[k, 0], markers[k, 1], gx, gy)
    for j in range(out.shape[0] - standing):
        out[standing + j] = base_turns(tracks, j, gx, gy, speed, x[0], x[1], x[2])


@inlined
def base_turns(tracks, j, gx, gy, speed, x, y, t):  # type: ignore[no-untyped-def]
    """Turn [turns] about marker j of the base at a speed [m/s] from (x, y) [m] at t [s]; 0 without a time."""
    if not t < math.inf:
        return 0.0
    return turns_of_step(tracks, j, x, y, t, gx, gy, t + math.hypot(gx - x, gy - y) / speed)


@kernel
def whole_turns(tracks, j, goal, speed, a, b, to_goal):  # type: ignore[no-untyped-def]
    """Whole turns that a straight edge in space and time adds about moving marker j to the class of its head.

    Seen from the marker the edge, the base of its head and the base of its tail backwards are closed: that winds as
    often as it crosses one ray. Args: `MarkerTrajectories`, j, goal (2) [m], base speed [m/s], tail, head, or where it
    enters the goal's disc, (3) each [m, m, s], and whether it ends there and goes on straight to the goal point.
    """
    gx, gy = goal
    (ax, ay, s), (bx, by, t) = a, b
    late = t if to_goal else t + math.hypot(gx - bx, gy - by) / speed
    if beside(tracks, j, ax, ay, bx, by, gx, gy, s, max(s + math.hypot(gx - ax, gy - ay) / speed, late)):
        return 0
    fx, fy = seen_from(tracks, j, ax, ay, s)
    lx, ly = seen_from(tracks, j, bx, by, t)
    base = crossings_of_base(tracks, j, goal, speed, ax, ay, s, fx, fy)
    if to_goal:
        head = crossings_at_goal(tracks, j, goal, t, lx, ly)
    else:
        head = crossings_of_base(tracks, j, goal, speed, bx, by, t, lx, ly)
    return crossings_of_step(tracks, j, ax, ay, s, bx, by, t, fx, fy, lx, ly) + head - base


@inlined
def seen_from(tracks, j, x, y, t):  # type: ignore[no-untyped-def]
    """Relative position of (x, y) [m], seen from marker j at t [s], (x, y) [m]."""
    mx, my = place_at(tracks, j, t)
    return x - mx, y - my


@kernel
def crossings_of_base(tracks, j, goal, speed, x, y, t, fx, fy):  # type: ignore[no-untyped-def]
    """Crossings of the ray of marker j by the base from (x, y) [m] at t [s], less those of waiting at its end forever.

    Goal point (2) [m], speed of bases [m/s]; (fx, fy) is where the marker sees it first [m].
    """
    gx, gy = goal
    arrives = t + math.hypot(gx - x, gy - y) / speed
    lx, ly = seen_from(tracks, j, gx, gy, arrives)
    way = crossings_of_step(tracks, j, x, y, t, gx, gy, arrives, fx, fy, lx, ly)
    return way - crossings_of_waiting(tracks, j, gx, gy, arrives, lx, ly)


@kernel
def crossings_at_goal(tracks, j, goal, t, fx, fy):  # type: ignore[no-untyped-def]
    """Crossings from (fx, fy) [m] to the goal point (2) [m] at t [s] at once, less those of waiting there."""
    gx, gy = goal
    lx, ly = seen_from(tracks, j, gx, gy, t)
    return crossing(fx, fy, lx, ly) - crossings_of_waiting(tracks, j, gx, gy, t, lx, ly)


@kernel
def beside(tracks, j, ax, ay, bx, by, gx, gy, s, t):  # type: ignore[no-untyped-def]
    """Tell whether moving marker j is surely beyond one side of the triangle a, b, g [m] from s to t [s].

    Paths inside the triangle that come back have then turned about it by nothing.
    """
    first = _far_side(ax, ay, bx, by, gx, gy)
    second, third = _far_side(bx, by, gx, gy, ax, ay), _far_side(gx, gy, ax, ay, bx, by)
    begin, _, period = lane_of(tracks, j)
    box, last = load_int64(tracks.first_box, j), load_int64(tracks.first_box, j + 1)
    now, one, two, three = s, True, True, True
    while one or two or three:
        i, left = span_at(now - load_float64(tracks.time, begin), period, last - box, LONG)
        at = tracks.boxes + 8 * BOX * (box + i)
        one, two, three = one and _beyond(first, at), two and _beyond(second, at), three and _beyond(third, at)
        now += left
        if now > t:
            return one or two or three
    return False


@inlined
def _far_side(ux, uy, vx, vy, wx, wy):  # type: ignore[no-untyped-def]
    """Line through u and v [m] as numbers a, b, c: a x + b y - c [m^2] is positive where w [m] is not."""
    nx, ny = uy - vy, vx - ux
    if nx * (wx - ux) + ny * (wy - uy) > 0.0:
        nx, ny = -nx, -ny
    return nx, ny, nx * ux + ny * uy


@inlined
def _beyond(line, box):  # type: ignore[no-untyped-def]
    """Tell whether all of a box, at its address, is where a line's number (`_far_side`) is positive beyond rounding."""
    a, b, c = line
    x, y = load_float64(box, 0 if a > 0.0 else 2), load_float64(box, 1 if b > 0.0 else 3)
    return a * x + b * y - c > BESIDE


ROWS = 8192  # of a tree that grows
SPREAD = (7919.3, 104729.7, 1299709.1)  # by which states are spread over rows


class BaseCache(NamedTuple):
    """Bases of states (R,) as they are seen from J markers that move; without rows nothing is kept."""

    state: Array  # (R, 3) x, y [m], t [s]; not a number where none is kept
    seen: Array  # (R, J, 2) where the state is seen [m]
    crossings: NDArray[np.int64]  # (R, J) as `in_time.crossings_of_base` has them

    @classmethod
    def room(cls, J: int, rows: int = ROWS) -> BaseCache:
        """Allocate bases of so many states, none of which is known."""
        return cls(np.full((rows, 3), np.nan), np.empty((rows, J, 2)), np.empty((rows, J), np.int64))


@kernel
def row_of(bases, tracks, goal, speed, x, y, t, keep):  # type: ignore[no-untyped-def]
    """Find the row of the base from (x, y) [m] at t [s], written unless it is known; not row `keep`.

    Tracks, goal and speed are as of `whole_turns`.
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
    """`whole_turns` about marker j of the edge between the states of two rows."""
    a, b = bases.state[one], bases.state[two]
    (fx, fy), (lx, ly) = bases.seen[one, j], bases.seen[two, j]
    own = crossings_of_step(tracks, j, a[0], a[1], a[2], b[0], b[1], b[2], fx, fy, lx, ly)
    return own + bases.crossings[two, j] - bases.crossings[one, j]
