"""Sampled paths of a point, many abreast: dx = G u dt + B dw with BB' = b^2 I.

A block of paths around one reference advances step by step in lockstep. Each stage of a step is a loop over the
block's lanes without branches, which compiles to vector instructions; what is rare (an exit, a wall close by, a normal
number from the tail) is done lane by lane. Paths that have ended leave the block. The paths are those of `rollout_any`
up to rounding: the same numbers are drawn in the same order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pirrht.clearance import bilinear, bilinear_slope, border, cell_of
from pirrht.cuts import FEW, key_of_step, turn_at_cut
from pirrht.dynamics import Dynamics, no_drift
from pirrht.exits import COLLISION, FAR, GOAL, INSIDE, at_crossing, away, bridge_exit
from pirrht.gates import PASSED, aim, towards
from pirrht.jit import inlined, kernel
from pirrht.memory import load_float32, load_float64, load_int64
from pirrht.noise import EDGE, GOLDEN, candidate, normal_again, stream, twin, uniform
from pirrht.scene import Array

LANES = 256  # of a block; all rows together stay within the nearest cache
WIDE = 8  # lanes of a vector: loops run over whole vectors, the last of which may hold lanes that have ended
L = LANES + WIDE  # from row to row: not a power of two, or rows would compete for the same places in the cache
# Rows of a block's numbers, each of all lanes: position, noise, where the step leads, what is close before and after.
# A cell's place and corners, nearest and second, are scratch: looked up by lane, since addresses defy vector loads.
X, Y, Z0, Z1, NX, NY, C0, E0, G0, C1, E1, G1, PUSH0, PUSH1, HURRY, SUM0, SUM1, SIGN = (L * row for row in range(18))
U, V, CORNER = 18 * L, 19 * L, 20 * L
DX, DY = U, V
ROWS = 28
KEY, SAMPLE, FLAG, CELL = 0, L, 2 * L, 3 * L  # rows of its integers; gates passed follow, a row per reference
STAGES = 4
SLOW = 3  # flag of lanes whose step needs a closer look


def is_point(d: Dynamics) -> bool:
    """Whether the dynamics are of this kind."""
    if not (d.n == d.m == 2 and d.drift is no_drift and isinstance(d.diffusion_block, np.ndarray)):
        return False
    cov = d.diffusion_block @ d.diffusion_block.T
    return bool(cov[0, 1] == 0.0 and cov[0, 0] == cov[1, 1])


@kernel
def draw(random, whole, f, row, n):  # type: ignore[no-untyped-def]
    """The next normal number of each lane."""
    n = min(n, LANES)
    rejected = 0
    for k in range(n):
        state = random[k] + GOLDEN
        random[k] = state
        layer, x, sign = candidate(state)
        good = x < EDGE[layer + 1]
        f[row + k] = sign * x
        whole[FLAG + k] = 0 if good else 1
        rejected += 0 if good else 1
    if rejected > 0:
        for k in range(n):
            if whole[FLAG + k] != 0:
                random[k], f[row + k] = normal_again(random[k])


@kernel
def corners(field, grid, at, f, whole, row, n):  # type: ignore[no-untyped-def]
    """Values of the grid at the corners of the lanes' cells."""
    n = min(n, LANES)
    for k in range(n):
        cell = whole[at + k]
        f[row + k], f[row + L + k] = load_float32(grid, cell), load_float32(grid, cell + 1)
        cell += field.ny
        f[row + 2 * L + k], f[row + 3 * L + k] = load_float32(grid, cell), load_float32(grid, cell + 1)


@kernel
def place(field, x, y, f, whole, n):  # type: ignore[no-untyped-def]
    """Cells that the lanes' points, in the rows x and y, lie in, and where in them."""
    n = min(n, LANES)
    for k in range(n):
        whole[CELL + k], f[U + k], f[V + k] = cell_of(field, f[x + k], f[y + k])


@kernel
def look(field, goal, radius, f, whole, n):  # type: ignore[no-untyped-def]
    """How far the ends of the steps are from obstacles, border and goal, as `distances` says."""
    n = min(n, LANES)
    gx, gy = goal
    place(field, NX, NY, f, whole, n)
    corners(field, field.nearest, CELL, f, whole, CORNER, n)
    for k in range(n):
        x, y = f[NX + k], f[NY + k]
        edge = border(field, x, y)
        a, b, c, d = f[CORNER + k], f[CORNER + L + k], f[CORNER + 2 * L + k], f[CORNER + 3 * L + k]
        near = bilinear(a, b, c, d, f[U + k], f[V + k])
        f[C1 + k] = near if edge > 0.0 else edge
        f[E1 + k] = edge
        f[G1 + k] = math.sqrt((x - gx) * (x - gx) + (y - gy) * (y - gy)) - radius


