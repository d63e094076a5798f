"""What the clearance along one step of a guide costs, and its first two derivatives.

A step leads from one position to another, and where its velocity changes by b, along the parabola that bows by b dt / 8
beside the chord: the point at a share t of it is (1 - t) x_0 + t x_1 + t (1 - t) b dt / 2 with b = v_0 - v_1.
"""

from __future__ import annotations

from pirrht.compiled.jit import kernel
from pirrht.guidance.barrier import price


@kernel
def price_of(field, task, x, y, dx, dy, bx, by, dt, points):  # type: ignore[no-untyped-def]
    """Price [cost] of a step of dt [s] from (x, y) by (dx, dy) [m] whose velocity loses (bx, by) [m/s] on the way."""
    total = 0.0
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        value, _, _, _, _, _ = price(field, task.margin, task.least, x + t * dx + w * bx, y + t * dy + w * by)
        total += value
    return task.price * total * dt / points


@kernel
def expand_price(field, task, x, y, dx, dy, bx, by, dt, points, g, H):  # type: ignore[no-untyped-def]
    """Derivatives of `price_of` in both positions and b: gradient to g (6,), Gauss-Newton Hessian to H (6, 6).

    Returns: whether there are any; otherwise nothing is written.
    """
    found = False
    for k in range(1, points + 1):
        t = k / points
        w = 0.5 * t * (1.0 - t) * dt
        value, px, py, xx, xy, yy = price(field, task.margin, task.least, x + t * dx + w * bx, y + t * dy + w * by)
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
