"""Judge lanes: clearances and walls near them, and which may have ended."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pirrht.geometry.field import Grid, bilinear, bilinear_slope, border, cell_in_block, finest_cell, walls_of
from pirrht.geometry.world import World
from pirrht.jit.jit import inlined, load_float32
from pirrht.jit.streams import FAR, GOLDEN, HALF, ONE, TWO, ZERO, bits_of, exponential, logarithm
from pirrht.outcome import Outcome
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE, wall_slope

from pirrht.rollouts.point.stages import (  # isort: skip
    C0, C1, CELL, CORNER, DT, E0, E1, FLAG, G0, G1, LANES, LOG_SURVIVAL, NX, NY, PER, PUSH0, PUSH1, ROOT, WALL, L, U, V,
    X, Y,
)  # fmt: skip

SLOW = len(Outcome)  # flag of lanes whose step is to be judged by `bridge_exit`
FRAME: Any = Grid
PLACE: Any = World
FAR_PER, MIN_MISSED = np.float32(FAR), np.float32(1e-7)


@inlined
def single(arena):  # type: ignore[no-untyped-def]
    """Copy an arena with its numbers in single precision."""
    field = arena.field
    frame = FRAME(
        np.float32(field.x0), np.float32(field.y0), np.float32(field.spacing), np.float32(field.per),
        field.nx, field.ny, field.stride, field.table, field.columns, field.shift,
        field.nearest, field.second, field.label,
        np.float32(field.left), np.float32(field.low), np.float32(field.right), np.float32(field.high),
    )  # fmt: skip
    return PLACE(frame, (np.float32(arena.goal[0]), np.float32(arena.goal[1])), np.float32(arena.radius), arena.moving)


@inlined
def corners(field, grid, f, short, row, n):  # type: ignore[no-untyped-def]
    """Load values of the grid at the corners of the lanes' cells."""
    n = min(n, LANES)
    for k in range(n):
        cell = np.int64(short[CELL + k])
        f[row + k], f[row + L + k] = load_float32(grid, cell), load_float32(grid, cell + 1)
        cell += field.stride
        f[row + 2 * L + k], f[row + 3 * L + k] = load_float32(grid, cell), load_float32(grid, cell + 1)


@inlined
def locate(field, f, short, n):  # type: ignore[no-untyped-def]
    """Find the cells that the steps lead to, places in them, and one over their width."""
    n = min(n, LANES)
    if field.table == 0:  # asked once, for loops without branches
        for k in range(n):
            fx, fy, i, j = finest_cell(field, f[NX + k], f[NY + k])
            short[CELL + k] = np.int32(i * np.int32(field.ny) + j)
            f[U + k], f[V + k], f[PER + k] = fx - np.float32(i), fy - np.float32(j), field.per
        return
    for k in range(n):
        fx, fy, i, j = finest_cell(field, f[NX + k], f[NY + k])
        cell, f[U + k], f[V + k], f[PER + k] = cell_in_block(field, fx, fy, i, j)
        short[CELL + k] = np.int32(cell)


@inlined
def survey(arena, f, short, n):  # type: ignore[no-untyped-def]
    """Measure `distances` of the ends of the steps from obstacles, border and goal; arena: `single`."""
    n = min(n, LANES)
    field, (gx, gy), radius = arena.field, arena.goal, arena.radius
    locate(field, f, short, n)
    corners(field, field.nearest, f, short, CORNER, n)
    for k in range(n):
        x, y = f[NX + k], f[NY + k]
        edge = border(field, x, y)
        a, b, c, d = f[CORNER + k], f[CORNER + L + k], f[CORNER + 2 * L + k], f[CORNER + 3 * L + k]
        near = bilinear(a, b, c, d, f[U + k], f[V + k])
        f[C1 + k] = near if edge > ZERO else edge
        f[E1 + k] = edge
        f[G1 + k] = math.sqrt((x - gx) * (x - gx) + (y - gy) * (y - gy)) - radius


