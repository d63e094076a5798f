"""Hold a block of paths of a point that advance abreast, dx = G u dt + B dw with B B' = b^2 I: stages of a step.

Each path keeps its own time, since steps fit the place. Each stage is a loop over lanes without branches or calls,
which compiles to vector instructions of single precision: positions round to a micrometre in ten metres, and log dQ/dP
under the reference followed, the one large sum, carries its rounding errors along.
"""

import math
from typing import Any

import numpy as np

from pirrht.geometry.field import bilinear, bilinear_slope, border, cell_in_block, finest_cell, walls_of
from pirrht.geometry.space import COLLISION, GOAL, INSIDE
from pirrht.geometry.world import World
from pirrht.jit.jit import inlined, load_float32, load_float64
from pirrht.jit.streams import FAR, GOLDEN, HALF, ONE, TWO, ZERO, exponential, exposure, halves, logarithm, normals_of
from pirrht.outcome import Outcome
from pirrht.rollouts.first_exit import fitting, wall_slope
from pirrht.rollouts.tables import NUMBERS, slope_of, tube_at
from pirrht.rollouts.tuning import TUNING

SLOW = len(Outcome)  # flag of lanes whose step is to be judged by `bridge_exit`
FAR_PER = np.float32(FAR)
MIN_MISSED = np.float32(1e-7)
LANES, WIDE = TUNING.lanes, TUNING.vector
L = LANES + WIDE  # from row to row: not a power of two, or rows would compete for the same places in the cache
# Rows of a block's numbers, each of all lanes: position, noise, where the step leads, what is close before and after.
X, Y, Z0, Z1, NX, NY, C0, E0, G0, C1, E1, G1, PUSH0, PUSH1, SUM0, SUM1, SIGN, LOST = (L * i for i in range(18))
# The step's length and its root, time left in the step of the grid, time spent in it [s], log of what is weighed; of
# the grid cells that the steps lead to, places, one over their width [1/m], and corners, nearest and second; the two
# nearest walls; time of the last step for which half of the guide has not been taken off the sum [s]; of a tube.
DT, ROOT, LEFT, SPENT, LOG_SURVIVAL, EXPOSURE, BEGAN, SINCE = (L * i for i in range(18, 26))
U, V, PER, CORNER, WALL = (L * i for i in (26, 27, 28, 29, 37))

OWED = 43 * L
TUBE = 44 * L
ROWS = 44 + NUMBERS

# Rows of its long integers, and of its bits:
KEY = 0
SAMPLE = L
HIGH = 0
LOW = L

FLAG, CELL, STEP, LISTED, STAGE = (L * i for i in range(5))  # of its short integers; cross-sections passed come last


