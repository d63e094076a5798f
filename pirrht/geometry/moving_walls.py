"""Bodies that move as walls at a time: how far each is, which way it lies, and how fast it comes."""

from __future__ import annotations

from pirrht.geometry.traffic import outside_of, piece_of, wall_of_body
from pirrht.jit.jit import inlined, kernel

WALL = 5  # numbers of a wall that moves


@kernel
def moving_walls(traffic, x, y, t, within, out):  # type: ignore[no-untyped-def]
    """Write the bodies less than so far from (x, y) [m] at t [s] to rows of `out` (J, WALL); returns how many.

    A row is the clearance [m], the unit vector (x, y) away from the nearest point, and the velocity (x, y) that the
    body has there [m/s]; at a time at which that changes, that from then on.
    """
    count = 0
    for j in range(traffic.J):
        count = _add_wall(traffic, j, x, y, t, within, out, count)
    return count


@kernel
def walls_of_some(traffic, listed, many, x, y, t, within, out):  # type: ignore[no-untyped-def]
    """The same of so many bodies that are `listed` (J,)."""
    count = 0
    for k in range(many):
        count = _add_wall(traffic, listed[k], x, y, t, within, out, count)
    return count


@inlined
def _add_wall(traffic, j, x, y, t, within, out, count):  # type: ignore[no-untyped-def]
    """Write body j to a row of `out` if it is so near; how many rows there are then."""
    ox, oy, yaw, vx, vy, turn, _ = piece_of(traffic, j, t)
    if outside_of(traffic, j, ox, oy, x, y) < within:
        d, nx, ny, ex, ey = wall_of_body(traffic, j, ox, oy, yaw, x, y)
        if d < within:
            out[count, 0], out[count, 1], out[count, 2] = d, nx, ny
            out[count, 3], out[count, 4] = vx - turn * (y - ey - oy), vy + turn * (x - ex - ox)
            count += 1
    return count
