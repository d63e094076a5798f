"""Where the arms of a stencil end: at walls, at the rim of the goal, at the place that FCL's clearance tells.

Arms of a point that all but touches a wall would end in nearly one place, and tell nothing of how the wall runs:
errors of a tenth of a micrometer would decide on the sign of psi there. Theirs are drawn from a place beside the
point, further off the wall.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pirrht.arrays import Array, BoolArray, IntArray
from pirrht.exact.domain import Domain

ARMS = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)])
SECANTS = 20  # steps of the search for the end of an arm at most
CLOSE = 1e-7  # of that end [m]
HUG = 0.1  # a point hugs a wall that one of its arms meets within this share of the spacing


def ends_of_arms(
    domain: Domain, points: Array, free_by: Array, rows: IntArray, heads: Array, spacing: float
) -> tuple[Array, BoolArray]:
    """Where arms of points (K, 2), free by (K,) [m], end that would lead to heads (k, 2): (k, 2) [m]; if at the rim.

    Args:
        rows: (k,) the points that they belong to.
        spacing: h [m].
    """
    tails, room = points[rows], free_by[rows]
    ends, at_goal = _cut(domain, tails, room, heads)
    short = ~at_goal & (np.hypot(*(ends - tails).T) < HUG * spacing)
    hugging = np.unique(rows[short])
    again = np.isin(rows, hugging)
    which = np.searchsorted(hugging, rows[again])
    beside, beside_by = _off_walls(domain, points[hugging], spacing)
    ends[again], at_goal[again] = _cut(domain, beside[which], beside_by[which], heads[again])
    return ends, at_goal


def _off_walls(domain: Domain, points: Array, spacing: float) -> tuple[Array, Array]:
    """Of places half an arm beside points (j, 2) those with most clearance, (j, 2) and (j,) [m]; spacing h [m]."""
    around = points[:, None, :] + 0.5 * spacing * np.vstack([np.zeros(2), ARMS])
    free_by = domain.clearance(around.reshape(-1, 2)).reshape(around.shape[:2])
    best = np.arange(len(points)), np.argmax(np.where(domain.goal.contains(around), -np.inf, free_by), axis=1)
    return around[best], free_by[best]


def _cut(domain: Domain, tails: Array, free_by: Array, heads: Array) -> tuple[Array, BoolArray]:
    """Where ways from tails, free by (k,) [m], to heads first meet a wall or the rim, 3 x (k, 2) [m]; if the rim."""
    clearance, goal = domain.clearance, domain.goal
    span = heads - tails
    full = np.hypot(*span.T)
    unit = span / full[:, None]
    to_goal = goal.center - tails
    along = np.sum(to_goal * unit, axis=1)
    inside = goal.radius**2 - (np.sum(to_goal**2, axis=1) - along**2)
    to_rim = np.where(inside > 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)
    to_rim[(to_rim < 0.0) | (to_rim > full + CLOSE)] = np.inf
    to_wall = _first_zero(lambda k, t: clearance(tails[k] + t[:, None] * unit[k]), free_by, clearance(heads), full)
    length = np.clip(np.minimum(to_rim, to_wall), CLOSE, full)
    return tails + length[:, None] * unit, to_rim <= to_wall


def _first_zero(f: Callable[[IntArray, Array], Array], at_0: Array, at_end: Array, end: Array) -> Array:
    """Zeros (k,) of functions that are positive at 0, in (0, end]; infinite where there is none (Illinois rule)."""
    low, high, f_low, f_high = np.zeros(len(end)), end.copy(), at_0.copy(), at_end.copy()
    side = np.zeros(len(end))
    zero = np.where(at_end <= CLOSE, end, np.inf)
    busy = np.flatnonzero(at_end < 0.0)
    for _ in range(SECANTS):
        t = low[busy] + (high - low)[busy] * f_low[busy] / (f_low - f_high)[busy]
        value = f(busy, t)
        zero[busy] = t
        up, down = busy[value > 0.0], busy[value <= 0.0]
        f_high[up[side[up] > 0.0]] *= 0.5
        f_low[down[side[down] < 0.0]] *= 0.5
        low[up], f_low[up], side[up] = t[value > 0.0], value[value > 0.0], 1.0
        high[down], f_high[down], side[down] = t[value <= 0.0], value[value <= 0.0], -1.0
        busy = busy[np.abs(value) > CLOSE]
        if len(busy) == 0:
            break
    return zero
