"""The desirability of a way: log psi of one class along its reference, from cross-section to cross-section.

With constant q, psi solves `Laplace psi = k^2 psi`. What starts at x reaches a straight line that leaves it on one side
with the density `k d / (pi r) K1(k r)`, d the distance to the line and r that to the place on it, about
`sqrt(k / 2 pi r) exp(-k r) cos` far away. So psi on one cross-section of a reference is an integral over the next one, back from
the goal. Walls on both sides take off what would come from their mirror images. In a channel these transfers settle to its slowest mode by themselves,
at its own decay, and behind a corner psi spreads as it is diffracted.

The slope of log psi at the nodes is what samples follow (`rollouts.ways`); towards a wall at a distance c it is known
by the length b of `c / (c + b)`. psi at the start tells in advance how much a class can weigh.
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
from pirrht.rollouts.first_exit import two_walls
from pirrht.rollouts.ways import KNOWN, PLACE

NODES = 24  # of a cross-section
OPEN = 1e9  # distance to a wall that is not there [m]
CERTAIN = 30.0  # exponents beyond this count as infinite
TINY = 1e-12  # shares below this count as so much
GRAZING = 0.02  # cosines of lines that graze a cross-section are not looked at
CLOSEST = 1e-3  # nearer to a wall psi is taken to vanish like the distance [m]
ASIDE = 0.25  # cosine from which on a wall stands on one side
MOST = 0.999  # log psi grows hardly faster than log c


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
    log_psi = _transfer(arena, cut, decay, np.asarray(x, dtype=float), place, slope)
    return Way(place, slope, decay, arena.goal, float(log_psi))


@inlined
def _bend(z):  # type: ignore[no-untyped-def]
    """K1(z)^2 2 z exp(2 z) / pi, by which it differs from its limit for great z, less one; within 2 %."""
    return 0.75 * (z + 0.556) / (z * (z + 0.655))


@inlined
def _fall(k, r, bend):  # type: ignore[no-untyped-def]
    """How fast the logarithm of K1(k r) / r falls with r [1/m]."""
    return k + (1.5 + 0.5 * bend / (1.0 + bend)) / r


@inlined
def _wall(k, r, bend, fall, c, d):  # type: ignore[no-untyped-def]
    """What a flat wall at distances c and d of both ends of a line of length r leaves: a share f of what passes.

    The wall takes off what would come from the mirror image, which is farther away.
    Returns: f, how fast log f grows with c [1/m], and how fast it falls with r [1/m].
    """
    far = math.sqrt(r * r + 4.0 * c * d)
    if k * (far - r) > CERTAIN:
        return 1.0, 0.0, 0.0
    other, ratio = _bend(k * far), r / far
    image = math.exp(-k * (far - r)) * math.sqrt((1.0 + other) / (1.0 + bend) * ratio) * ratio
    left = 1.0 - image
    if left < TINY:
        return TINY, 1.0 / c, 0.0
    odds, steep = image / left, _fall(k, far, other)
    return left, odds * steep * 2.0 * d / far, odds * (fall - steep * ratio)


@inlined
def _offset(low, step, j):  # type: ignore[no-untyped-def]
    return low + (j + 0.5) * step


@kernel
def _look(k, x, y, left, right, nodes, total, out):  # type: ignore[no-untyped-def]
    """log psi at (x, y), `left` and `right` of it the walls, from what is known at the next cross-section's nodes.

    Args, in order: k; place and distances [m]; per node x, y, distances to the walls, log psi (J, 5) and the normal,
        point and spacing of the cross-section; scratch (J,). To out (4,) go the slope of log psi without the walls'
        part, in x and y, and the push of either wall.
    """
    node, tx, ty, px, py, step = nodes
    J, top = node.shape[0], -math.inf
    for j in range(J):
        total[j] = node[j, 4] - k * math.hypot(node[j, 0] - x, node[j, 1] - y)
        top = max(top, total[j])
    out[:] = 0.0
    ahead = (px - x) * tx + (py - y) * ty
    psi, whole = 0.0, 0.0
    for j in range(J):
        dx, dy = node[j, 0] - x, node[j, 1] - y
        r = math.sqrt(dx * dx + dy * dy) + 1e-12
        along = dx * tx + dy * ty
        if along < GRAZING * r:
            continue
        per, bend = 1.0 / r, _bend(k * r)
        fall = _fall(k, r, bend)
        density = step * math.sqrt(0.5 * k * per / math.pi * (1.0 + bend)) * along * per
        whole += density * math.exp(min(k * (ahead - r), 0.0))
        if total[j] < top - CERTAIN:
            continue
        one, push_left, nearer = _wall(k, r, bend, fall, left, node[j, 2])
        two, push_right, too = _wall(k, r, bend, fall, right, node[j, 3])
        weight = density * math.exp(total[j] - top) * one * two
        inward = fall + nearer + too
        psi += weight
        out[0] += weight * (inward * dx * per - tx / along)
        out[1] += weight * (inward * dy * per - ty / along)
        out[2] += weight * push_left
        out[3] += weight * push_right
    if psi <= 0.0:
        out[:] = 0.0
        return -math.inf
    out /= psi
    # Between nodes that noise hardly spreads over, a sum can exceed what reaches the whole line, exp(-k ahead).
    return top + math.log(psi / max(whole, 1.0))


@kernel
def _sight(k, x, y, left, right, goal, radius, ends, out):  # type: ignore[no-untyped-def]
    """The same where the goal is in sight: psi of its disc in the open, and walls up to its rim, `ends` from it."""
    dx, dy = goal[0] - x, goal[1] - y
    r = math.sqrt(dx * dx + dy * dy)
    if r <= radius:
        out[:] = 0.0
        return 0.0
    length = r - radius + 0.5 / k
    bend = _bend(k * length)
    one, out[2], _ = _wall(k, length, bend, 0.0, left, ends[0])
    two, out[3], _ = _wall(k, length, bend, 0.0, right, ends[1])
    inward = (k + 0.5 / r) / r
    out[0], out[1] = inward * dx, inward * dy
    return 0.5 * math.log(radius / r) - k * (r - radius) + math.log(one * two)


@inlined
def _reach(ux, uy, end, push, walls):  # type: ignore[no-untyped-def]
    """Reach of the wall towards (ux, uy), `end` away that way, whose push there is known: `wall_slope` gives the same.

    The wall's own distance is that of the nearest or the second nearest, if one of them stands there.
    """
    c, nx, ny, d, mx, my = walls
    first, second = -(ux * nx + uy * ny), -(ux * mx + uy * my)
    distance = c if first > ASIDE else (d if second > ASIDE else end)
    share = min(push * end, MOST)
    return distance * share / (1.0 - share)


@kernel
def _transfer(arena, cut, k, start, place, slope):  # type: ignore[no-untyped-def]
    """Fill `Way.place` and `Way.slope` from `Sections`, from the goal back; returns log psi at the start."""
    field, goal, radius = arena.field, arena.goal, arena.radius
    point, ahead, ends, walled = cut
    C, J = slope.shape[0], slope.shape[1]
    node, known, total, out = np.zeros((J, 5)), np.zeros((J, 5)), np.zeros(J), np.zeros(4)
    rim = np.empty(2)
    for side in range(2):
        rim[side] = ends[C, side] if walled[C, side] > 0.0 else OPEN
    at_start = 0.0
    for c in range(C - 1, -1, -1):
        px, py, tx, ty = point[c, 0], point[c, 1], ahead[c, 0], ahead[c, 1]
        low, step = -ends[c, 1], max((ends[c, 0] + ends[c, 1]) / J, 1e-6)
        following = (known, 0.0, 0.0, 0.0, 0.0, 0.0)
        if c < C - 1:
            wide = max((ends[c + 1, 0] + ends[c + 1, 1]) / J, 1e-6)
            following = (known, ahead[c + 1, 0], ahead[c + 1, 1], point[c + 1, 0], point[c + 1, 1], wide)
        for j in range(-1 if c == 0 else 0, J):
            beside = 0.0 if j < 0 else _offset(low, step, j)
            x, y = px - beside * ty, py + beside * tx
            left = ends[c, 0] - beside if walled[c, 0] > 0.0 else OPEN
            right = ends[c, 1] + beside if walled[c, 1] > 0.0 else OPEN
            left, right = max(left, CLOSEST), max(right, CLOSEST)
            if c == C - 1:
                log_psi = _sight(k, x, y, left, right, goal, radius, rim, out)
            else:
                log_psi = _look(k, x, y, left, right, following, total, out)
            if j < 0:
                at_start = log_psi
                continue
            node[j, 0], node[j, 1], node[j, 2], node[j, 3], node[j, 4] = x, y, left, right, log_psi
            walls = two_walls(field, x, y)
            slope[c, j, 0], slope[c, j, 1] = out[0], out[1]
            slope[c, j, 2], slope[c, j, 3] = _reach(-ty, tx, left, out[2], walls), _reach(ty, -tx, right, out[3], walls)
        known[:] = node
        place[c, 0], place[c, 1], place[c, 2], place[c, 3] = px, py, tx, ty
        place[c, 4], place[c, 5] = _offset(low, step, 0), 1.0 / step
    return at_start
