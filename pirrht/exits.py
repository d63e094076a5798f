"""First exit within one step of a sampled path (design of the exit rules; paper, eq. 3 and section III-B).

Between two grid points the path is a Brownian bridge. It crosses a flat wall at distances c0 and c1 with probability
exp(-2 c0 c1 / variance); given that it does, the mean of the first crossing time has a closed form. Where no noise
acts on the position, the step is a straight segment and is swept through the clearance field instead.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pirrht.clearance import border, clearance, interpolate, nearest_label
from pirrht.curves import entry_of_piece

INSIDE, GOAL, COLLISION = 0, 1, 2  # INSIDE: no exit in this step; the others are Outcome's values
FAR = 40.0  # exponents beyond this are taken as certain survival


@njit(cache=True, nogil=True)
def mean_crossing(c0, c1, deviation):  # type: ignore[no-untyped-def]
    """Mean share of the step at which a bridge from distance c0 > 0 first meets the wall, given that it does.

    Args: distances at both ends (the second may be negative) and the standard deviation of the whole step [m].
    """
    a = c0 / deviation
    z = a + abs(c1) / deviation
    mills = 1.0 / z if z > 25.0 else math.sqrt(0.5 * math.pi) * math.exp(0.5 * z * z) * math.erfc(z / math.sqrt(2.0))
    return min(1.0, a * mills)


@njit(cache=True, nogil=True)
def _survival(c0, c1, variance):  # type: ignore[no-untyped-def]
    """Probability that a bridge between two positive distances misses the wall."""
    if c1 <= 0.0:
        return 0.0
    exponent = 2.0 * c0 * c1 / variance
    return 1.0 if exponent > FAR else 1.0 - math.exp(-exponent)


@njit(cache=True, nogil=True)
def _border_survival(field, x, y, nx, ny, vx, vy):  # type: ignore[no-untyped-def]
    alive = _survival(x - field.lower[0], nx - field.lower[0], vx)
    alive *= _survival(field.upper[0] - x, field.upper[0] - nx, vx)
    alive *= _survival(y - field.lower[1], ny - field.lower[1], vy)
    return alive * _survival(field.upper[1] - y, field.upper[1] - ny, vy)


@njit(cache=True, nogil=True)
def _slope(field, x, y):  # type: ignore[no-untyped-def]
    """Unit gradient of the clearance at (x, y)."""
    h = 0.5 * field.spacing
    gx = interpolate(field, field.nearest, x + h, y) - interpolate(field, field.nearest, x - h, y)
    gy = interpolate(field, field.nearest, x, y + h) - interpolate(field, field.nearest, x, y - h)
    size = math.hypot(gx, gy)
    return (gx / size, gy / size) if size > 0.0 else (1.0, 0.0)


@njit(cache=True, nogil=True)
def wall_survival(field, x, y, nx, ny, cov):  # type: ignore[no-untyped-def]
    """Probability that a step from (x, y) to (nx, ny) touches neither obstacle nor border, and the worst distances.

    Args: cov is the covariance (xx, xy, yy) of the step. Each of the two nearest components is a wall of its own.
    Returns: probability, distance before, distance after, variance towards that wall.
    """
    c0 = interpolate(field, field.nearest, x, y)
    edge0, edge1 = border(field, x, y), border(field, nx, ny)
    if edge1 <= 0.0:
        return 0.0, edge0, edge1, max(cov[0], cov[2])
    c1 = interpolate(field, field.nearest, nx, ny)
    reach = max(cov[0], cov[2])
    if c1 > 0.0 and 2.0 * c0 * c1 > FAR * reach and 2.0 * edge0 * edge1 > FAR * reach:
        return 1.0, c0, c1, reach
    alive = _border_survival(field, x, y, nx, ny, cov[0], cov[2])
    if c1 > 0.0 and 2.0 * c0 * c1 > FAR * reach:
        return alive, edge0, edge1, reach
    variance = cov[0]
    if cov[1] != 0.0 or cov[0] != cov[2]:
        gx, gy = _slope(field, x, y)
        variance = cov[0] * gx * gx + 2.0 * cov[1] * gx * gy + cov[2] * gy * gy
    if c1 <= 0.0 or variance <= 0.0:
        return (0.0 if c1 <= 0.0 else alive), c0, c1, max(variance, 1e-300)
    d0, d1 = interpolate(field, field.second, x, y), interpolate(field, field.second, nx, ny)
    if nearest_label(field, x, y) != nearest_label(field, nx, ny):
        alive *= _survival(c0, d1, variance) * _survival(d0, c1, variance)
    else:
        alive *= _survival(c0, c1, variance) * _survival(d0, d1, variance)
    return alive, c0, c1, variance


@njit(cache=True, nogil=True)
def bridge_exit(field, goal, radius, x, y, nx, ny, cov, u_wall, u_goal):  # type: ignore[no-untyped-def]
    """How a noisy step ends and the expected share of the step until it does; u are uniform numbers."""
    alive, c0, c1, variance = wall_survival(field, x, y, nx, ny, cov)
    g0, g1 = math.hypot(x - goal[0], y - goal[1]), math.hypot(nx - goal[0], ny - goal[1])
    ex, ey = (x - goal[0]) / g0, (y - goal[1]) / g0
    goal_variance = cov[0] * ex * ex + 2.0 * cov[1] * ex * ey + cov[2] * ey * ey
    missed = _survival(g0 - radius, g1 - radius, max(goal_variance, 1e-300))
    at_goal, at_wall = u_goal >= missed, u_wall >= alive
    if not at_goal and not at_wall:
        return INSIDE, 1.0
    goal_time = mean_crossing(g0 - radius, g1 - radius, math.sqrt(max(goal_variance, 1e-300)))
    wall_time = mean_crossing(max(c0, 0.0), c1, math.sqrt(max(variance, 1e-300)))
    if at_goal and not (at_wall and wall_time < goal_time):
        return GOAL, goal_time
    return COLLISION, wall_time


@njit(cache=True, nogil=True)
def endpoint_exit(field, goal, radius, nx, ny):  # type: ignore[no-untyped-def]
    """The paper's rule: the step ends the path if its end lies outside the free space or in the goal."""
    if clearance(field, nx, ny) <= 0.0:
        return COLLISION, 1.0
    if math.hypot(nx - goal[0], ny - goal[1]) <= radius:
        return GOAL, 1.0
    return INSIDE, 1.0


@njit(cache=True, nogil=True)
def sweep_exit(field, goal, radius, x, y, nx, ny):  # type: ignore[no-untyped-def]
    """How a step without position noise ends: the straight segment is marched by certified clearances."""
    length = math.hypot(nx - x, ny - y)
    if length == 0.0:
        return endpoint_exit(field, goal, radius, nx, ny)
    ux, uy = (nx - x) / length, (ny - y) / length
    until = entry_of_piece(x, y, math.atan2(uy, ux), 0.0, length, goal[0], goal[1], radius)
    stop = min(length, until)
    s = 0.0
    while True:
        c = clearance(field, x + s * ux, y + s * uy)
        if c <= 0.0:
            return COLLISION, s / length
        if s >= stop:
            break
        s = min(stop, s + max(c, 0.1 * field.spacing))
    return (GOAL, until / length) if until < np.inf else (INSIDE, 1.0)
