"""Certify by the clearance field that points, segments and curves are free, or blocked beyond doubt.

Clearance is 1-Lipschitz, so a disc of that radius about a free point is free: a march from disc to disc, each begun
where the last one ended, certifies what it covers (paper, `ObstacleFree`).
"""

from __future__ import annotations

import math

from pirrht.geometry.arcs import along, point_along
from pirrht.geometry.field import border, clearance, closest
from pirrht.geometry.tuning import TUNING
from pirrht.jit.addresses import load_float32
from pirrht.jit.jit import inlined, kernel

FREE, UNSURE, BLOCKED = 1, 0, -1
LEAST_STEP = TUNING.least_step


@kernel
def _surely_blocked(field, x, y):  # type: ignore[no-untyped-def]
    """Return whether the Lipschitz upper bound from the nearest grid point is already negative."""
    at, dx, dy, width = closest(field, x, y)
    return load_float32(field.nearest, at) + math.sqrt(dx**2 + dy**2) + width < 0.0


@inlined
def refused(field, x, y):  # type: ignore[no-untyped-def]
    """Return BLOCKED or UNSURE for a point that is not certified to be free."""
    return BLOCKED if border(field, x, y) <= 0.0 or _surely_blocked(field, x, y) else UNSURE


@kernel
def certify_segment(field, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for the segment from (ax, ay) to (bx, by) [m]: certified discs must cover it.

    Where they do not, the walk goes on in small steps: most such segments soon enter an obstacle beyond doubt.
    """
    length, s, verdict = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2), 0.0, FREE
    per = 1.0 / length if length > 0.0 else 0.0
    while True:
        x, y = ax + s * per * (bx - ax), ay + s * per * (by - ay)
        c = clearance(field, x, y)
        if c < LEAST_STEP:
            if refused(field, x, y) == BLOCKED:
                return BLOCKED
            verdict, c = UNSURE, 0.5 * field.spacing
        if s >= length:
            return verdict
        s = min(s + c, length)


@kernel
def certify_point(field, x, y):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for one position (x, y) [m]."""
    return FREE if clearance(field, x, y) > 0.0 else refused(field, x, y)


@kernel
def certify_curve(field, start, curvature, length):  # type: ignore[no-untyped-def]
    """Return FREE, BLOCKED or UNSURE for a curve (3,), (P,) [1/m], (P,) [m]: certified discs must cover it.

    Where they do not, the walk goes on in small steps: most such curves soon enter an obstacle beyond doubt.
    """
    x, y, theta = start[0], start[1], start[2]
    verdict = FREE
    for p in range(length.shape[0]):
        s, kappa, ux, uy = 0.0, curvature[p], math.cos(theta), math.sin(theta)
        while True:
            px, py = point_along(x, y, theta, ux, uy, kappa, s)
            c = clearance(field, px, py)
            if c < LEAST_STEP:
                if refused(field, px, py) == BLOCKED:
                    return BLOCKED
                verdict = UNSURE
                c = 0.5 * field.spacing
            if s >= length[p]:
                break
            s = min(s + c, length[p])
        if p + 1 < length.shape[0]:
            x, y, theta = along(x, y, theta, kappa, length[p])
    return verdict


@kernel
def surely_free(field, start, curvature, length):  # type: ignore[no-untyped-def]
    """Return whether the field alone certifies a curve (3,), (P,) [1/m], (P,) [m]; blocked and unsure are one."""
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        kappa, total = curvature[p], length[p]
        ux, uy = math.cos(theta), math.sin(theta)
        s = 0.0
        while s < total:
            px, py = point_along(x, y, theta, ux, uy, kappa, s)
            c = clearance(field, px, py)
            if c < LEAST_STEP:
                return False
            s += c
        x, y, theta = along(x, y, theta, kappa, total)
    return clearance(field, x, y) >= LEAST_STEP
