"""Cost of the clearance along one step of a guide, from static and from moving obstacles, with two derivatives.

A step leads from one position to another, and where its velocity changes by b, along the parabola that bows by b dt / 8
from the chord: the point at a share t of it is (1 - t) x_0 + t x_1 + t (1 - t) b dt / 2 with b = v_0 - v_1. Moving
obstacles count where they are when the step passes a point; each is a wall of its own.
"""

from __future__ import annotations

import math

from pirrht.geometry.field import border, with_slope
from pirrht.jit.jit import inlined, kernel
from pirrht.moving.broad_phase_cache import listing
from pirrht.moving.distances import outside_of, piece_of, wall_of_body
from pirrht.moving.exits import met_on_way


@inlined
def barrier(c, margin, least, square):  # type: ignore[no-untyped-def]
    """c^-2 if `square`, else c^(-2/3), less its tangent at the margin, and its first two derivatives.

    It is zero beyond the margin and quadratic below `least`. Points feel walls as a Brownian motion does, by c^-2.
    """
    if c >= margin:
        return 0.0, 0.0, 0.0
    at = max(c, least)
    if square:
        value, edge = 1.0 / (at * at), 1.0 / (margin * margin)
        rise, bend, down = -2.0 * value / at, 6.0 * value * value, -2.0 * edge / margin
    else:
        value, edge = at ** (-2.0 / 3.0), margin ** (-2.0 / 3.0)
        rise, bend, down = -2.0 / 3.0 * value / at, 10.0 / 9.0 * value / (at * at), -2.0 / 3.0 * edge / margin
    below = c - at
    value = value + rise * below + 0.5 * bend * below * below - edge - down * (c - margin)
    return value, rise + bend * below - down, bend


@kernel
def price(field, margin, least, x, y, square):  # type: ignore[no-untyped-def]
    """Sum the barrier against the two nearest components and the border at (x, y).

    Returns: value, gradient (x, y) and Gauss-Newton Hessian (xx, xy, yy).
    """
    value, px, py, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if border(field, x, y) < margin:
        for side in range(4):
            c = (x - field.left, field.right - x, y - field.low, field.high - y)[side]
            gx, gy = (1.0, -1.0, 0.0, 0.0)[side], (0.0, 0.0, 1.0, -1.0)[side]
            p, d, h = barrier(c, margin, least, square)
            value, px, py, xx, yy = value + p, px + d * gx, py + d * gy, xx + h * gx * gx, yy + h * gy * gy
    for k in range(2):
        c, gx, gy = with_slope(field, field.nearest if k == 0 else field.second, x, y)
        if c >= margin:
            break
        p, d, h = barrier(c, margin, least, square)
        value, px, py = value + p, px + d * gx, py + d * gy
        xx, xy, yy = xx + h * gx * gx, xy + h * gx * gy, yy + h * gy * gy
    return value, px, py, xx, xy, yy


@kernel
def price_of(field, task, x, y, dx, dy, bx, by, dt, points, square):  # type: ignore[no-untyped-def]
    """Return the price [cost] of a step of dt [s] from (x, y) by (dx, dy) [m] that loses a velocity (bx, by) [m/s]."""
    total = 0.0
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        total += price(field, task.margin, task.least, x + t * dx + w * bx, y + t * dy + w * by, square)[0]
    return task.price * total * dt / points


@kernel
def expand_price(field, task, x, y, dx, dy, bx, by, dt, points, square, g, H):  # type: ignore[no-untyped-def]
    """Differentiate `price_of` in both positions and b: gradient to g (6,), Gauss-Newton Hessian to H (6, 6).

    Returns: whether there are any; otherwise nothing is written.
    """
    found = False
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        at, to = x + t * dx + w * bx, y + t * dy + w * by
        value, px, py, xx, xy, yy = price(field, task.margin, task.least, at, to, square)
        if value <= 0.0:
            continue
        if not found:
            g[:], H[:, :], found = 0.0, 0.0, True
        scale = task.price * dt / points
        for i in range(3):
            one = (1.0 - t, t, w)[i]
            g[2 * i] += scale * one * px
            g[2 * i + 1] += scale * one * py
            for j in range(3):
                both = scale * one * (1.0 - t, t, w)[j]
                H[2 * i, 2 * j] += both * xx
                H[2 * i, 2 * j + 1] += both * xy
                H[2 * i + 1, 2 * j] += both * xy
                H[2 * i + 1, 2 * j + 1] += both * yy
    return found


@kernel
def price_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points, square):  # type: ignore[no-untyped-def]
    """Return the price [cost] of moving obstacles for a step (`price_of`) that begins at a time [s]."""
    total = 0.0
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        px, py = x + t * dx + w * bx, y + t * dy + w * by
        for j in range(traffic.J):
            ox, oy, yaw, _, _, _, _ = piece_of(traffic, j, time + t * dt)
            if outside_of(traffic, j, ox, oy, px, py) < task.margin:
                c = wall_of_body(traffic, j, ox, oy, yaw, px, py)[0]
                total += barrier(c, task.margin, task.least, square)[0]
    return task.price * total * dt / points


@kernel
def expand_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points, square, found, g, H):  # type: ignore[no-untyped-def]
    """Differentiate `price_among`: add to g (6,) and H (6, 6) if `found`, else write them; return whether any are."""
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
            if nx == 0.0 and ny == 0.0:  # inside, away from its middle
                size = math.sqrt((px - ox) * (px - ox) + (py - oy) * (py - oy)) + 1e-9
                nx, ny = (px - ox) / size, (py - oy) / size
            _, rise, bend = barrier(c, task.margin, task.least, square)
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
    """Check whether a step from (x, y) to (mx, my) [m] that begins at t and takes dt [s] touches a moving obstacle.

    It turns by `turn` in all [rad]; `held` is from earlier steps (`held_of`), `listed` (J,) is scratch.
    """
    way = math.sqrt((mx - x) ** 2 + (my - y) ** 2) * (1.0 + abs(turn)) + traffic.speed * dt
    count = listing(traffic, x, y, t, way, held, listed)
    if t + dt > held[4]:
        count = listing(traffic, x, y, t, math.inf, held, listed)
    return met_on_way(traffic, listed, count, x, y, mx, my, turn, t, dt, 1.0) <= 1.0
