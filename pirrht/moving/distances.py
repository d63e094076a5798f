"""Pose moving obstacles at a time and measure how far the robot is from them, in kernels.

All times are on one clock, on which 0 is now. Between two rows of its motion an obstacle keeps its velocity: such a
piece of a motion is given by the pose at a time, the rates at which it changes, and until when it does so. The robot is
a union of discs, in groups (`geometry.polygon`), at a pose of its own: a robot that is a disc is one, at any heading.
"""

import math

import numpy as np

from pirrht.geometry.polygon import ROW as DISC
from pirrht.geometry.shapes import offset_of, outside
from pirrht.jit.jit import inlined, kernel, load_float64, load_int64
from pirrht.moving.tuning import BODY, PARTS, ROW, SOLID, TABLE

LEAD, PERIOD, JUMPING, RADIUS, FASTEST = range(BODY)


@inlined
def clock_of(moving, j):  # type: ignore[no-untyped-def]
    """Return how much later than now the clock of obstacle j's rows is, and when it starts over (0: never) [s]."""
    return load_float64(moving.body, BODY * j + LEAD), load_float64(moving.body, BODY * j + PERIOD)


@inlined
def disc_of(moving, j):  # type: ignore[no-untyped-def]
    """Return the radius of the disc around the origin of obstacle j outside of which the robot is free [m]."""
    return load_float64(moving.body, BODY * j + RADIUS)


@inlined
def fastest_of(moving, j):  # type: ignore[no-untyped-def]
    """Return the greatest speed of any point of obstacle j, jumps aside [m/s]."""
    return load_float64(moving.body, BODY * j + FASTEST)


@inlined
def row_of(moving, j, t, width):  # type: ignore[no-untyped-def]
    """Return the row of obstacle j that begins its piece at t [s], the first after it, the last, and the rows' time."""
    begin = load_int64(moving.parts, PARTS * j)
    end = load_int64(moving.parts, PARTS * j + 1)
    lead, period = clock_of(moving, j)
    now = t + lead
    if period > 0.0 and now > 0.0:
        now -= math.floor(now / period) * period
    low, high = begin, end  # the row that begins the piece is from low on and before high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if load_float64(moving.rows, width * middle) <= now else (low, middle)
    return low, high, end, now


@inlined
def piece_of(moving, j, t):  # type: ignore[no-untyped-def]
    """Return x, y [m] and yaw [rad] of obstacle j at t [s], their rates [1/s], and until when they hold from then."""
    low, high, end, now = row_of(moving, j, t, ROW)
    at = moving.rows + 8 * ROW * low

    past = now - load_float64(at, 0)
    x = load_float64(at, 1)
    y = load_float64(at, 2)
    yaw = load_float64(at, 3)

    if past < 0.0:
        return x, y, yaw, 0.0, 0.0, 0.0, t - past
    if high == end:
        return x, y, yaw, 0.0, 0.0, 0.0, math.inf

    vx = load_float64(at, 4)
    vy = load_float64(at, 5)
    turn = load_float64(at, 6)
    until = t + load_float64(at, ROW) - now

    return x + past * vx, y + past * vy, yaw + past * turn, vx, vy, turn, until


@inlined
def restart_of(moving, j, t):  # type: ignore[no-untyped-def]
    """Return when obstacle j is suddenly elsewhere, next after t [s]; infinity if it never is."""
    if load_float64(moving.body, BODY * j + JUMPING) == 0.0:
        return math.inf
    lead, period = clock_of(moving, j)
    return max(math.floor((t + lead) / period) + 1.0, 1.0) * period - lead


@inlined
def outside_of(moving, j, ox, oy, x, y):  # type: ignore[no-untyped-def]
    """Return a lower bound of the clearance of (x, y) [m] from obstacle j at (ox, oy) [m], at any yaw [m]."""
    return math.sqrt((x - ox) * (x - ox) + (y - oy) * (y - oy)) - disc_of(moving, j)


