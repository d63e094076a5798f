"""What the clearance from bodies that move costs along one step of a guide, and its first two derivatives.

As `priced` says of what stands, with every body where it is when the step passes a point; each is a wall of its own.
"""

from __future__ import annotations

import math

from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.field import border, with_slope
from pirrht.geometry.listed import listing
from pirrht.geometry.traffic import outside_of, piece_of, wall_of_body
from pirrht.guidance.barrier import barrier
from pirrht.rollouts.among import met_on_way


@inlined
def _inverse_square(c, margin, least):  # type: ignore[no-untyped-def]
    """c^-2 with its tangent at the margin taken off, and its first two derivatives; quadratic below `least`."""
    if c >= margin:
        return 0.0, 0.0, 0.0
    at = max(c, least)
    per, edge = 1.0 / (at * at), 1.0 / (margin * margin)
    rise, bend, down = -2.0 * per / at, 6.0 * per * per, -2.0 * edge / margin
    below = c - at
    value = per + rise * below + 0.5 * bend * below * below - edge - down * (c - margin)
    return value, rise + bend * below - down, bend


@inlined
def _rated(square, c, margin, least):  # type: ignore[no-untyped-def]
    """The barrier of a point, which feels walls as a Brownian motion does, or of any other system."""
    return _inverse_square(c, margin, least) if square else barrier(c, margin, least)


@kernel
def _of_standing(field, task, x, y):  # type: ignore[no-untyped-def]
    """Barrier of a point at (x, y) [m] against what stands: value, gradient (x, y), Gauss-Newton Hessian."""
    value, px, py, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if border(field, x, y) < task.margin:
        for side in range(4):
            c = (x - field.left, field.right - x, y - field.low, field.high - y)[side]
            gx, gy = (1.0, -1.0, 0.0, 0.0)[side], (0.0, 0.0, 1.0, -1.0)[side]
            p, d, h = _inverse_square(c, task.margin, task.least)
            value, px, py, xx, yy = value + p, px + d * gx, py + d * gy, xx + h * gx * gx, yy + h * gy * gy
    for k in range(2):
        c, gx, gy = with_slope(field, field.nearest if k == 0 else field.second, x, y)
        if c >= task.margin:
            break
        p, d, h = _inverse_square(c, task.margin, task.least)
        value, px, py = value + p, px + d * gx, py + d * gy
        xx, xy, yy = xx + h * gx * gx, xy + h * gx * gy, yy + h * gy * gy
    return value, px, py, xx, xy, yy


@kernel
def point_price(field, task, x, y, dx, dy, dt, points):  # type: ignore[no-untyped-def]
    """What `price_of` is to other systems: price [cost] of a point's step from (x, y) by (dx, dy) [m] in dt [s]."""
    total = 0.0
    for k in range(1, points + 1):
        value, _, _, _, _, _ = _of_standing(field, task, x + k / points * dx, y + k / points * dy)
        total += value
    return task.price * total * dt / points


@kernel
def expand_point(field, task, x, y, dx, dy, dt, points, g, H):  # type: ignore[no-untyped-def]
    """Its derivatives, as `expand_price` has them, to g (6,) and H (6, 6); whether there are any."""
    found = False
    for k in range(1, points + 1):
        t = k / points
        value, px, py, xx, xy, yy = _of_standing(field, task, x + t * dx, y + t * dy)
        if value <= 0.0:
            continue
        if not found:
            g[:], H[:, :], found = 0.0, 0.0, True
        scale = task.price * dt / points
        for i in range(2):
            one = scale * (1.0 - t, t)[i]
            g[2 * i] += one * px
            g[2 * i + 1] += one * py
            for j in range(2):
                both = one * (1.0 - t, t)[j]
                H[2 * i, 2 * j] += both * xx
                H[2 * i, 2 * j + 1] += both * xy
                H[2 * i + 1, 2 * j] += both * xy
                H[2 * i + 1, 2 * j + 1] += both * yy
    return found


@kernel
def price_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points, square):  # type: ignore[no-untyped-def]
    """Price [cost] of a step as `price_of` takes it that begins at a time [s]; of a point if `square`."""
    total = 0.0
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        px, py = x + t * dx + w * bx, y + t * dy + w * by
        for j in range(traffic.J):
            ox, oy, yaw, _, _, _, _ = piece_of(traffic, j, time + t * dt)
            if outside_of(traffic, j, ox, oy, px, py) < task.margin:
                c, _, _, _, _ = wall_of_body(traffic, j, ox, oy, yaw, px, py)
                value, _, _ = _rated(square, c, task.margin, task.least)
                total += value
    return task.price * total * dt / points


@kernel
def expand_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points, square, found, g, H):  # type: ignore[no-untyped-def]
    """Add its derivatives to those of `expand_price`, if it `found` any, or write them to g (6,) and H (6, 6).

    Returns: whether there are any.
    """
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        px, py = x + t * dx + w * bx, y + t * dy + w * by
        scale = task.price * dt / points
        for j in range(traffic.J):
            ox, oy, yaw, _, _, _, _ = piece_of(traffic, j, time + t * dt)
            if outside_of(traffic, j, ox, oy, px, py) >= task.margin:
                continue
            c, nx, ny, _, _ = wall_of_body(traffic, j, ox, oy, yaw, px, py)
            if c >= task.margin:
                continue
            if not found:
                g[:], H[:, :], found = 0.0, 0.0, True
            if nx == 0.0 and ny == 0.0:  # inside of it the way out is away from its middle
                size = math.sqrt((px - ox) * (px - ox) + (py - oy) * (py - oy)) + 1e-9
                nx, ny = (px - ox) / size, (py - oy) / size
            _, rise, bend = _rated(square, c, task.margin, task.least)
            for e in range(3):
                one = scale * (1.0 - t, t, w)[e]
                g[2 * e] += one * rise * nx
                g[2 * e + 1] += one * rise * ny
                for i in range(3):
                    both = one * bend * (1.0 - t, t, w)[i]
                    H[2 * e, 2 * i] += both * nx * nx
                    H[2 * e, 2 * i + 1] += both * nx * ny
                    H[2 * e + 1, 2 * i] += both * nx * ny
                    H[2 * e + 1, 2 * i + 1] += both * ny * ny
    return found


@kernel
def touches(traffic, x, y, mx, my, turn, t, dt, held, listed):  # type: ignore[no-untyped-def]
    """Whether a step from (x, y) to (mx, my) [m] that begins at t and takes dt [s] touches a body that moves.

    It turns by so much in all [rad]; `held` is what earlier steps have left (`held_of`), `listed` (J,) is scratch.
    """
    way = math.sqrt((mx - x) ** 2 + (my - y) ** 2) * (1.0 + abs(turn)) + traffic.speed * dt
    count = listing(traffic, x, y, t, way, held, listed)
    if t + dt > held[4]:
        count = listing(traffic, x, y, t, math.inf, held, listed)
    return met_on_way(traffic, listed, count, x, y, mx, my, turn, t, dt, 1.0) <= 1.0
