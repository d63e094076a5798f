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

WIDTH = 32  # room for the nodes of a cross-section, and the point on the reference after the last of them
# Rows of their numbers: place, the two nearest walls (distance and unit vector away from it), what is found there.
# All are in one array: a compiler that does not know how far apart arrays are cannot tell whether vectors overlap.
PLACE_X, PLACE_Y, NEAR, NEAR_X, NEAR_Y, FAR, FAR_X, FAR_Y, LOG_PSI, SLOPE_X, SLOPE_Y, PUSH, PUSH_FAR, TOP, WHOLE = (
    WIDTH * row for row in range(15)
)
ROWS = 15 * WIDTH
NEGLIGIBLE = np.float32(-25.0)  # nodes with so little psi are passed over [nats]
NOTHING, TINY, LEAST = np.float32(-1e30), np.float32(1e-6), np.float32(1e-30)
GRAZING = np.float32(0.02)  # cosines of lines that graze a cross-section are not looked at
FOUR, THREE_QUARTERS, THREE_HALVES = np.float32(4.0), np.float32(0.75), np.float32(1.5)
ABOVE, BELOW = np.float32(0.556), np.float32(0.655)
PER_TURN = np.float32(0.5 / math.pi)
ALIKE = HALF  # cosine between the directions of one wall at two places


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


@inlined
def beyond(c, nx, ny, dx, dy, near, mx, my, far, ox, oy):  # type: ignore[no-untyped-def]
    """How far a place (dx, dy) from here is from the wall that is c away here in the direction -(nx, ny).

    That is what is known there of its own two walls, if one of them stands alike; else the distance to the wall's
    plane, unless the wall is left behind around a corner.
    """
    plane = c + dx * nx + dy * ny
    one, other = nx * mx + ny * my > ALIKE, nx * ox + ny * oy > ALIKE
    return near if one else (far if other else (plane if plane > ZERO else near))


@kernel
def look(k, line, J, step, known, f):  # type: ignore[no-untyped-def]
    """Fill the rows of f (ROWS,) from those of the next cross-section, `known`.

    Args, in order: k [1/m]; point and unit normal of the next cross-section; number and spacing of its nodes [m]; rows.
    """
    px, py, tx, ty = np.float32(line[0]), np.float32(line[1]), np.float32(line[2]), np.float32(line[3])
    for i in range(WIDTH):
        f[TOP + i], f[WHOLE + i], f[LOG_PSI + i], f[SLOPE_X + i] = NOTHING, ZERO, ZERO, ZERO
        f[SLOPE_Y + i], f[PUSH + i], f[PUSH_FAR + i] = ZERO, ZERO, ZERO
    for j in range(J):
        ax, ay, level = known[PLACE_X + j], known[PLACE_Y + j], known[LOG_PSI + j]
        for i in range(WIDTH if level > NEGLIGIBLE else 0):
            dx, dy = ax - f[PLACE_X + i], ay - f[PLACE_Y + i]
            f[TOP + i] = max(f[TOP + i], level - k * math.sqrt(dx * dx + dy * dy))
    for j in range(J):
        ax, ay, level = known[PLACE_X + j], known[PLACE_Y + j], known[LOG_PSI + j]
        near, mx, my = known[NEAR + j], known[NEAR_X + j], known[NEAR_Y + j]
        far, ox, oy = known[FAR + j], known[FAR_X + j], known[FAR_Y + j]
        for i in range(WIDTH):
            dx, dy = ax - f[PLACE_X + i], ay - f[PLACE_Y + i]
            r = math.sqrt(dx * dx + dy * dy) + TINY
            per, along = ONE / r, max(dx * tx + dy * ty, TINY)
            ahead = (px - f[PLACE_X + i]) * tx + (py - f[PLACE_Y + i]) * ty
            bent = bend(k * r)
            steep = fall(k, per, bent)
            density = step * math.sqrt(PER_TURN * k * per * (ONE + bent)) * along * per
            density = density if along > GRAZING * r else ZERO
            f[WHOLE + i] += density * exponential(min(k * (ahead - r), ZERO))
            c = beyond(f[NEAR + i], f[NEAR_X + i], f[NEAR_Y + i], dx, dy, near, mx, my, far, ox, oy)
            d = beyond(f[FAR + i], f[FAR_X + i], f[FAR_Y + i], dx, dy, near, mx, my, far, ox, oy)
            share, push, nearer = wall(k, r, per, bent, steep, f[NEAR + i], c)
            other, press, too = wall(k, r, per, bent, steep, f[FAR + i], d)
            weight = density * exponential(min(level - k * r - f[TOP + i], ZERO)) * share * other
            inward, across = (steep + nearer + too) * per * weight, weight / along
            f[LOG_PSI + i] += weight
            f[SLOPE_X + i] += inward * dx - across * tx
            f[SLOPE_Y + i] += inward * dy - across * ty
            f[PUSH + i] += weight * push
            f[PUSH_FAR + i] += weight * press
    for i in range(WIDTH):
        psi = max(f[LOG_PSI + i], LEAST)
        per = ONE / psi
        f[SLOPE_X + i], f[SLOPE_Y + i] = per * f[SLOPE_X + i], per * f[SLOPE_Y + i]
        f[PUSH + i], f[PUSH_FAR + i] = per * f[PUSH + i], per * f[PUSH_FAR + i]
        # Between nodes that noise hardly spreads over, a sum can exceed what reaches the whole line, exp(-k ahead).
        f[LOG_PSI + i] = f[TOP + i] + logarithm(psi) - logarithm(max(f[WHOLE + i], ONE))


@kernel
def sight(k, goal, radius, f):  # type: ignore[no-untyped-def]
    """Fill the rows of f (ROWS,) where the goal is in sight: psi of its disc in the open, and walls up to its rim.

    Args, in order: k [1/m], centre and radius of the goal's disc [m], the rows.
    """
    k, radius, most = np.float32(k), np.float32(radius), np.float32(0.5 / k)
    for i in range(WIDTH):
        dx, dy = np.float32(goal[0]) - f[PLACE_X + i], np.float32(goal[1]) - f[PLACE_Y + i]
        r = max(math.sqrt(dx * dx + dy * dy), radius)
        length = r - radius + most
        bent, to_rim = bend(k * length), ONE - radius / r
        steep = fall(k, ONE / length, bent)
        c, d = f[NEAR + i], f[FAR + i]
        near = c + to_rim * (dx * f[NEAR_X + i] + dy * f[NEAR_Y + i])
        far = d + to_rim * (dx * f[FAR_X + i] + dy * f[FAR_Y + i])
        one, f[PUSH + i], _ = wall(k, length, ONE / length, bent, steep, c, near if near > ZERO else c)
        two, f[PUSH_FAR + i], _ = wall(k, length, ONE / length, bent, steep, d, far if far > ZERO else d)
        inward = (k + HALF / r) / r
        f[SLOPE_X + i], f[SLOPE_Y + i] = inward * dx, inward * dy
        f[LOG_PSI + i] = HALF * logarithm(radius / r) - k * (r - radius) + logarithm(one) + logarithm(two)
