"""Trace straight pieces in space, and find where they enter the goal's ball."""

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.jit.jit import inlined, kernel
from pirrht.jit.vectors import combined, dot

D = 3  # numbers of a place
_dot = dot(D)
_both = combined(D)


class Pieces(NamedTuple):
    """k straight motions in space at one speed, one row each."""

    path: Array  # (k, 6) both ends [m]
    cost: Array  # (k,) steering cost [cost]
    tails: Array  # (k, n) first states
    heads: Array  # (k, n) last states

    @property
    def start(self) -> Array:
        """Begin and direction of each, a unit vector, (k, 6); those of no length go up."""
        span = self.path[:, D:] - self.path[:, :D]
        length = np.linalg.norm(span, axis=1)[:, None]
        way = np.where(length > 0.0, span / np.maximum(length, 1e-300), np.eye(D)[-1])
        return np.hstack([self.path[:, :D], way])

    def points(self, spacing: float) -> list[Array]:
        """Return both ends of each piece, (2, 3) [m], and no points in between, whatever the `spacing`."""
        return list(self.path.reshape(-1, 2, D))


@inlined
def apart(a, b):  # type: ignore[no-untyped-def]
    """Return the distance of two places in space [m]."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)


@inlined
def entry_of_ball(place, u, length, center, radius):  # type: ignore[no-untyped-def]
    """Return the length [m] along a unit vector u at which a line from a place first touches a ball, or infinity."""
    away = _both(1.0, place, -1.0, center)
    gap = _dot(away, away) - radius * radius
    ahead = -_dot(away, u)
    root = ahead * ahead - gap
    if gap <= 0.0:
        return 0.0
    if root < 0.0 or ahead < 0.0:
        return np.inf
    s = ahead - math.sqrt(root)
    return s if s <= length else np.inf


@kernel
def share_into_ball(a, b, center, radius):  # type: ignore[no-untyped-def]
    """Return the share of a line from a to b [m] after which it first touches a ball, or infinity."""
    length = apart(a, b)
    per = 1.0 / length if length > 0.0 else 0.0
    found = entry_of_ball(a, _both(per, b, -per, a), length, center, radius)
    return found * per if found < np.inf else np.inf


def setting_out(path: Any) -> tuple[Array, Array]:
    """Return where consecutive motions begin, (k, d) [m], and in which direction, unit vectors (k, d)."""
    start = path.start
    if start.shape[1] == 2 * D:
        return start[:, :D], start[:, D:]
    return start[:, :2], np.array([[math.cos(heading), math.sin(heading)] for heading in start[:, 2].tolist()])