@inlined
def in_solid(moving, k, u, v, w):  # type: ignore[no-untyped-def]
    """Return a place (u, v, w) [m] of an obstacle's frame in the frame of its solid k [m]."""
    at = moving.solid + 8 * SOLID * k

    dx = u - load_float64(at, 3)
    dy = v - load_float64(at, 4)
    dz = w - load_float64(at, 5)

    return (
        load_float64(at, 6) * dx + load_float64(at, 9) * dy + load_float64(at, 12) * dz,
        load_float64(at, 7) * dx + load_float64(at, 10) * dy + load_float64(at, 13) * dz,
        load_float64(at, 8) * dx + load_float64(at, 11) * dy + load_float64(at, 14) * dz,
    )


@inlined
def clearance_of_solid(moving, k, u, v):  # type: ignore[no-untyped-def]
    """Return the clearance of the least disc at (u, v) [m] in an obstacle's frame from its solid k; -radius inside."""
    form = load_int64(moving.form, TABLE * k)
    if form < 0:
        return _in_table(moving, k, u, v)[0] - moving.robot
    at = moving.solid + 8 * SOLID * k
    x, y, z = in_solid(moving, k, u, v, moving.height)
    return (
        max(outside(form, load_float64(at, 0), load_float64(at, 1), load_float64(at, 2), x, y, z), 0.0) - moving.robot
    )


@inlined
def _in_table(moving, k, u, v):  # type: ignore[no-untyped-def]
    """Return the distance [m] and its gradient at (u, v) [m] in solid k's frame; off the lattice that of its margin."""
    first = load_int64(moving.form, TABLE * k + 1)
    nx = load_int64(moving.form, TABLE * k + 2)
    ny = load_int64(moving.form, TABLE * k + 3)
    pitch = moving.pitch

    fx = (u - load_float64(moving.corner, 2 * k)) / pitch
    fy = (v - load_float64(moving.corner, 2 * k + 1)) / pitch
    gx = min(max(fx, 0.0), nx - 1.0)
    gy = min(max(fy, 0.0), ny - 1.0)

    i = min(int(gx), nx - 2)
    j = min(int(gy), ny - 2)
    p = gx - i
    q = gy - j

    at = first + i * ny + j
    a = load_float64(moving.table, at)
    b = load_float64(moving.table, at + 1)
    c = load_float64(moving.table, at + ny)
    d = load_float64(moving.table, at + ny + 1)

    low = a * (1.0 - q) + b * q
    high = c * (1.0 - q) + d * q
    away = math.sqrt((fx - gx) ** 2 + (fy - gy) ** 2) * pitch
    slope_x = (high - low) / pitch
    slope_y = ((b - a) * (1.0 - p) + (d - c) * p) / pitch

    return low * (1.0 - p) + high * p + away, slope_x, slope_y


@inlined
def offset_of_solid(moving, k, u, v):  # type: ignore[no-untyped-def]
    """Return the vector (x, y) to (u, v) [m] from solid k's nearest point [m], and the gradient of the distance.

    Both are as seen from above, in the frame of its obstacle, and zero inside.
    """
    form = load_int64(moving.form, TABLE * k)
    at = moving.solid + 8 * SOLID * k

    if form < 0:
        d, gx, gy = _in_table(moving, k, u, v)
        return d * gx, d * gy, gx, gy

    a = load_float64(at, 0)
    b = load_float64(at, 1)
    c = load_float64(at, 2)

    x, y, z = in_solid(moving, k, u, v, moving.height)
    d = max(outside(form, a, b, c, x, y, z), 0.0)
    if d <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    x, y, z = offset_of(form, a, b, c, x, y, z)
    ex = load_float64(at, 6) * x + load_float64(at, 7) * y + load_float64(at, 8) * z
    ey = load_float64(at, 9) * x + load_float64(at, 10) * y + load_float64(at, 11) * z
    return ex, ey, ex / d, ey / d


@inlined
def solids_of(moving, j):  # type: ignore[no-untyped-def]
    """Return the numbers of the solids of obstacle j."""
    return range(load_int64(moving.parts, PARTS * j + 2), load_int64(moving.parts, PARTS * j + 3))