@kernel
def lean(field, reach, widest, decay, B, f, whole, n):  # type: ignore[no-untyped-def]
    """The push B' grad log h away from the nearest walls, and how much faster samples are in a channel."""
    n = min(n, LANES)
    b00, b01, b10, b11 = B[0, 0], B[0, 1], B[1, 0], B[1, 1]
    narrow, wide = math.pi / decay, 3.0 * reach
    place(field, X, Y, f, whole, n)
    corners(field, field.nearest, CELL, f, whole, CORNER, n)
    corners(field, field.second, CELL, f, whole, CORNER + 4 * L, n)
    for k in range(n):
        e, at = f[E0 + k], CORNER + k
        u, v = f[U + k], f[V + k]
        nearest = bilinear_slope(f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], u, v, field.per)
        second = bilinear_slope(f[at + 4 * L], f[at + 5 * L], f[at + 6 * L], f[at + 7 * L], u, v, field.per)
        gx, gy, width = away(field, reach, widest, f[X + k], f[Y + k], nearest, second)
        ratio = narrow / width
        close = ((f[C0 + k] > 0.0) & (f[C0 + k] < wide)) | ((e > 0.0) & (e < wide))
        f[PUSH0 + k] = b00 * gx + b10 * gy if close else 0.0
        f[PUSH1 + k] = b01 * gx + b11 * gy if close else 0.0
        f[HURRY + k] = math.sqrt(1.0 + ratio * ratio) if close else 1.0


@kernel
def follow(gates, count, decay, speed, g, one, two, D, f, whole, a, n):  # type: ignore[no-untyped-def]
    """a_g = B_c^-1 G_c u_g of one reference at the lanes' states: its tape (one, two), its gates, the push."""
    n = min(n, LANES)
    row = 2 * g * L
    if count == 0:
        for k in range(n):
            a[row + k] = one + f[PUSH0 + k]
            a[row + L + k] = two + f[PUSH1 + k]
        return
    head(gates, count - 1, decay, g, f, whole, n)
    d00, d01, d10, d11 = D[0, 0], D[0, 1], D[1, 0], D[1, 1]
    for k in range(n):
        dx, dy = f[DX + k], f[DY + k]
        scale = f[HURRY + k] * speed * towards(dx, dy)
        a[row + k] = scale * (d00 * dx + d01 * dy) + one + f[PUSH0 + k]
        a[row + L + k] = scale * (d10 * dx + d11 * dy) + two + f[PUSH1 + k]


@kernel
def head(gates, last, decay, g, f, whole, n):  # type: ignore[no-untyped-def]
    """Vectors from the lanes to where to head for on their next gates, as `next_gate` says, gate by gate."""
    n = min(n, LANES)
    stage, least, most = (STAGES + g) * L, last, 0
    for k in range(n):
        least, most = min(least, whole[stage + k]), max(most, whole[stage + k])
    for s in range(min(most, last - 1), least - 1, -1):  # from the last one, so that no lane passes two at once
        cx, cy, ax, ay = gates[g, s, 0], gates[g, s, 1], gates[g, s, 2], gates[g, s, 3]
        passed = 0
        for k in range(n):
            along = (cx - f[X + k]) * ax + (cy - f[Y + k]) * ay
            step = 1 if (whole[stage + k] == s) & (along < PASSED) else 0
            whole[stage + k] += step
            passed += step
        most = s + 1 if s == most and passed > 0 else most
    for s in range(least, most + 1):
        cx, cy, ax, ay = gates[g, s, 0], gates[g, s, 1], gates[g, s, 2], gates[g, s, 3]
        ox, oy, far, beside = gates[g, s, 4], gates[g, s, 5], gates[g, s, 6], gates[g, s, 7]
        if s == last:
            for k in range(n):
                mine = whole[stage + k] == s
                f[DX + k] = cx - f[X + k] if mine else f[DX + k]
                f[DY + k] = cy - f[Y + k] if mine else f[DY + k]
            continue
        for k in range(n):
            dx, dy = cx - f[X + k], cy - f[Y + k]
            shift = aim(max(dx * ax + dy * ay, PASSED), -(dx * ox + dy * oy), far, beside, decay)
            mine = whole[stage + k] == s
            f[DX + k] = dx + shift * ox if mine else f[DX + k]
            f[DY + k] = dy + shift * oy if mine else f[DY + k]


