"""Hold a block of paths that advance abreast; stages of a step for noise and controls of references.

Each stage is a loop over lanes without branches or calls, which compiles to vector instructions. All is in single
precision, in which a vector holds twice as many lanes: positions round to a micrometre in ten metres, and log dQ/dP
under the reference followed, the one large sum, carries its rounding errors along.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pirrht.jit.jit import inlined, load_float64, load_int64
from pirrht.jit.streams import GOLDEN, HALF, ONE, ZERO, halves, normals_of
from pirrht.rollouts.tuning import TUNING
from pirrht.rollouts.ways import KNOWN, NUMBERS, PLACE, numbers_at, slope_of
from pirrht.topology.crossings import key_of_step, turn_at_cut
from pirrht.topology.tuning import TUNING as TOPOLOGY

LANES, WIDE = TUNING.lanes, TUNING.vector
L = LANES + WIDE  # from row to row: not a power of two, or rows would compete for the same places in the cache
# Rows of a block's numbers, each of all lanes: position, noise, where the step leads, what is close before and after.
# Of the grid cells that the steps lead to, place and corners, nearest and second: looked up by lane, since addresses
# defy vector loads; the next step begins there.
X, Y, Z0, Z1, NX, NY, C0, E0, G0, C1, E1, G1, PUSH0, PUSH1, SUM0, SUM1, SIGN, LOST = (L * i for i in range(18))
# The step's length and its root, time left in the step of the grid, time spent in it [s], log of what is weighed.
DT, ROOT, LEFT, SPENT, LOG_SURVIVAL = (L * i for i in range(18, 23))
U, V, CORNER = 23 * L, 24 * L, 25 * L
WALL = 33 * L  # the two nearest walls, six rows
OWED = 39 * L  # time of the last step for which half of the guide has not been taken off the sum [s]
PER = 40 * L  # one over the width of the cells that the steps lead to [1/m]
CHUNK, NODES = TUNING.chunk, 41 * L  # lanes whose numbers of a way are loaded at once, and where these begin
ROWS = 41 + NUMBERS * CHUNK // L + 1
KEY, SAMPLE = 0, L  # rows of its long integers
HIGH, LOW = 0, L  # rows of its bits
FLAG, CELL, STEP, STAGE = (L * i for i in range(4))  # rows of its short integers; cross-sections passed come last


def aligned(count: int, kind: type) -> Any:
    """Allocate zeros, the first of which begins a vector: across the cache's lines loads run at half the speed."""
    size = np.dtype(kind).itemsize
    raw: Any = np.zeros(count + 64 // size, kind)
    first = -(raw.ctypes.data // size) % (64 // size)
    return raw[first : first + count]


def scratch_of(H: int) -> tuple[Any, ...]:
    """Allocate a block for H references: f, a, log dQ/dP, short and long integers, sequences, bits."""
    numbers = (aligned(rows * L, np.float32) for rows in (ROWS, 2 * H, H))
    whole = aligned((3 + H) * L, np.int32), aligned(2 * L, np.int64)
    return *numbers, *whole, aligned(L, np.uint64), aligned(2 * L, np.uint32)


@inlined
def row_of(g, each):  # type: ignore[no-untyped-def]
    """Return the first place of a reference's rows, in bounds the compiler sees: else it loads lane by lane."""
    return min(max(g * each * L, 0), 1 << 32)


@inlined
def tape_control(drift, g, T, active, f, short, a, n):  # type: ignore[no-untyped-def]
    """Write a_g of a control sequence, its row of `ProposalTables.drift`, by address, and the push."""
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
def way_control(tube, decay, goal, g, h, B, scratch, n):  # type: ignore[no-untyped-def]
    """Write a_g = B' grad log psi of one reference with a tube at the lanes' states, or a_h if `negligible`."""
    n = min(n, LANES)
    f, a, ratio, short, _, _, _ = scratch
    place, slope, last, C, J = tube
    negligible = np.float32(-TUNING.negligible)
    row, stage, own, mine = row_of(g, 2), STAGE + row_of(g, 1), row_of(g, 1), row_of(h, 2)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    tube = place + 4 * PLACE * g * C, slope + 4 * KNOWN * g * C * J, last, J
    for begin in range(0, n, CHUNK):  # what is looked up lane by lane goes to rows of its own, for loops of vectors
        some, width = g == h, min(CHUNK, n - begin)
        for k in range(begin, begin if g == h else begin + width):
            some |= ratio[own + k] >= negligible
        for i in range(width if some else 0):
            k = begin + i
            if g == h or ratio[own + k] >= negligible:
                s = numbers_at(tube, np.int64(short[stage + k]), f[X + k], f[Y + k], f, NODES + i, CHUNK)
                short[stage + k] = np.int32(s)
        for i in range(width if some else 0):
            k = begin + i
            at = WALL + k
            walls = (f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], f[at + 4 * L], f[at + 5 * L])
            gx, gy = slope_of(f, NODES + i, CHUNK, decay, goal, f[X + k], f[Y + k], walls)
            a[row + k], a[row + L + k] = b00 * gx + b10 * gy, b01 * gx + b11 * gy
        for k in range(begin, begin + width if g != h else begin):
            over = ratio[own + k] < negligible
            a[row + k] = a[mine + k] if over else a[row + k]
            a[row + L + k] = a[mine + L + k] if over else a[row + L + k]


@inlined
def draw(random, bits, f, n):  # type: ignore[no-untyped-def]
    """Draw the next two normal numbers of each lane."""
    n = min(n, LANES)
    for k in range(n):
        state = random[k] + GOLDEN
        random[k] = state
        bits[HIGH + k], bits[LOW + k] = halves(state)
    for k in range(n):
        one, other = normals_of(bits[HIGH + k], bits[LOW + k])
        f[Z0 + k] = f[SIGN + k] * one
        f[Z1 + k] = f[SIGN + k] * other


@inlined
def fit_steps(times, least, scale, rim, f, short, n):  # type: ignore[no-untyped-def]
    """Fit steps to the places of the lanes (`fitting`); where a step of the grid is over, the next begins."""
    n = min(n, LANES)
    least, scale, rim, half = np.float32(least), np.float32(scale), np.float32(rim), HALF
    for k in range(n):
        if f[LEFT + k] <= ZERO:
            i = min(np.int64(short[STEP + k]), times.shape[0] - 2)  # lanes that have ended stand beyond
            f[LEFT + k] = np.float32(times[i + 1] - times[i])
    for k in range(n):
        near = max(min(min(f[C0 + k], f[E0 + k]), max(f[G0 + k], rim)), ZERO)
        left = f[LEFT + k]
        wish = max(scale * near * near, least)
        dt = left if wish >= left else min(wish, half * left)
        f[DT + k], f[ROOT + k] = dt, math.sqrt(dt)
        f[LEFT + k] = left - dt


@inlined
def move(h, B, f, a, n):  # type: ignore[no-untyped-def]
    """Write where the step leads; its noise Z becomes y = a dt + dw."""
    n = min(n, LANES)
    row = row_of(h, 2)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    for k in range(n):
        root, dt = f[ROOT + k], f[DT + k]
        y0 = f[Z0 + k] * root + a[row + k] * dt
        y1 = f[Z1 + k] * root + a[row + L + k] * dt
        f[Z0 + k] = y0
        f[Z1 + k] = y1
        f[NX + k] = f[X + k] + b00 * y0 + b01 * y1
        f[NY + k] = f[Y + k] + b10 * y0 + b11 * y1


@inlined
def cross(cuts, f, long, n):  # type: ignore[no-untyped-def]
    """Add the turns of the cuts that are crossed to the keys."""
    n = min(n, LANES)
    if TOPOLOGY.few_markers < cuts.M:
        for k in range(n):
            long[KEY + k] += key_of_step(cuts, f[X + k], f[Y + k], f[NX + k], f[NY + k])
        return
    gx, gy = np.float32(cuts.goal_x), np.float32(cuts.goal_y)
    for c in range(cuts.M):
        mx, my = np.float32(load_float64(cuts.x, c)), np.float32(load_float64(cuts.y, c))
        weight = load_int64(cuts.weight, c)
        for k in range(n):
            turn = turn_at_cut(mx, my, gx, gy, f[X + k], f[Y + k], f[NX + k], f[NY + k])
            long[KEY + k] += turn * weight


@inlined
def add_log_ratios(h, H, f, a, ratio, n):  # type: ignore[no-untyped-def]
    """Add the step to log dQ_h/dP of the lanes that go on, and to log dQ_g/dQ_h of other references.

    The sum for h is large where there is little noise; the others are needed only where they are close to it.
    """
    n = min(n, LANES)
    mine = row_of(h, 2)
    for g in range(H):
        row, own = row_of(g, 2), row_of(g, 1)
        if g == h:
            for k in range(n):
                a0, a1, dt = a[row + k], a[row + L + k], f[DT + k]
                term = a0 * (f[Z0 + k] - HALF * a0 * dt) + a1 * (f[Z1 + k] - HALF * a1 * dt) + f[LOST + k]
                total = ratio[own + k] + term
                f[LOST + k] = term - (total - ratio[own + k])
                ratio[own + k] = total
        else:
            for k in range(n):
                a0, a1, b0, b1, dt = a[row + k], a[row + L + k], a[mine + k], a[mine + L + k], f[DT + k]
                term = (a0 - b0) * (f[Z0 + k] - HALF * (a0 + b0) * dt)
                ratio[own + k] += term + (a1 - b1) * (f[Z1 + k] - HALF * (a1 + b1) * dt)


@inlined
def relax(h, f, a, n):  # type: ignore[no-untyped-def]
    """Take the second half of the lead off the sums: over a step it is the mean of both ends, to second order."""
    n = min(n, LANES)
    row = row_of(h, 2)
    for k in range(n):
        owed = HALF * f[OWED + k]
        f[SUM0 + k] -= a[row + k] * owed
        f[SUM1 + k] -= a[row + L + k] * owed


@inlined
def advance(h, window, follows, f, short, a, n):  # type: ignore[no-untyped-def]
    """Take the step of the lanes that go on; sum up noise over the first `window` steps. Returns the most steps taken.

    Of a lead that `follows` the state half is taken off here, half by `relax`.
    """
    n = min(n, LANES)
    row, window, most = row_of(h, 2), np.int32(window), np.int32(0)
    part = HALF if follows else ONE
    for k in range(n):
        early, dt = short[STEP + k] < window, f[DT + k]
        f[SUM0 + k] += f[Z0 + k] - part * a[row + k] * dt if early else ZERO
        f[SUM1 + k] += f[Z1 + k] - part * a[row + L + k] * dt if early else ZERO
        f[OWED + k] = dt if early and follows else ZERO
    for k in range(n):
        f[X + k], f[Y + k] = f[NX + k], f[NY + k]
        f[C0 + k], f[E0 + k], f[G0 + k] = f[C1 + k], f[E1 + k], f[G1 + k]
        over = f[LEFT + k] <= ZERO
        f[SPENT + k] = ZERO if over else f[SPENT + k] + f[DT + k]
        step = np.int32(short[STEP + k] + (np.int32(1) if over else np.int32(0)))
        short[STEP + k] = step
        most = max(most, step)
    return most
