"""Stages of a step of many paths abreast: what their references would have them do."""

from __future__ import annotations

import numpy as np

from pirrht.compiled.addresses import load_float64
from pirrht.compiled.float32 import HALF
from pirrht.compiled.jit import inlined
from pirrht.geometry.field import bilinear_slope
from pirrht.rollouts.first_exit import wall_slope, walls_of
from pirrht.rollouts.point.exits import corners
from pirrht.rollouts.point.stages import (
    CORNER,
    LANES,
    PER,
    PUSH0,
    PUSH1,
    ROOT,
    STAGE,
    STEP,
    WALL,
    L,
    U,
    V,
    X,
    Y,
    row_of,
)
from pirrht.rollouts.ways import KNOWN, PLACE, uphill


@inlined
def wall_push(field, reach, beyond, b, B, f, short, n):  # type: ignore[no-untyped-def]
    """The push B' grad log of what psi is proportional to at the two nearest walls; `b` is the noise [m/sqrt(s)].

    Walls stand `beyond` behind where they are [m].

    The lanes' cells and what is nearest at their corners are what `survey` has left. Nearer than half of the deviation
    of a step a wall pushes no harder.
    """
    n = min(n, LANES)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    reach, beyond, half = np.float32(reach), np.float32(beyond), HALF * np.float32(b)
    corners(field, field.second, f, short, CORNER + 4 * L, n)
    for k in range(n):
        at = CORNER + k
        u, v, per = f[U + k], f[V + k], f[PER + k]
        nearest = bilinear_slope(f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], u, v, per)
        second = bilinear_slope(f[at + 4 * L], f[at + 5 * L], f[at + 6 * L], f[at + 7 * L], u, v, per)
        c, nx, ny, d, mx, my = walls_of(field, f[X + k], f[Y + k], nearest, second)
        widest = half * f[ROOT + k]
        c, d = max(c + beyond, widest), max(d + beyond, widest)
        f[WALL + k], f[WALL + L + k], f[WALL + 2 * L + k] = c, nx, ny
        f[WALL + 3 * L + k], f[WALL + 4 * L + k], f[WALL + 5 * L + k] = d, mx, my
        gx, gy = wall_slope(c, nx, ny, d, mx, my, reach)
        f[PUSH0 + k] = b00 * gx + b10 * gy
        f[PUSH1 + k] = b01 * gx + b11 * gy


@inlined
def tape_control(drift, g, T, active, f, short, a, n):  # type: ignore[no-untyped-def]
    """Write a_g of one reference with a tape: its row of `Leads.drift`, by address, and the push."""
    n = min(n, LANES)
    row = row_of(g, 2)
    for k in range(n):
        a[row + k], a[row + L + k] = f[PUSH0 + k], f[PUSH1 + k]
    if active == 0:
        return
    for k in range(n):
        i = np.int64(short[STEP + k])
        if i < active:
            at = 2 * (g * T + i)
            a[row + k] += np.float32(load_float64(drift, at))
            a[row + L + k] += np.float32(load_float64(drift, at + 1))


@inlined
def way_control(ways, g, goal, B, f, short, a, n):  # type: ignore[no-untyped-def]
    """Write a_g = B' grad log psi of one reference with a way at the lanes' states."""
    n = min(n, LANES)
    place, slope, C, J, last, decay = ways
    row, stage = row_of(g, 2), STAGE + row_of(g, 1)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    place, slope = place + 4 * PLACE * g * C, slope + 4 * KNOWN * g * C * J
    for k in range(n):
        at = WALL + k
        walls = (f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], f[at + 4 * L], f[at + 5 * L])
        s, gx, gy = uphill(place, slope, last, J, decay, goal, np.int64(short[stage + k]), f[X + k], f[Y + k], walls)
        short[stage + k] = np.int32(s)
        a[row + k] = b00 * gx + b10 * gy
        a[row + L + k] = b01 * gx + b11 * gy
