"""The desirability of a way: log psi of one class along its reference, from cross-section to cross-section.

With constant q, psi solves `Laplace psi = k^2 psi`. What starts at x reaches a straight line that leaves it on one side
with the density `k d / (pi r) K1(k r)`, d the distance to the line and r that to the place on it, about
`sqrt(k / 2 pi r) exp(-k r) cos` far away. So psi on one cross-section of a reference is an integral over the next one,
back from the goal. Walls on both sides take off what would come from their mirror images. In a channel these transfers
settle to its slowest mode by themselves, at its own decay, and behind a corner psi spreads as it is diffracted.

The slope of log psi at the nodes is what samples follow (`rollouts.ways`); towards a wall at a distance c it is known
by the length b of `1 - exp(-c / b)`. psi at the start tells in advance how much a class can weigh.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.arena import Arena
from pirrht.guidance.sections import sections_of
from pirrht.guidance.transfer import (  # fmt: skip
    FAR,
    FAR_X,
    FAR_Y,
    LOG_PSI,
    NEAR,
    NEAR_X,
    NEAR_Y,
    PLACE_X,
    PLACE_Y,
    PUSH,
    PUSH_FAR,
    ROWS,
    SLOPE_X,
    SLOPE_Y,
    WIDTH,
    look,
    sight,
)
from pirrht.rollouts.first_exit import two_walls
from pirrht.rollouts.ways import KNOWN, PLACE

NODES = 24  # of a cross-section
CLOSEST = 1e-3  # nearer to a wall psi is taken to vanish like the distance [m]
ASIDE = 0.5  # cosine up to which a wall ahead or behind counts for either side
MOST = 0.999  # log psi grows hardly faster than log c
LITTLE = 1e-3  # and a push of less than this share of 1/c is none
ROUNDS = 4  # of Newton's method


class Way(NamedTuple):
    """What is known of psi along one reference, at J nodes on each of C cross-sections."""

    place: NDArray[np.float32]  # (C, 6) as a row of `Ways.place`
    slope: NDArray[np.float32]  # (C, J, 4) as a row of `Ways.slope`
    decay: float  # k [1/m]
    goal: tuple[float, float]  # centre [m]
    log_psi: float  # of the class at the start [nats]


def way_of(arena: Arena, line: Array, x: Array, decay: float, nodes: int = NODES) -> Way:
    """The way of one reference.

    Args:
        arena: of the world, with the goal's disc.
        line: corners (k, 2) [m] after x, the goal point as the last.
        x: state that the reference starts from, (n,).
        decay: k, of psi per meter [1/m].
        nodes: J.
    """
    cut = sections_of(arena.field, line, x, arena.radius, decay)
    C = len(cut.point)
    place, slope = np.zeros((C, PLACE), np.float32), np.zeros((C, nodes, KNOWN), np.float32)
    log_psi = _transfer(arena, cut, decay, place, slope)
    return Way(place, slope, decay, arena.goal, float(log_psi))


@inlined
def _reach(c, push):  # type: ignore[no-untyped-def]
    """Reach of a wall at a distance c whose push is known, the inverse of `push_of` [m]."""
    share = min(push * c, MOST)
    if share < LITTLE:
        return 0.0
    rest = 1.0 / share - 1.0
    s = min(2.0 * rest, 2.0 + 1.5 * math.sqrt(rest))
    for _ in range(ROUNDS):
        off = s * (0.5 + s * (1.0 / 6.0 + s / 24.0)) - rest
        s -= off / (0.5 + s * (1.0 / 3.0 + s / 8.0))
    return c / s


@kernel
def _to_sides(f, j, tx, ty, out):  # type: ignore[no-untyped-def]
    """Write the reach of the walls to the left and to the right of the direction (tx, ty) at node j to out (2,) [m]."""
    near, far = _reach(f[NEAR + j], f[PUSH + j]), _reach(f[FAR + j], f[PUSH_FAR + j])
    across, other = f[NEAR_X + j] * ty - f[NEAR_Y + j] * tx, f[FAR_X + j] * ty - f[FAR_Y + j] * tx
    out[0], out[1] = (near, 0.0) if across > 0.0 else (0.0, near)
    if (across > 0.0) != (other > 0.0):
        out[1 if across > 0.0 else 0] = far
    elif abs(across) < ASIDE:
        out[0], out[1] = near, near


@kernel
def _lay(field, cut, c, J, step, f):  # type: ignore[no-untyped-def]
    """Write where the J nodes of cross-section c are to rows f, and the point on the reference after the last."""
    point, ahead, ends = cut
    px, py, tx, ty = point[c, 0], point[c, 1], ahead[c, 0], ahead[c, 1]
    for j in range(WIDTH):
        left = (j + 0.5) * step - ends[c, 1] if j < J else 0.0
        x, y = px - left * ty, py + left * tx
        f[PLACE_X + j], f[PLACE_Y + j] = x, y
        near, f[NEAR_X + j], f[NEAR_Y + j], far, f[FAR_X + j], f[FAR_Y + j] = two_walls(field, x, y)
        f[NEAR + j], f[FAR + j] = max(near, CLOSEST), max(far, CLOSEST)


@kernel
def _transfer(arena, cut, k, place, slope):  # type: ignore[no-untyped-def]
    """Fill `Way.place` and `Way.slope` from `Sections`, from the goal back; returns log psi at the start."""
    point, ahead, ends = cut
    C, J = slope.shape[0], slope.shape[1]
    f, known = np.zeros(ROWS, np.float32), np.zeros(ROWS, np.float32)
    base, wide = 0.0, 0.0  # log psi that the rows are relative to; spacing of the nodes on the next cross-section
    for c in range(C - 1, -1, -1):
        tx, ty = ahead[c, 0], ahead[c, 1]
        step = max((ends[c, 0] + ends[c, 1]) / J, 1e-6)
        _lay(arena.field, cut, c, J, step, f)
        if c == C - 1:
            sight(k, arena.goal, arena.radius, f)
        else:
            line = (point[c + 1, 0], point[c + 1, 1], ahead[c + 1, 0], ahead[c + 1, 1])
            look(np.float32(k), line, J, np.float32(wide), known, f)
        wide = step
        for j in range(J):
            slope[c, j, 0], slope[c, j, 1] = f[SLOPE_X + j], f[SLOPE_Y + j]
            _to_sides(f, j, tx, ty, slope[c, j, 2:])
        place[c, 0], place[c, 1], place[c, 2], place[c, 3] = point[c, 0], point[c, 1], tx, ty
        place[c, 4], place[c, 5] = 0.5 * step - ends[c, 1], 1.0 / step
        if c > 0:
            top = f[LOG_PSI]
            for j in range(1, J):
                top = max(top, f[LOG_PSI + j])
            for j in range(J):
                f[LOG_PSI + j] -= top
            base += top
            for row in range(ROWS):
                known[row] = f[row]
    return base + f[LOG_PSI + J]