@kernel
def move(h, dt, B, f, a, n):  # type: ignore[no-untyped-def]
    """Where the step leads; its noise Z becomes y = a dt + dw."""
    n = min(n, LANES)
    row, root = 2 * h * L, math.sqrt(dt)
    b00, b01, b10, b11 = B[0, 0], B[0, 1], B[1, 0], B[1, 1]
    for k in range(n):
        y0 = f[SIGN + k] * f[Z0 + k] * root + a[row + k] * dt
        y1 = f[SIGN + k] * f[Z1 + k] * root + a[row + L + k] * dt
        f[Z0 + k] = y0
        f[Z1 + k] = y1
        f[NX + k] = f[X + k] + b00 * y0 + b01 * y1
        f[NY + k] = f[Y + k] + b10 * y0 + b11 * y1


@kernel
def cross(cuts, f, whole, n):  # type: ignore[no-untyped-def]
    """Add the turns of the cuts that are crossed to the keys."""
    n = min(n, LANES)
    if cuts.M > FEW:
        for k in range(n):
            whole[KEY + k] += key_of_step(cuts, f[X + k], f[Y + k], f[NX + k], f[NY + k])
        return
    for c in range(cuts.M):
        mx, my, weight = load_float64(cuts.x, c), load_float64(cuts.y, c), load_int64(cuts.weight, c)
        for k in range(n):
            turn = turn_at_cut(mx, my, cuts.goal_x, cuts.goal_y, f[X + k], f[Y + k], f[NX + k], f[NY + k])
            whole[KEY + k] += turn * weight


@kernel
def judge(goal, radius, f, whole, n):  # type: ignore[no-untyped-def]
    """Flag the lanes whose step ends outside the free space or in the goal; how many."""
    n = min(n, LANES)
    gx, gy = goal
    ended = 0
    for k in range(n):
        dx, dy = f[NX + k] - gx, f[NY + k] - gy
        inside = dx * dx + dy * dy <= radius * radius
        hit = min(f[C1 + k], f[E1 + k]) <= 0.0
        outcome = COLLISION if hit else (GOAL if inside else INSIDE)
        whole[FLAG + k] = outcome
        ended += 1 if outcome != INSIDE else 0
    return ended


@kernel
def bridge(variance, random, f, whole, n):  # type: ignore[no-untyped-def]
    """Flag the lanes whose step may have ended on its way; how many.

    Most that are merely close to a wall survive for sure: exp(-e) <= (1 + e/16)^-16, and no second wall is nearer.
    """
    n = min(n, LANES)
    reach = FAR * variance
    slow = 0
    for k in range(n):
        c0, c1, e0, e1, g0, g1 = f[C0 + k], f[C1 + k], f[E0 + k], f[E1 + k], f[G0 + k], f[G1 + k]
        dx, dy = f[NX + k] - f[X + k], f[NY + k] - f[Y + k]
        square = dx * dx + dy * dy
        past = (e1 <= 0.0) | (g1 <= 0.0) | (c1 <= 0.0) | (2.0 * e0 * e1 < reach) | (2.0 * g0 * g1 < reach)
        past |= ((c0 + c1) * (c0 + c1) < square) | ((g0 + g1) * (g0 + g1) < square)
        near = 2.0 * c0 * c1 < reach
        state, u = uniform(random[k])
        term = 1.0 + max(c0 * c1, 0.0) / (8.0 * variance)
        term *= term
        term *= term
        term *= term
        term *= term
        survives = u * term < term - 2.0
        doubt = past | (near & (not survives))
        random[k] = state if near and not doubt else random[k]
        whole[FLAG + k] = SLOW if doubt else INSIDE
        slow += 1 if doubt else 0
    return slow


