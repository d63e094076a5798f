"""What the clearance from bodies that move costs along one step of a guide, and its first two derivatives.

As `priced` says of what stands, with every body where it is when the step passes a point; each is a wall of its own.
"""

from __future__ import annotations

import math

from pirrht.compiled.jit import kernel
from pirrht.geometry.traffic import outside_of, piece_of, wall_of_body
from pirrht.guidance.ddp import _barrier
from pirrht.rollouts.among import listing, met_on_way


@kernel
def price_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points):  # type: ignore[no-untyped-def]
    """Price [cost] of a step as `price_of` takes it that begins at a time [s]."""
    total = 0.0
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        px, py = x + t * dx + w * bx, y + t * dy + w * by
        for j in range(traffic.lead.shape[0]):
            ox, oy, yaw, _, _, _, _ = piece_of(traffic, j, time + t * dt)
            if outside_of(traffic, j, ox, oy, px, py) < task.margin:
                c, _, _, _, _ = wall_of_body(traffic, j, ox, oy, yaw, px, py)
                value, _, _ = _barrier(c, task.margin, task.least)
                total += value
    return task.price * total * dt / points


@kernel
def expand_among(traffic, task, x, y, dx, dy, bx, by, time, dt, points, found, g, H):  # type: ignore[no-untyped-def]
    """Add its derivatives to those of `expand_price`, if it `found` any, or write them to g (6,) and H (6, 6).

    Returns: whether there are any.
    """
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        px, py = x + t * dx + w * bx, y + t * dy + w * by
        scale = task.price * dt / points
        for j in range(traffic.lead.shape[0]):
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
            _, rise, bend = _barrier(c, task.margin, task.least)
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

    It turns by so much in all [rad]; `held` (HELD,) and `listed` (J,) are scratch.
    """
    way = math.sqrt((mx - x) ** 2 + (my - y) ** 2) * (1.0 + abs(turn)) + traffic.speed * dt
    count = listing(traffic, x, y, t, way, held, listed)
    if t + dt > held[4]:
        count = listing(traffic, x, y, t, math.inf, held, listed)
    return met_on_way(traffic, listed, count, x, y, mx, my, turn, t, dt, 1.0) <= 1.0
