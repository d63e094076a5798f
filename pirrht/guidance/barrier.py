"""The price on clearances that noise would use up: c^(-2/3) below a margin, without a step or a kink there."""

from __future__ import annotations

from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.field import border, with_slope


@inlined
def barrier(c, margin, least):  # type: ignore[no-untyped-def]
    """c^(-2/3) with its tangent at the margin taken off, and its first two derivatives; quadratic below `least`."""
    if c >= margin:
        return 0.0, 0.0, 0.0
    at = max(c, least)
    root, edge = at ** (-2.0 / 3.0), margin ** (-2.0 / 3.0)
    rise, bend = -2.0 / 3.0 * root / at, 10.0 / 9.0 * root / (at * at)
    down = -2.0 / 3.0 * edge / margin
    below = c - at
    value = root + rise * below + 0.5 * bend * below * below - edge - down * (c - margin)
    return value, rise + bend * below - down, bend


@kernel
def price(field, margin, least, x, y):  # type: ignore[no-untyped-def]
    """Barrier against the two nearest components and the border at (x, y).

    Returns: value, gradient (x, y) and Gauss-Newton Hessian (xx, xy, yy).
    """
    value, px, py, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if border(field, x, y) < margin:
        for side in range(4):
            c = (x - field.left, field.right - x, y - field.low, field.high - y)[side]
            gx, gy = (1.0, -1.0, 0.0, 0.0)[side], (0.0, 0.0, 1.0, -1.0)[side]
            p, d, h = barrier(c, margin, least)
            value, px, py = value + p, px + d * gx, py + d * gy
            xx, yy = xx + h * gx * gx, yy + h * gy * gy
    c, gx, gy = with_slope(field, field.nearest, x, y)
    if c < margin:
        for k in range(2):
            if k == 1:
                c, gx, gy = with_slope(field, field.second, x, y)
            p, d, h = barrier(c, margin, least)
            value, px, py = value + p, px + d * gx, py + d * gy
            xx, xy, yy = xx + h * gx * gx, xy + h * gx * gy, yy + h * gy * gy
    return value, px, py, xx, xy, yy