@kernel
def weigh(H, dt, f, a, ratio, n):  # type: ignore[no-untyped-def]
    """Add the step to log dQ_g/dP of the lanes that go on."""
    n = min(n, LANES)
    for g in range(H):
        row, own = 2 * g * L, g * L
        for k in range(n):
            a0, a1 = a[row + k], a[row + L + k]
            ratio[own + k] += a0 * (f[Z0 + k] - 0.5 * a0 * dt) + a1 * (f[Z1 + k] - 0.5 * a1 * dt)


@kernel
def advance(h, dt, averaged, f, a, n):  # type: ignore[no-untyped-def]
    """The lanes that go on take their step; what noise did is summed up while it is `averaged`."""
    n = min(n, LANES)
    row = 2 * h * L
    if averaged:
        for k in range(n):
            f[SUM0 + k] += f[Z0 + k] - a[row + k] * dt
            f[SUM1 + k] += f[Z1 + k] - a[row + L + k] * dt
    for k in range(n):
        f[X + k], f[Y + k] = f[NX + k], f[NY + k]
        f[C0 + k], f[E0 + k], f[G0 + k] = f[C1 + k], f[E1 + k], f[G1 + k]


@inlined
def leave(rate, times, window, inverse, H, h, i, share, outcome, base, k, f, whole, a, ratio, paths):  # type: ignore[no-untyped-def]
    """Note down a path that ends after a share of step i."""
    s, dt = whole[SAMPLE + k], times[i + 1] - times[i]
    until = dt * share  # at a crossing nothing after it enters dQ/dP
    n0, n1, span = f[SUM0 + k], f[SUM1 + k], times[min(i, window)]
    if i < window:
        own = 2 * h * L + k
        n0, n1, span = n0 + f[Z0 + k] - a[own] * until, n1 + f[Z1 + k] - a[own + L] * until, span + until
    for g in range(H):
        a0, a1 = a[2 * g * L + k], a[2 * g * L + L + k]
        last = a0 * (f[Z0 + k] - 0.5 * a0 * until) + a1 * (f[Z1 + k] - 0.5 * a1 * until)
        paths.log_ratio[s, g] = ratio[g * L + k] + last
    paths.work[s], paths.key[s] = rate * (times[i] + until), whole[KEY + k]
    paths.outcome[s], paths.steps[s], paths.span[s] = outcome, i + 1, span
    paths.now[s, 0] = inverse[0, 0] * n0 + inverse[0, 1] * n1 + span * base[0]
    paths.now[s, 1] = inverse[1, 0] * n0 + inverse[1, 1] * n1 + span * base[1]


@inlined
def fill_up(k, last, H, random, f, whole, a, ratio):  # type: ignore[no-untyped-def]
    """Move the last lane to where one has left."""
    for row in (Z0, Z1, NX, NY, C1, E1, G1, SUM0, SUM1, SIGN):
        f[row + k] = f[row + last]
    random[k], whole[KEY + k], whole[SAMPLE + k] = random[last], whole[KEY + last], whole[SAMPLE + last]
    for g in range(H if k < last else 0):
        whole[(STAGES + g) * L + k], ratio[g * L + k] = whole[(STAGES + g) * L + last], ratio[g * L + last]
        a[2 * g * L + k], a[2 * g * L + L + k] = a[2 * g * L + last], a[2 * g * L + L + last]


@kernel
def cut(field, goal, radius, B, step, k, random, f):  # type: ignore[no-untyped-def]
    """Whether and where the step of a lane that may have ended on its way did: outcome and share of the step."""
    x, y, nx, ny = f[X + k], f[Y + k], f[NX + k], f[NY + k]
    before, after = (f[C0 + k], f[E0 + k], f[G0 + k]), (f[C1 + k], f[E1 + k], f[G1 + k])
    state, outcome, share = bridge_exit(
        field, goal, radius, x, y, nx, ny, before, after, (step, 0.0, step), random[k]
    )  # fmt: skip
    random[k] = state
    if outcome != INSIDE:
        # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
        deviation = math.sqrt(step)
        _, dx, dy = at_crossing(field, goal, x, y, nx - x, ny - y, outcome, share, radius, deviation, state)
        variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
        f[Z0 + k] = (B[0, 0] * dx + B[1, 0] * dy) / variance
        f[Z1 + k] = (B[0, 1] * dx + B[1, 1] * dy) / variance
    return outcome, share