def aligned(count: int, kind: type) -> Any:
    """Allocate zeros, the first of which begins a vector: across the cache's lines loads run at half the speed."""
    size = np.dtype(kind).itemsize
    raw: Any = np.zeros(count + 64 // size, kind)
    first = -(raw.ctypes.data // size) % (64 // size)
    return raw[first : first + count]


def scratch_of(H: int) -> tuple[Any, ...]:
    """Allocate a block for H references: f, a, log dQ/dP, short and long integers, sequences, bits."""
    numbers = (aligned(rows * L, np.float32) for rows in (ROWS, 2 * H, H))
    short = aligned((4 + H) * L, np.int32)
    return *numbers, short, aligned(2 * L, np.int64), aligned(L, np.uint64), aligned(2 * L, np.uint32)


def single(world: World) -> World:
    """Return a world with its numbers in single precision, as stages take it."""
    names = ("x0", "y0", "spacing", "per", "left", "low", "right", "high")
    numbers: dict[str, Any] = {name: np.float32(getattr(world.static, name)) for name in names}
    goal: Any = tuple(map(np.float32, world.goal))
    radius: Any = np.float32(world.radius)
    return world._replace(static=world.static._replace(**numbers), goal=goal, radius=radius)


@inlined
def row_of(g, each):  # type: ignore[no-untyped-def]
    """Return the first place of a reference's rows, in bounds the compiler sees: else it loads lane by lane."""
    return min(max(g * each * L, 0), 1 << 32)


@inlined
def lane(k):  # type: ignore[no-untyped-def]
    """Return a lane's number, in bounds the compiler sees."""
    return min(max(np.int64(k), 0), LANES)


@inlined
def single_matrix(B):  # type: ignore[no-untyped-def]
    """Return the numbers of B (2, 2), row by row, in single precision."""
    return np.float32(B[0, 0]), np.float32(B[0, 1]), np.float32(B[1, 0]), np.float32(B[1, 1])


@inlined
def fit_steps(times, least, scale, rim, f, short, n):  # type: ignore[no-untyped-def]
    """Fit steps to the places of the lanes (`fitting`); where a step of the grid is over, the next begins."""
    least = np.float32(least)
    scale = np.float32(scale)
    rim = np.float32(rim)
    ends = times.ctypes.data

    for k in range(n):
        i = min(np.int64(short[STEP + k]), times.shape[0] - 2)  # lanes that have ended stand beyond
        whole = np.float32(load_float64(ends, i + 1) - load_float64(ends, i))
        f[LEFT + k] = whole if f[LEFT + k] <= ZERO else f[LEFT + k]
    for k in range(n):
        near = max(min(min(f[C0 + k], f[E0 + k]), max(f[G0 + k], rim)), ZERO)
        dt = fitting(near, f[LEFT + k], least, scale)

        f[DT + k] = dt
        f[ROOT + k] = math.sqrt(dt)
        f[LEFT + k] = f[LEFT + k] - dt


@inlined
def wall_push(field, offset, shift, B, f, short, n):  # type: ignore[no-untyped-def]
    """Write the push B' grad log psi of the two nearest walls, `shift` further away [m]; B: `single_matrix`.

    It uses the cells and corners of `survey`. Nearer than half of the deviation of a step a wall pushes no harder.
    """
    b00, b01, b10, b11 = B
    offset = np.float32(offset)
    shift = np.float32(shift)

    half = HALF * math.sqrt(b00 * b00 + b01 * b01)  # of the deviation of a second
    corners(field, field.second, f, short, CORNER + 4 * L, n)
    for k in range(n):
        at = CORNER + k

        u = f[U + k]
        v = f[V + k]
        per = f[PER + k]

        nearest = bilinear_slope(f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], u, v, per)
        second = bilinear_slope(f[at + 4 * L], f[at + 5 * L], f[at + 6 * L], f[at + 7 * L], u, v, per)
        c, nx, ny, d, mx, my = walls_of(field, f[X + k], f[Y + k], nearest, second)
        widest = half * f[ROOT + k]

        c = max(c + shift, widest)
        d = max(d + shift, widest)
        f[WALL + k], f[WALL + L + k], f[WALL + 2 * L + k] = c, nx, ny
        f[WALL + 3 * L + k], f[WALL + 4 * L + k], f[WALL + 5 * L + k] = d, mx, my

        gx, gy = wall_slope(c, nx, ny, d, mx, my, offset)
        f[PUSH0 + k] = b00 * gx + b10 * gy
        f[PUSH1 + k] = b01 * gx + b11 * gy


@inlined
def tape_control(drift, g, T, active, f, short, a, n):  # type: ignore[no-untyped-def]
    """Write a_g of a control sequence, its row of `ProposalTables.drift`, by address, and the push."""
    row = row_of(g, 2)
    for k in range(n):
        a[row + k] = f[PUSH0 + k]
        a[row + L + k] = f[PUSH1 + k]
    for k in range(n if active > 0 else 0):
        i = np.int64(short[STEP + k])
        if i < active:
            at = 2 * (g * T + i)
            a[row + k] += np.float32(load_float64(drift, at))
            a[row + L + k] += np.float32(load_float64(drift, at + 1))


@inlined
def tube_control(tube, decay, goal, g, h, B, scratch, n):  # type: ignore[no-untyped-def]
    """Write a_g = B' grad log psi of one reference with a tube at the lanes' states, or a_h if `negligible`."""
    f, a, ratio, short, _, _, _ = scratch
    (b00, b01, b10, b11), negligible, count = B, np.float32(-TUNING.negligible), 0

    row = row_of(g, 2)
    stage = STAGE + row_of(g, 1)
    own = row_of(g, 1)
    mine = row_of(h, 2)

    for k in range(n):  # those that count are listed, and looked up lane by lane
        short[LISTED + count] = np.int32(k)
        count += 1 if (g == h) | (ratio[own + k] >= negligible) else 0
    for i in range(count):
        k = lane(short[LISTED + i])
        s = tube_at(tube, np.int64(short[stage + k]), decay, goal, f[X + k], f[Y + k], f, TUBE + k, L)
        short[stage + k] = np.int32(s)
    for k in range(n if count > 0 else 0):
        at = WALL + k
        walls = (f[at], f[at + L], f[at + 2 * L], f[at + 3 * L], f[at + 4 * L], f[at + 5 * L])
        gx, gy = slope_of(f, TUBE + k, L, walls)
        a[row + k] = b00 * gx + b10 * gy
        a[row + L + k] = b01 * gx + b11 * gy
    for k in range(n if g != h else 0):
        over = ratio[own + k] < negligible
        a[row + k] = a[mine + k] if over else a[row + k]
        a[row + L + k] = a[mine + L + k] if over else a[row + L + k]


@inlined
def relax(h, f, a, n):  # type: ignore[no-untyped-def]
    """Take the second half of the lead off the sums: over a step it is the mean of both ends, to second order."""
    row = row_of(h, 2)
    for k in range(n):
        owed = HALF * f[OWED + k]
        f[SUM0 + k] -= a[row + k] * owed
        f[SUM1 + k] -= a[row + L + k] * owed


@inlined
def draw(random, bits, f, n):  # type: ignore[no-untyped-def]
    """Draw the next two normal numbers of each lane."""
    for k in range(n):
        state = random[k] + GOLDEN
        random[k] = state
        bits[HIGH + k], bits[LOW + k] = halves(state)
    for k in range(n):
        one, other = normals_of(bits[HIGH + k], bits[LOW + k])
        f[Z0 + k] = f[SIGN + k] * one
        f[Z1 + k] = f[SIGN + k] * other


@inlined
def move(h, B, f, a, n):  # type: ignore[no-untyped-def]
    """Write where the step leads; its noise Z becomes y = a dt + dw."""
    row, (b00, b01, b10, b11) = row_of(h, 2), B
    for k in range(n):
        root = f[ROOT + k]
        dt = f[DT + k]
        y0 = f[Z0 + k] * root + a[row + k] * dt
        y1 = f[Z1 + k] * root + a[row + L + k] * dt
        f[Z0 + k], f[Z1 + k] = y0, y1
        f[NX + k] = f[X + k] + b00 * y0 + b01 * y1
        f[NY + k] = f[Y + k] + b10 * y0 + b11 * y1


@inlined
def corners(field, grid, f, short, row, n):  # type: ignore[no-untyped-def]
    """Load values of the grid at the corners of the lanes' cells, lane by lane, since addresses defy vector loads."""
    for k in range(n):
        cell = np.int64(short[CELL + k])
        f[row + k] = load_float32(grid, cell)
        f[row + L + k] = load_float32(grid, cell + 1)
        cell += field.stride
        f[row + 2 * L + k] = load_float32(grid, cell)
        f[row + 3 * L + k] = load_float32(grid, cell + 1)


@inlined
def locate(field, f, short, n):  # type: ignore[no-untyped-def]
    """Find the cells that the steps lead to, places in them, and one over their width."""
    if field.table == 0:  # asked once, for loops without branches
        for k in range(n):
            fx, fy, i, j = finest_cell(field, f[NX + k], f[NY + k])
            short[CELL + k] = np.int32(i * np.int32(field.ny) + j)

            f[U + k] = fx - np.float32(i)
            f[V + k] = fy - np.float32(j)
            f[PER + k] = field.per
        return
    for k in range(n):
        fx, fy, i, j = finest_cell(field, f[NX + k], f[NY + k])
        cell, f[U + k], f[V + k], f[PER + k] = cell_in_block(field, fx, fy, i, j)
        short[CELL + k] = np.int32(cell)


@inlined
def survey(arena, f, short, n):  # type: ignore[no-untyped-def]
    """Measure `distances` of the ends of the steps from obstacles, border and goal; arena: `single`."""
    field, (gx, gy), radius = arena.static, arena.goal, arena.radius
    locate(field, f, short, n)
    corners(field, field.nearest, f, short, CORNER, n)
    for k in range(n):
        x, y = f[NX + k], f[NY + k]
        edge = border(field, x, y)

        a = f[CORNER + k]
        b = f[CORNER + L + k]
        c = f[CORNER + 2 * L + k]
        d = f[CORNER + 3 * L + k]

        near = bilinear(a, b, c, d, f[U + k], f[V + k])
        f[C1 + k], f[E1 + k] = near if edge > ZERO else edge, edge
        f[G1 + k] = math.sqrt((x - gx) * (x - gx) + (y - gy) * (y - gy)) - radius


@inlined
def judge(arena, f, short, n):  # type: ignore[no-untyped-def]
    """Flag the lanes whose step ends outside the free space or in the goal; how many."""
    (gx, gy), radius, ended = arena.goal, arena.radius, 0
    for k in range(n):
        dx, dy = f[NX + k] - gx, f[NY + k] - gy
        outcome = GOAL if dx * dx + dy * dy <= radius * radius else INSIDE
        outcome = COLLISION if min(f[C1 + k], f[E1 + k]) <= ZERO else outcome
        short[FLAG + k] = outcome
        ended += 1 if outcome != INSIDE else 0
    return ended


@inlined
def bridge(variance, weighed, f, short, n):  # type: ignore[no-untyped-def]
    """Flag and count lanes whose step may have ended on its way, or that two walls weigh; variance is per second."""
    far, slow = np.float32(FAR * variance), 0
    for k in range(n):
        c0 = f[C0 + k]
        c1 = f[C1 + k]
        e0 = f[E0 + k]
        e1 = f[E1 + k]
        g0 = f[G0 + k]
        g1 = f[G1 + k]

        dx = f[NX + k] - f[X + k]
        dy = f[NY + k] - f[Y + k]
        square = dx * dx + dy * dy
        reach = far * f[DT + k]
        past = (e1 <= ZERO) | (g1 <= ZERO) | (c1 <= ZERO) | (TWO * e0 * e1 < reach) | (TWO * g0 * g1 < reach)
        past |= ((c0 + c1) * (c0 + c1) < square) | ((g0 + g1) * (g0 + g1) < square)
        near, doubt = TWO * c0 * c1 < reach, past
        if weighed:
            d = f[WALL + 3 * L + k]
            doubt |= near & (TWO * d * (d - math.sqrt(square)) < reach)
            missed = max(ONE - exponential(-TWO * max(c0 * c1, ZERO) * FAR_PER / reach), MIN_MISSED)
            f[LOG_SURVIVAL + k] += logarithm(missed) if near and not doubt else ZERO
        else:
            doubt |= near
        short[FLAG + k] = SLOW if doubt else INSIDE
        slow += 1 if doubt else 0
    return slow


@inlined
def expose(variance, f, short, n):  # type: ignore[no-untyped-def]
    """Add the `exposure` of lanes that go on, where a stretch of time ends near a wall; `variance` is per second."""
    far = np.float32(FAR * variance)
    stretch = np.float32(TUNING.stretch)
    deviation = np.float32(math.sqrt(variance))

    for k in range(n):
        since = f[SINCE + k] + f[DT + k]
        c0 = f[BEGAN + k]
        c1 = min(f[C1 + k], f[E1 + k])

        over = since >= stretch
        near = over & (TWO * c0 * c1 < far * since)
        short[FLAG + k] = 1 if near else 0
        f[SINCE + k] = ZERO if over & ~near else since
        f[BEGAN + k] = c1 if over & ~near else c0
    for k in range(n):
        if short[FLAG + k] != 0:
            c1 = min(f[C1 + k], f[E1 + k])
            f[EXPOSURE + k] += exposure(f[BEGAN + k], c1, deviation, f[SINCE + k])
            f[SINCE + k], f[BEGAN + k] = ZERO, c1


@inlined
def add_log_ratios(h, H, f, a, ratio, n):  # type: ignore[no-untyped-def]
    """Add the step to log dQ_h/dP of the lanes that go on, and to log dQ_g/dQ_h of other references.

    The sum for h is large where there is little noise; the others are needed only where they are close to it.
    """
    mine = row_of(h, 2)
    for g in range(H):
        row = row_of(g, 2)
        own = row_of(g, 1)

        if g == h:
            for k in range(n):
                a0 = a[row + k]
                a1 = a[row + L + k]
                dt = f[DT + k]

                term = a0 * (f[Z0 + k] - HALF * a0 * dt) + a1 * (f[Z1 + k] - HALF * a1 * dt) + f[LOST + k]
                total = ratio[own + k] + term
                f[LOST + k] = term - (total - ratio[own + k])
                ratio[own + k] = total
        else:
            for k in range(n):
                a0 = a[row + k]
                a1 = a[row + L + k]
                b0 = a[mine + k]
                b1 = a[mine + L + k]
                dt = f[DT + k]

                term = (a0 - b0) * (f[Z0 + k] - HALF * (a0 + b0) * dt)
                ratio[own + k] += term + (a1 - b1) * (f[Z1 + k] - HALF * (a1 + b1) * dt)


@inlined
def advance(h, window, follows, f, short, a, n):  # type: ignore[no-untyped-def]
    """Take the step of the lanes that go on; sum up noise over the first `window` steps. Returns the most steps taken.

    Of a lead that `follows` the state half is taken off here, half by `relax`.
    """
    row = row_of(h, 2)
    window = np.int32(window)
    most = np.int32(0)
    part = HALF if follows else ONE

    for k in range(n):
        early = short[STEP + k] < window
        dt = f[DT + k]
        f[SUM0 + k] += f[Z0 + k] - part * a[row + k] * dt if early else ZERO
        f[SUM1 + k] += f[Z1 + k] - part * a[row + L + k] * dt if early else ZERO
        f[OWED + k] = dt if early and follows else ZERO
    for k in range(n):
        f[X + k] = f[NX + k]
        f[Y + k] = f[NY + k]

        f[C0 + k] = f[C1 + k]
        f[E0 + k] = f[E1 + k]
        f[G0 + k] = f[G1 + k]

        over = f[LEFT + k] <= ZERO
        f[SPENT + k] = ZERO if over else f[SPENT + k] + f[DT + k]
        step = np.int32(short[STEP + k] + (np.int32(1) if over else np.int32(0)))
        short[STEP + k] = step
        most = max(most, step)
    return most
