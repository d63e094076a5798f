"""Stages of a step of many paths abreast: what their references would have them do."""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.float32 import ONE, ZERO
from pirrht.compiled.jit import inlined
from pirrht.geometry.field import bilinear_slope
from pirrht.rollouts.first_exit import away
from pirrht.rollouts.gates import PASSED, aim, towards
from pirrht.rollouts.point.exits import corners
from pirrht.rollouts.point.stages import (
    C0,
    CORNER,
    DX,
    DY,
    E0,
    HURRY,
    LANES,
    PUSH0,
    PUSH1,
    STAGE,
    L,
    U,
    V,
    X,
    Y,
    row_of,
)


@inlined
def wall_push(field, reach, widest, decay, B, f, short, n):  # type: ignore[no-untyped-def]
    """The push B' grad log h away from the nearest walls, and how much faster samples are in a channel.

    The lanes' cells and what is nearest at their corners are what `survey` has left.
    """
    n = min(n, LANES)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    narrow, wide = np.float32(math.pi / decay), np.float32(3.0 * reach)
    reach, widest = np.float32(reach), np.float32(widest)
    corners(field, field.second, f, short, CORNER + 4 * L, n)
    for k in range(n):
        e, at = f[E0 + k], CORNER + k
        u, v = f[U + k], f[V + k]
        nearest = bilinear_slope(f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], u, v, field.per)
        second = bilinear_slope(f[at + 4 * L], f[at + 5 * L], f[at + 6 * L], f[at + 7 * L], u, v, field.per)
        gx, gy, width = away(field, reach, widest, f[X + k], f[Y + k], nearest, second)
        ratio = narrow / width
        close = ((f[C0 + k] > ZERO) & (f[C0 + k] < wide)) | ((e > ZERO) & (e < wide))
        f[PUSH0 + k] = b00 * gx + b10 * gy if close else ZERO
        f[PUSH1 + k] = b01 * gx + b11 * gy if close else ZERO
        f[HURRY + k] = math.sqrt(ONE + ratio * ratio) if close else ONE


@inlined
def guide_control(gates, count, decay, speed, g, one, two, D, f, short, a, n):  # type: ignore[no-untyped-def]
    """Write a_g = B_c^-1 G_c u_g of one reference at the lanes' states: its tape, its gates, the push.

    Args: places of all gates and the number of this reference's, k of psi and the speed towards them; the reference and
        its tape (one, two) in this step; D = B_c^-1 G_c (2, 2); numbers, short integers and a of the block; its lanes.
    """
    n = min(n, LANES)
    row, one, two = row_of(g, 2), np.float32(one), np.float32(two)
    if count == 0:
        for k in range(n):
            a[row + k] = one + f[PUSH0 + k]
            a[row + L + k] = two + f[PUSH1 + k]
        return
    head_for(gates, count - 1, np.float32(decay), g, f, short, n)
    speed = np.float32(speed)
    d00, d01, d10, d11 = np.float32(D[0, 0]), np.float32(D[0, 1]), np.float32(D[1, 0]), np.float32(D[1, 1])
    for k in range(n):
        dx, dy = f[DX + k], f[DY + k]
        scale = f[HURRY + k] * speed * towards(dx, dy)
        a[row + k] = scale * (d00 * dx + d01 * dy) + one + f[PUSH0 + k]
        a[row + L + k] = scale * (d10 * dx + d11 * dy) + two + f[PUSH1 + k]


@inlined
def head_for(gates, last, decay, g, f, short, n):  # type: ignore[no-untyped-def]
    """Vectors from the lanes to where to head for on their next gates, as `next_gate` says, gate by gate."""
    n = min(n, LANES)
    stage, before = STAGE + row_of(g, 1), np.float32(PASSED)
    least, most = np.int32(last), np.int32(0)
    for k in range(n):
        least, most = min(least, short[stage + k]), max(most, short[stage + k])
    for s in range(min(most, last - 1), least - 1, -1):  # from the last one, so that no lane passes two at once
        here = np.int32(s)
        cx, cy = np.float32(gates[g, s, 0]), np.float32(gates[g, s, 1])
        ax, ay = np.float32(gates[g, s, 2]), np.float32(gates[g, s, 3])
        passed = np.int32(0)
        for k in range(n):
            along = (cx - f[X + k]) * ax + (cy - f[Y + k]) * ay
            step = np.int32((short[stage + k] == here) & (along < before))
            short[stage + k] = np.int32(short[stage + k] + step)
            passed = np.int32(passed + step)
        most = np.int32(s + 1) if s == most and passed > 0 else most
    for s in range(least, most + 1):
        here = np.int32(s)
        cx, cy = np.float32(gates[g, s, 0]), np.float32(gates[g, s, 1])
        ax, ay = np.float32(gates[g, s, 2]), np.float32(gates[g, s, 3])
        ox, oy = np.float32(gates[g, s, 4]), np.float32(gates[g, s, 5])
        far, beside = np.float32(gates[g, s, 6]), np.float32(gates[g, s, 7])
        if s == last:
            for k in range(n):
                mine = short[stage + k] == here
                f[DX + k] = cx - f[X + k] if mine else f[DX + k]
                f[DY + k] = cy - f[Y + k] if mine else f[DY + k]
            continue
        for k in range(n):
            dx, dy = cx - f[X + k], cy - f[Y + k]
            shift = aim(max(dx * ax + dy * ay, before), -(dx * ox + dy * oy), far, beside, decay)
            mine = short[stage + k] == here
            f[DX + k] = dx + shift * ox if mine else f[DX + k]
            f[DY + k] = dy + shift * oy if mine else f[DY + k]