@kernel
def block(world, guides, h, x0, seed, start, stop, paths, random, f, whole, a, ratio):  # type: ignore[no-untyped-def]
    """Simulate the samples of one block, all of them around reference h."""
    field, goal, radius, cuts, B, D = (
        world.field, world.goal, world.goal_radius, world.cuts, world.diffusion, world.gain,
    )  # fmt: skip
    inverse, times, drift, active, gates = world.inverse, guides.times, guides.drift, guides.active, guides.gates.place
    count, decay, speed, reach, window = (
        guides.gates.count, guides.gates.decay, guides.speed, guides.reach, guides.window,
    )  # fmt: skip
    H, T, n = drift.shape[0], drift.shape[1], stop - start
    variance = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    f[:], whole[:], ratio[:], base = 0.0, 0, 0.0, (0.0, 0.0)
    f[X:Y], f[Y:Z0], f[NX:NY], f[NY:C0], f[HURRY:SUM0] = x0[0], x0[1], x0[0], x0[1], 1.0
    for k in range(n):
        first, f[SIGN + k] = twin(start + k, guides.first[h], guides.mirrored)
        random[k], whole[SAMPLE + k] = stream(seed, first), start + k
    look(field, goal, radius, f, whole, LANES)
    f[C0:C1] = f[C1:PUSH0]
    for i in range(T):
        dt = times[i + 1] - times[i]
        step, full = variance * dt, (n + WIDE - 1) // WIDE * WIDE
        if reach > 0.0:
            lean(field, reach, math.sqrt(step), decay, B, f, whole, full)
        for g in range(H):
            one, two = (drift[g, i, 0], drift[g, i, 1]) if i < active[g] else (0.0, 0.0)
            follow(gates, count[g], decay, speed, g, one, two, D, f, whole, a, full)
        if i == 0:
            bare0, bare1 = a[2 * h * L] - f[PUSH0], a[2 * h * L + L] - f[PUSH1]
            base = inverse[0, 0] * bare0 + inverse[0, 1] * bare1, inverse[1, 0] * bare0 + inverse[1, 1] * bare1
        draw(random, whole, f, Z0, full)
        draw(random, whole, f, Z1, full)
        move(h, dt, B, f, a, full)
        cross(cuts, f, whole, full)
        look(field, goal, radius, f, whole, full)
        flagged = bridge(step, random, f, whole, full) if world.bridge else judge(goal, radius, f, whole, full)
        for k in range(n - 1 if flagged > 0 else -1, -1, -1):
            outcome, share = whole[FLAG + k], 1.0
            if outcome == SLOW:
                outcome, share = cut(field, goal, radius, B, step, k, random, f)
            if outcome != INSIDE:
                leave(
                    world.rate, times, window, inverse, H, h, i, share, outcome, base, k, f, whole, a, ratio, paths
                )  # fmt: skip
                n -= 1
                fill_up(k, n, H, random, f, whole, a, ratio)
        if n == 0:
            return
        weigh(H, dt, f, a, ratio, full)
        advance(h, dt, i < window, f, a, full)
    f[Z0:NX], a[:] = 0.0, 0.0
    for k in range(n):
        leave(world.rate, times, window, inverse, H, h, T - 1, 1.0, INSIDE, base, k, f, whole, a, ratio, paths)


def aligned(count: int) -> Array:
    """So many zeros, the first of which begins a vector: what lies across the cache's lines loads at half the speed."""
    raw = np.zeros(count + WIDE)
    first = -(raw.ctypes.data // 8) % WIDE
    return raw[first : first + count]


def sample(world: Any, guides: Any, x0: Array, seed: np.uint64, start: int, stop: int, paths: Any) -> None:
    """Fill `paths` for a range of samples, block by block."""
    H = len(guides.control)
    blocks(
        world, guides, x0, seed, start, stop, paths, aligned(L).view(np.uint64), aligned(ROWS * L),
        aligned((STAGES + H) * L).view(np.int64), aligned(2 * H * L), aligned(H * L),
    )  # fmt: skip


@kernel
def blocks(world, guides, x0, seed, start, stop, paths, random, f, whole, a, ratio):  # type: ignore[no-untyped-def]
    """The same in scratch that begins at vectors."""
    h, s = 0, start
    while s < stop:
        while s >= guides.first[h + 1]:
            h += 1
        end = min(min(stop, guides.first[h + 1]), s + LANES)
        block(world, guides, h, x0, seed, s, end, paths, random, f, whole, a, ratio)
        s = end
