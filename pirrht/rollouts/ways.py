"""Climb the desirability of a way: the proposal control of a sample that follows a reference.

A way is a reference with cross-sections; nodes on them know the slope of log psi of its class (`guidance.ways`) and the
lengths over which psi falls to zero towards the walls on both sides. Between nodes and cross-sections these are
interpolated; behind the last one psi is that of a disc in the open.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.jit.addresses import load_float32
from pirrht.jit.float32 import HALF, ONE, ZERO
from pirrht.jit.jit import inlined, kernel

PLACE, KNOWN = 6, 4  # numbers of a cross-section, and of a node
REACH = 1.0  # of a wall next to the goal, in decay lengths 1/k
SIXTH, LATER = np.float32(1.0 / 6.0), np.float32(1.0 / 24.0)
TINY = np.float32(1e-9)


class DesirabilityTubes(NamedTuple):
    """Ways of H references, of at most C cross-sections with J nodes each, as plain arrays for kernels.

    A cross-section is a point on the reference, the unit normal in the direction of travel, the offset to the left of
    the first node and the number of nodes per meter.
    """

    count: NDArray[np.int64]  # type: ignore[assignment]  # (H,) cross-sections, the first at the start; 0: no way
    place: NDArray[np.float32]  # (H, C, 6) [m], 1, [m], [1/m]
    slope: NDArray[np.float32]  # (H, C, J, 4) at the nodes grad log psi without the walls' part [1/m], and the reach of
    # the walls to the left and to the right, as `push_of` takes it [m]
    decay: float  # k, of psi per meter in the open [1/m]


def no_ways(H: int, C: int, J: int, decay: float) -> DesirabilityTubes:
    """Allocate H ways of at most C cross-sections with J nodes, (H, C, 6) and (H, C, J, 4); none yet."""
    place, slope = np.zeros((H, C, PLACE), np.float32), np.zeros((H, C, J, KNOWN), np.float32)
    return DesirabilityTubes(np.zeros(H, np.int64), place, slope, decay)


@inlined
def push_of(c, reach):  # type: ignore[no-untyped-def]
    """1 / (b (exp(c/b) - 1)) to third order [1/m]: slope of log psi at a distance c from a wall of reach b.

    There psi goes like 1 - exp(-c/b).
    """
    s = c / (reach + TINY)
    return ONE / (c * (ONE + s * (HALF + s * (SIXTH + s * LATER))))


@inlined
def _with_walls(gx, gy, left, right, tx, ty, walls):  # type: ignore[no-untyped-def]
    """Add the push of walls that reach as far as the ones to the `left` and `right` of (tx, ty) do [m]."""
    c, nx, ny, d, mx, my = walls
    first, second = nx * ty - ny * tx > ZERO, mx * ty - my * tx > ZERO  # whether they stand to the left
    near = left if first else right
    far = ZERO if first == second else (left if second else right)
    one, other = push_of(c, near), push_of(d, far)
    return gx + one * nx + other * mx, gy + one * ny + other * my


@inlined
def past_of(place, s, x, y):  # type: ignore[no-untyped-def]
    """Return how far (x, y) [m] has passed cross-section s, to its left and in its nodes [m, m, 1]."""
    k = PLACE * s
    dx, dy = x - load_float32(place, k), y - load_float32(place, k + 1)
    tx, ty = load_float32(place, k + 2), load_float32(place, k + 3)
    return dx * tx + dy * ty, (dy * tx - dx * ty - load_float32(place, k + 4)) * load_float32(place, k + 5)


@inlined
def stage_at(place, last, s, x, y):  # type: ignore[no-untyped-def]
    """Find the last cross-section that (x, y) [m] has passed, from the s-th on, or the one before it.

    Returns its number, how far it is passed and how far the next one is ahead [m], and nodes on both.
    """
    past, node = past_of(place, s, x, y)
    if past < ZERO and s > 0:
        s -= 1
        past, node = past_of(place, s, x, y)
    ahead, following = ONE, ZERO
    while s < last:
        passed, following = past_of(place, s + 1, x, y)
        ahead = -passed
        if ahead > ZERO:
            break
        s, past, node = s + 1, passed, following
    return s, past, ahead, node, following


@inlined
def node_at(node, J):  # type: ignore[no-untyped-def]
    """Return the node before a place in nodes, and the share of the way to the next one."""
    node = min(max(node, ZERO), np.float32(J - 1))
    j = min(np.int64(node), J - 2)
    return j, node - np.float32(j)


@inlined
def between(one, other, share):  # type: ignore[no-untyped-def]
    """Interpolate linearly."""
    return one * (ONE - share) + other * share


@inlined
def slope_between(values, shares, end, decay, goal, tangent, x, y, walls):  # type: ignore[no-untyped-def]
    """Interpolate grad log psi [1/m] between four nodes, without branches; behind the last cross-section (`end`): of a disc.

    Args: (4, 4) numbers of the nodes; share along the way and along both cross-sections; decay k [1/m]; goal's centre [m];
        direction of travel; place [m]; walls as of `uphill`.
    """
    along, one, other = shares
    gx, gy, left, right = (
        between(between(values[0][0], values[1][0], one), between(values[2][0], values[3][0], other), along),
        between(between(values[0][1], values[1][1], one), between(values[2][1], values[3][1], other), along),
        between(between(values[0][2], values[1][2], one), between(values[2][2], values[3][2], other), along),
        between(between(values[0][3], values[1][3], one), between(values[2][3], values[3][3], other), along),
    )
    ox, oy = np.float32(goal[0]) - x, np.float32(goal[1]) - y
    per = ONE / math.sqrt(ox * ox + oy * oy + TINY)
    rate, reach = (np.float32(decay) + HALF * per) * per, np.float32(REACH / decay)
    tx, ty = ox if end else tangent[0], oy if end else tangent[1]
    gx, gy = rate * ox if end else gx, rate * oy if end else gy
    return _with_walls(gx, gy, reach if end else left, reach if end else right, tx, ty, walls)


@inlined
def corner(slope, s, j, J):  # type: ignore[no-untyped-def]
    """Load the numbers of a node."""
    k = KNOWN * (s * J + j)
    return load_float32(slope, k), load_float32(slope, k + 1), load_float32(slope, k + 2), load_float32(slope, k + 3)


@inlined
def uphill(place, slope, last, J, decay, goal, s, x, y, walls):  # type: ignore[no-untyped-def]
    """Return the cross-section that (x, y) [m] has passed, the s-th or one near it, and grad log psi there [1/m].

    Args: addresses of a way's `place` and `slope`, number of its last cross-section, J, k [1/m], the goal's
        centre [m], s, (x, y) [m], `two_walls` there, none closer than they may push. Single precision suffices.
    """
    x, y = np.float32(x), np.float32(y)
    s, past, ahead, node, following = stage_at(place, last, s, x, y)
    more = min(s + 1, last)
    share = min(max(past / (past + ahead + TINY), ZERO), ONE)
    (i, one), (j, other) = node_at(node, J), node_at(following, J)
    values = corner(slope, s, i, J), corner(slope, s, i + 1, J), corner(slope, more, j, J), corner(slope, more, j + 1, J)
    tangent = load_float32(place, PLACE * more + 2), load_float32(place, PLACE * more + 3)
    gx, gy = slope_between(values, (share, one, other), s == last, decay, goal, tangent, x, y, walls)
    return s, gx, gy


@kernel
def slope_along(ways, g, goal, x, y, walls, out):  # type: ignore[no-untyped-def]
    """Write grad log psi [1/m] at (x, y) [m] on way g to out (2,); goal's centre [m] and walls as of `uphill`."""
    _, C, J, _ = ways.slope.shape
    place, slope = ways.place.ctypes.data + 4 * PLACE * g * C, ways.slope.ctypes.data + 4 * KNOWN * g * C * J
    stage, before = 0, -1
    while stage > before:
        before = stage
        stage, out[0], out[1] = uphill(place, slope, ways.count[g] - 1, J, ways.decay, goal, before, x, y, walls)
