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

from pirrht.jit.jit import inlined, kernel, load_float32, part
from pirrht.jit.streams import HALF, ONE, ZERO
from pirrht.rollouts.tuning import TUNING


class Section(NamedTuple):
    """Columns of a cross-section."""

    x: float  # point on the reference [m]
    y: float
    tx: float  # unit normal in the direction of travel
    ty: float
    first: float  # offset of the first node to the left [m]
    per_meter: float  # nodes per meter [1/m]


class Node(NamedTuple):
    """Columns of a node."""

    gx: float  # grad log psi without the part of the walls [1/m]
    gy: float
    left: float  # reach of the walls to the left and right, as `push_of` takes it [m]
    right: float


PLACE, KNOWN = len(Section._fields), len(Node._fields)
NUMBERS = 7 + 4 * KNOWN  # of `slope_of`


class DesirabilityTubes(NamedTuple):
    """Tubes around H references, of at most C cross-sections with J nodes each, as plain arrays for kernels."""

    count: NDArray[np.int64]  # type: ignore[assignment]  # (H,) cross-sections, the first at the start; 0: no way
    place: NDArray[np.float32]  # (H, C, 6) `Section`
    slope: NDArray[np.float32]  # (H, C, J, 4) `Node`
    decay: float  # k, of psi per meter in the open [1/m]


def no_ways(H: int, C: int, J: int, decay: float) -> DesirabilityTubes:
    """Allocate H ways of at most C cross-sections with J nodes, (H, C, 6) and (H, C, J, 4); none yet."""
    place, slope = np.zeros((H, C, PLACE), np.float32), np.zeros((H, C, J, KNOWN), np.float32)
    return DesirabilityTubes(np.zeros(H, np.int64), place, slope, decay)


@inlined
def push_of(c, offset):  # type: ignore[no-untyped-def]
    """1 / (b (exp(c/b) - 1)) to third order [1/m]: slope of log psi at a distance c from a wall of offset b.

    There psi goes like 1 - exp(-c/b).
    """
    s = c / (offset + np.float32(1e-9))
    third, fourth = np.float32(1.0 / 6.0), np.float32(1.0 / 24.0)
    return ONE / (c * (ONE + s * (HALF + s * (third + s * fourth))))


@inlined
def _passed(place, s, x, y):  # type: ignore[no-untyped-def]
    """Return how far (x, y) [m] has passed cross-section s [m], and its place along it in nodes."""
    k = PLACE * s
    dx, dy = x - load_float32(place, k), y - load_float32(place, k + 1)
    tx, ty = load_float32(place, k + 2), load_float32(place, k + 3)
    return dx * tx + dy * ty, (dy * tx - dx * ty - load_float32(place, k + 4)) * load_float32(place, k + 5)


@inlined
def _node(node, J):  # type: ignore[no-untyped-def]
    """Return the node before a place in nodes, and the share of the distance to the next one."""
    node = min(max(node, ZERO), np.float32(J - 1))
    j = min(np.int64(node), J - 2)
    return j, node - np.float32(j)


@part
def numbers_at(tube, s, x, y, out, at, each):  # type: ignore[no-untyped-def]
    """Write the NUMBERS of `slope_of` at (x, y) [m] to out[at + each * i]; return the cross-section passed.

    Args: addresses of `place` and `slope` of a tube, number of its last cross-section, and J; the one to search from.
    """
    place, slope, last, J = tube
    past, node = _passed(place, s, x, y)
    if past < ZERO and s > 0:
        s -= 1
        past, node = _passed(place, s, x, y)
    ahead, following = ONE, ZERO
    while s < last:
        passed, following = _passed(place, s + 1, x, y)
        ahead = -passed
        if ahead > ZERO:
            break
        s, past, node = s + 1, passed, following
    more = min(s + 1, last)
    (i, one), (j, other) = _node(node, J), _node(following, J)
    out[at], out[at + each], out[at + 2 * each] = past, ahead, ONE if s == last else ZERO
    out[at + 3 * each], out[at + 4 * each] = one, other
    k = PLACE * more + 2
    out[at + 5 * each], out[at + 6 * each] = load_float32(place, k), load_float32(place, k + 1)
    one_at, other_at, at = KNOWN * (s * J + i), KNOWN * (more * J + j), at + 7 * each
    for c in range(2 * KNOWN):
        out[at + c * each] = load_float32(slope, one_at + c)
        out[at + (2 * KNOWN + c) * each] = load_float32(slope, other_at + c)
    return s


@part
def _mixed(f, at, each, shares):  # type: ignore[no-untyped-def]
    """Interpolate a number of four nodes, along two cross-sections and between them."""
    along, one, other = shares
    first = f[at] * (ONE - one) + f[at + KNOWN * each] * one
    second = f[at + 2 * KNOWN * each] * (ONE - other) + f[at + 3 * KNOWN * each] * other
    return first + along * (second - first)


@part
def slope_of(f, at, each, decay, goal, x, y, walls):  # type: ignore[no-untyped-def]
    """Return grad log psi [1/m] at (x, y) [m], without branches, from the numbers f[at + each * i].

    These are the distances past one cross-section and ahead of the next [m], whether the first is the last one, the
    shares of `_node` on both, the direction of travel, and KNOWN numbers of four nodes. Args: k [1/m], the goal's
    centre [m], `two_walls` at (x, y), none closer than they may push. Single precision suffices.
    """
    past, end = f[at], f[at + 2 * each] > ZERO
    share = min(max(past / (past + f[at + each] + np.float32(1e-9)), ZERO), ONE)
    shares, base = (share, f[at + 3 * each], f[at + 4 * each]), at + 7 * each
    gx, gy = _mixed(f, base, each, shares), _mixed(f, base + each, each, shares)
    left, right = _mixed(f, base + 2 * each, each, shares), _mixed(f, base + 3 * each, each, shares)
    dx, dy = np.float32(goal[0]) - x, np.float32(goal[1]) - y
    per = ONE / math.sqrt(dx * dx + dy * dy + np.float32(1e-9))
    rate, reach = (np.float32(decay) + HALF * per) * per, np.float32(TUNING.wall_reach / decay)
    gx, gy = rate * dx if end else gx, rate * dy if end else gy
    tx, ty = dx if end else f[at + 5 * each], dy if end else f[at + 6 * each]
    left, right = reach if end else left, reach if end else right
    c, nx, ny, d, mx, my = walls
    first, second = nx * ty - ny * tx > ZERO, mx * ty - my * tx > ZERO  # whether a wall is to the left
    near, far = left if first else right, ZERO if first == second else (left if second else right)
    one, other = push_of(c, near), push_of(d, far)
    return gx + one * nx + other * mx, gy + one * ny + other * my


@kernel
def slope_along(ways, g, goal, x, y, walls, out):  # type: ignore[no-untyped-def]
    """Write grad log psi [1/m] at (x, y) [m] on way g to out (2,); goal's centre [m] and walls as of `slope_of`."""
    _, C, J, _ = ways.slope.shape
    place, slope = ways.place.ctypes.data + 4 * PLACE * g * C, ways.slope.ctypes.data + 4 * KNOWN * g * C * J
    x, y, numbers, tube = (
        np.float32(x),
        np.float32(y),
        np.empty(NUMBERS, np.float32),
        (place, slope, ways.count[g] - 1, J),
    )
    stage, before = 0, -1
    while stage > before:
        before = stage
        stage = numbers_at(tube, before, x, y, numbers, 0, 1)
    out[0], out[1] = slope_of(numbers, 0, 1, ways.decay, goal, x, y, walls)
