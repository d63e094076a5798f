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
def _beside(place, s, dx, dy):  # type: ignore[no-untyped-def]
    """Place (dx, dy) from the point of cross-section s, along it, in nodes."""
    k = PLACE * s
    left = dy * load_float32(place, k + 2) - dx * load_float32(place, k + 3)
    return (left - load_float32(place, k + 4)) * load_float32(place, k + 5)


@inlined
def _at_nodes(slope, s, J, node):  # type: ignore[no-untyped-def]
    """Interpolate cross-section s, `node` nodes from its first one."""
    node = min(max(node, ZERO), np.float32(J - 1))
    j = min(np.int64(node), J - 2)
    share, k = node - np.float32(j), KNOWN * (s * J + j)
    rest = ONE - share
    gx = load_float32(slope, k) * rest + load_float32(slope, k + 4) * share
    gy = load_float32(slope, k + 1) * rest + load_float32(slope, k + 5) * share
    left = load_float32(slope, k + 2) * rest + load_float32(slope, k + 6) * share
    return gx, gy, left, load_float32(slope, k + 3) * rest + load_float32(slope, k + 7) * share


@inlined
def push_of(c, reach):  # type: ignore[no-untyped-def]
    """1 / (b (exp(c/b) - 1)) to third order [1/m]: slope of log psi at a distance c from a wall of reach b.

    There psi goes like 1 - exp(-c/b).
    """
    s = c / (reach + np.float32(1e-9))
    third, fourth = np.float32(1.0 / 6.0), np.float32(1.0 / 24.0)
    return ONE / (c * (ONE + s * (HALF + s * (third + s * fourth))))


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
def uphill(place, slope, last, J, decay, goal, s, x, y, walls):  # type: ignore[no-untyped-def]
    """Return the cross-section that (x, y) [m] has passed, the s-th or one near it, and grad log psi there [1/m].

    Args: addresses of a way's `place` and `slope`, number of its last cross-section, J, k [1/m], the goal's
        centre [m], s, (x, y) [m], `two_walls` there, none closer than they may push. Single precision suffices.
    """
    x, y = np.float32(x), np.float32(y)
    k = PLACE * s
    dx, dy = x - load_float32(place, k), y - load_float32(place, k + 1)
    past = dx * load_float32(place, k + 2) + dy * load_float32(place, k + 3)
    if past < ZERO and s > 0:
        s -= 1
        k -= PLACE
        dx, dy = x - load_float32(place, k), y - load_float32(place, k + 1)
        past = dx * load_float32(place, k + 2) + dy * load_float32(place, k + 3)
    for _ in range(TUNING.sections):
        if s == last:
            break
        k = PLACE * (s + 1)
        ex, ey = x - load_float32(place, k), y - load_float32(place, k + 1)
        tx, ty = load_float32(place, k + 2), load_float32(place, k + 3)
        ahead = -ex * tx - ey * ty
        if ahead > ZERO:
            share = min(max(past / (past + ahead + np.float32(1e-9)), ZERO), ONE)
            ax, ay, al, ar = _at_nodes(slope, s, J, _beside(place, s, dx, dy))
            bx, by, bl, br = _at_nodes(slope, s + 1, J, _beside(place, s + 1, ex, ey))
            gx, gy = ax + share * (bx - ax), ay + share * (by - ay)
            gx, gy = _with_walls(gx, gy, al + share * (bl - al), ar + share * (br - ar), tx, ty, walls)
            return s, gx, gy
        s, dx, dy, past = s + 1, ex, ey, -ahead
    dx, dy = np.float32(goal[0]) - x, np.float32(goal[1]) - y
    per = ONE / math.sqrt(dx * dx + dy * dy + np.float32(1e-9))
    rate, reach = (np.float32(decay) + HALF * per) * per, np.float32(TUNING.wall_reach / decay)
    gx, gy = _with_walls(rate * dx, rate * dy, reach, reach, dx, dy, walls)
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