@inlined
def wall_push(field, offset, shift, B, f, short, n):  # type: ignore[no-untyped-def]
    """Write the push B' grad log psi of the two nearest walls, `shift` further away [m].

    It uses the cells and corners of `survey`. Nearer than half of the deviation of a step a wall pushes no harder.
    """
    n = min(n, LANES)
    b00, b01, b10, b11 = np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])
    offset, shift = np.float32(offset), np.float32(shift)
    half = HALF * np.float32(math.sqrt(B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]))  # of the deviation of a second
    corners(field, field.second, f, short, CORNER + 4 * L, n)
    for k in range(n):
        at = CORNER + k
        u, v, per = f[U + k], f[V + k], f[PER + k]
        nearest = bilinear_slope(f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], u, v, per)
        second = bilinear_slope(f[at + 4 * L], f[at + 5 * L], f[at + 6 * L], f[at + 7 * L], u, v, per)
        c, nx, ny, d, mx, my = walls_of(field, f[X + k], f[Y + k], nearest, second)
        widest = half * f[ROOT + k]
        c, d = max(c + shift, widest), max(d + shift, widest)
        f[WALL + k], f[WALL + L + k], f[WALL + 2 * L + k] = c, nx, ny
        f[WALL + 3 * L + k], f[WALL + 4 * L + k], f[WALL + 5 * L + k] = d, mx, my
        gx, gy = wall_slope(c, nx, ny, d, mx, my, offset)
        f[PUSH0 + k] = b00 * gx + b10 * gy
        f[PUSH1 + k] = b01 * gx + b11 * gy


@inlined
def judge(arena, f, short, n):  # type: ignore[no-untyped-def]
    """Flag the lanes whose step ends outside the free space or in the goal; how many."""
    n = min(n, LANES)
    (gx, gy), radius = arena.goal, arena.radius
    ended = 0
    for k in range(n):
        dx, dy = f[NX + k] - gx, f[NY + k] - gy
        inside = dx * dx + dy * dy <= radius * radius
        hit = min(f[C1 + k], f[E1 + k]) <= ZERO
        outcome = COLLISION if hit else (GOAL if inside else INSIDE)
        short[FLAG + k] = outcome
        ended += 1 if outcome != INSIDE else 0
    return ended


@inlined
def bridge(variance, weighed, random, f, short, n):  # type: ignore[no-untyped-def]
    """Flag the lanes whose step may have ended on its way, or that two walls weigh; how many. `variance` is per second.

    Most lanes close to one wall survive for sure: exp(-e) <= (1 + e/16)^-16; or they are weighed by their survival.
    """
    n = min(n, LANES)
    far, per, ulp = np.float32(FAR * variance), np.float32(1.0 / (8.0 * variance)), np.float32(2.0**-24)
    slow = 0
    for k in range(n):
        c0, c1, e0, e1, g0, g1 = f[C0 + k], f[C1 + k], f[E0 + k], f[E1 + k], f[G0 + k], f[G1 + k]
        dx, dy = f[NX + k] - f[X + k], f[NY + k] - f[Y + k]
        square, reach = dx * dx + dy * dy, far * f[DT + k]
        past = (e1 <= ZERO) | (g1 <= ZERO) | (c1 <= ZERO) | (TWO * e0 * e1 < reach) | (TWO * g0 * g1 < reach)
        past |= ((c0 + c1) * (c0 + c1) < square) | ((g0 + g1) * (g0 + g1) < square)
        near = TWO * c0 * c1 < reach
        if weighed:
            d = f[WALL + 3 * L + k]
            beside = TWO * d * (d - math.sqrt(square)) < reach
            doubt = past | (near & beside)
            missed = max(ONE - exponential(-TWO * max(c0 * c1, ZERO) * FAR_PER / reach), MIN_MISSED)
            f[LOG_SURVIVAL + k] += logarithm(missed) if near and not doubt else ZERO
        else:
            state = random[k] + GOLDEN
            u = np.float32(np.int32(bits_of(state) >> np.uint64(40))) * ulp + ulp  # no less than what `uniform` draws
            term = ONE + max(c0 * c1, ZERO) * per / f[DT + k]
            term *= term
            term *= term
            term *= term
            term *= term
            survives = u * term < term - TWO
            doubt = past | (near & (not survives))
            random[k] = state if near and not doubt else random[k]
        short[FLAG + k] = SLOW if doubt else INSIDE
        slow += 1 if doubt else 0
    return slow
