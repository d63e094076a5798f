"""psi on one cross-section of a way from what it is on the next, for all nodes abreast.

The loop over the nodes of one cross-section has no branches, and is in single precision: it compiles to vector
instructions. log psi is relative to its greatest value on the next cross-section.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.float32 import HALF, ONE, TWO, ZERO, exponential
from pirrht.compiled.jit import inlined, kernel
from pirrht.compiled.streams import logarithm

# Rows of the nodes of a cross-section: place, distances to the walls on both sides, what is found there.
AHEAD_X, AHEAD_Y, LEFT, RIGHT, LOG_PSI, SLOPE_X, SLOPE_Y, PUSH_LEFT, PUSH_RIGHT, TOP, WHOLE = range(11)
ROWS = 11
OPEN = np.float32(1e9)  # distance to a wall that is not there [m]
NEGLIGIBLE = np.float32(-25.0)  # nodes with so little psi are passed over [nats]
NOTHING, TINY = np.float32(-1e30), np.float32(1e-6)
GRAZING = np.float32(0.02)  # cosines of lines that graze a cross-section are not looked at
FOUR, THREE_QUARTERS, THREE_HALVES = np.float32(4.0), np.float32(0.75), np.float32(1.5)
ABOVE, BELOW = np.float32(0.556), np.float32(0.655)
PER_TURN = np.float32(0.5 / math.pi)


@inlined
def bend(z):  # type: ignore[no-untyped-def]
    """K1(z)^2 2 z exp(2 z) / pi, by which it differs from its limit for great z, less one; within 2 %."""
    return THREE_QUARTERS * (z + ABOVE) / (z * (z + BELOW))


@inlined
def fall(k, per, bent):  # type: ignore[no-untyped-def]
    """How fast the logarithm of K1(k r) / r falls with r [1/m]; per: 1/r, bent: `bend` there."""
    return k + (THREE_HALVES + HALF * bent / (ONE + bent)) * per


@inlined
def wall(k, r, per, bent, steep, c, d):  # type: ignore[no-untyped-def]
    """What a flat wall at distances c and d of both ends of a line of length r leaves: a share f of what passes.

    The wall takes off what would come from the mirror image, which is farther away; `steep` is `fall` at r.
    Returns: f, how fast log f grows with c [1/m], and how fast it falls with r [1/m].
    """
    square = FOUR * c * d
    far = math.sqrt(r * r + square)
    other, ratio, beyond = bend(k * far), r / far, ONE / far
    image = exponential(-k * square / (far + r)) * math.sqrt((ONE + other) / (ONE + bent) * ratio) * ratio
    left = max(ONE - image, TINY)
    odds, down = image / left, fall(k, beyond, other)
    return left, odds * down * TWO * d * beyond, max(odds * (steep - down * ratio), ZERO)


@kernel
def look(k, line, step, known, node):  # type: ignore[no-untyped-def]
    """Fill the rows of `node` (ROWS, J + 1) from those of the next cross-section, `known`.

    Args, in order: k [1/m]; point and unit normal of the next cross-section, spacing of its nodes [m]; the rows.
    """
    J, n = known.shape[1] - 1, node.shape[1]
    x, y, left, right = node[AHEAD_X], node[AHEAD_Y], node[LEFT], node[RIGHT]
    psi, gx, gy, one, two = node[LOG_PSI], node[SLOPE_X], node[SLOPE_Y], node[PUSH_LEFT], node[PUSH_RIGHT]
    top, whole = node[TOP], node[WHOLE]
    px, py, tx, ty = np.float32(line[0]), np.float32(line[1]), np.float32(line[2]), np.float32(line[3])
    top[:], whole[:], psi[:], gx[:], gy[:], one[:], two[:] = NOTHING, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for j in range(J):
        ax, ay, level = known[AHEAD_X, j], known[AHEAD_Y, j], known[LOG_PSI, j]
        for i in range(n if level > NEGLIGIBLE else 0):
            dx, dy = ax - x[i], ay - y[i]
            top[i] = max(top[i], level - k * math.sqrt(dx * dx + dy * dy))
    for j in range(J):
        ax, ay, level = known[AHEAD_X, j], known[AHEAD_Y, j], known[LOG_PSI, j]
        c, d = known[LEFT, j], known[RIGHT, j]
        for i in range(n):
            dx, dy = ax - x[i], ay - y[i]
            r = math.sqrt(dx * dx + dy * dy) + TINY
            per, along, ahead = ONE / r, max(dx * tx + dy * ty, TINY), (px - x[i]) * tx + (py - y[i]) * ty
            bent = bend(k * r)
            steep = fall(k, per, bent)
            density = step * math.sqrt(PER_TURN * k * per * (ONE + bent)) * along * per
            density = density if along > GRAZING * r else ZERO
            whole[i] += density * exponential(min(k * (ahead - r), ZERO))
            share_left, push_left, nearer = wall(k, r, per, bent, steep, left[i], c)
            share_right, push_right, too = wall(k, r, per, bent, steep, right[i], d)
            weight = density * exponential(min(level - k * r - top[i], ZERO)) * share_left * share_right
            inward, across = (steep + nearer + too) * per * weight, weight / along
            psi[i] += weight
            gx[i] += inward * dx - across * tx
            gy[i] += inward * dy - across * ty
            one[i] += weight * push_left
            two[i] += weight * push_right
    for i in range(n):
        per = ONE / max(psi[i], np.float32(1e-30))
        gx[i], gy[i], one[i], two[i] = gx[i] * per, gy[i] * per, one[i] * per, two[i] * per
        # Between nodes that noise hardly spreads over, a sum can exceed what reaches the whole line, exp(-k ahead).
        psi[i] = top[i] + logarithm(max(psi[i], np.float32(1e-30))) - logarithm(max(whole[i], ONE))


@kernel
def sight(k, goal, radius, rim_left, rim_right, node):  # type: ignore[no-untyped-def]
    """Fill the rows of `node` where the goal is in sight: psi of its disc in the open, and walls up to its rim.

    Args, in order: k [1/m], centre and radius of the goal's disc [m], distances of the rim to the walls [m], the rows.
    """
    k, radius, most = np.float32(k), np.float32(radius), np.float32(0.5 / k)
    for i in range(node.shape[1]):
        dx, dy = np.float32(goal[0]) - node[AHEAD_X, i], np.float32(goal[1]) - node[AHEAD_Y, i]
        r = max(math.sqrt(dx * dx + dy * dy), radius)
        length = r - radius + most
        bent = bend(k * length)
        steep = fall(k, ONE / length, bent)
        one, push_left, _ = wall(k, length, ONE / length, bent, steep, node[LEFT, i], np.float32(rim_left))
        two, push_right, _ = wall(k, length, ONE / length, bent, steep, node[RIGHT, i], np.float32(rim_right))
        inward = (k + HALF / r) / r
        node[SLOPE_X, i], node[SLOPE_Y, i] = inward * dx, inward * dy
        node[PUSH_LEFT, i], node[PUSH_RIGHT, i] = push_left, push_right
        node[LOG_PSI, i] = HALF * logarithm(radius / r) - k * (r - radius) + logarithm(one) + logarithm(two)