@inlined
def turned_back(c, s, dx, dy):  # type: ignore[no-untyped-def]
    """Return a vector (dx, dy) as seen from a body at a yaw of cosine c and sine s."""
    return c * dx + s * dy, c * dy - s * dx


@inlined
def _disc(moving, i, seen):  # type: ignore[no-untyped-def]
    """Return place and radius beyond the least [m] of disc or group i of a robot `_seen` in an obstacle's frame."""
    (u, v, c, s), at = seen, moving.discs + 8 * DISC * i
    a = load_float64(at, 0)
    b = load_float64(at, 1)
    return u + (c * a - s * b), v + (s * a + c * b), load_float64(at, 2)


@inlined
def _seen(moving, body, pose):  # type: ignore[no-untyped-def]
    """Return place [m], and cosine and sine of the heading, of a robot seen from a body (x, y, cosine, sine of yaw)."""
    (ox, oy, c, s), (x, y, th) = body, pose
    u, v = turned_back(c, s, x - ox, y - oy)
    ahead, aside = 1.0, 0.0
    if moving.reach > 0.0:
        ahead, aside = turned_back(c, s, math.cos(th), math.sin(th))
    return u, v, ahead, aside


@inlined
def _nearest(moving, j, seen):  # type: ignore[no-untyped-def]
    """Return the clearance from obstacle j up to the cutoff [m], and the nearest solid and disc or group; else -1."""
    best, which, disc = moving.cutoff, -1, -1
    for g in range(moving.groups):
        row = moving.discs + 8 * DISC * g
        u, v, radius = _disc(moving, g, seen)
        for k in solids_of(moving, j):
            d = clearance_of_solid(moving, k, u, v) - radius
            if d >= best:
                continue
            if d >= moving.near:
                best, which, disc = d, k, g
                continue
            for i in range(np.int64(load_float64(row, 4)), np.int64(load_float64(row, 5))):
                p, q, r = _disc(moving, i, seen)
                d = clearance_of_solid(moving, k, p, q) - r
                if d < best:
                    best, which, disc = d, k, i
    return best, which, disc


@inlined
def clearance_facing(moving, j, body, pose):  # type: ignore[no-untyped-def]
    """Return the clearance of a pose from obstacle j [m], which is at (x, y) [m] and a yaw of a cosine and sine."""
    return _nearest(moving, j, _seen(moving, body, pose))[0]


@inlined
def wall_facing(moving, j, body, pose):  # type: ignore[no-untyped-def]
    """Return clearance, direction (x, y, heading) away from obstacle j's nearest point, and the way (x, y) from there.

    The body is at (x, y) [m] and a yaw of a cosine and sine, the way leads to the robot's centre [m]. Both vectors are
    zero inside of it and beyond the cutoff.
    """
    _, _, c, s = body
    seen = _seen(moving, body, pose)
    best, which, disc = _nearest(moving, j, seen)
    if which < 0:
        return best, 0.0, 0.0, 0.0, 0.0, 0.0
    u, v, _ = _disc(moving, disc, seen)
    du = u - seen[0]
    dv = v - seen[1]

    ex, ey, gx, gy = offset_of_solid(moving, which, u, v)
    size = max(math.sqrt(gx * gx + gy * gy), 1e-300)
    gx, gy = gx / size, gy / size
    ex, ey = ex - du, ey - dv
    return best, c * gx - s * gy, s * gx + c * gy, gy * du - gx * dv, c * ex - s * ey, s * ex + c * ey


@kernel
def moving_clearance(moving, pose, t):  # type: ignore[no-untyped-def]
    """Return the clearance of a pose from all obstacles at t [s], up to the cutoff [m]."""
    x, y, th = pose[0], pose[1], pose[-1]
    best = moving.cutoff
    for j in range(moving.J):
        ox, oy, yaw, _, _, _, _ = piece_of(moving, j, t)
        if outside_of(moving, j, ox, oy, x, y) < best:
            best = min(best, clearance_facing(moving, j, (ox, oy, math.cos(yaw), math.sin(yaw)), (x, y, th)))
    return best
