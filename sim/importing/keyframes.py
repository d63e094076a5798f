"""Ways through keyframes as Gazebo goes them, and rows between which straight lines are close enough to them.

Gazebo's PoseAnimation takes the share of the time between two keys as the parameter of a cubic between them, whose
tangents are those of Ogre's SimpleSpline (gazebo/common/Animation.cc, ignition-math Spline.cc at tension 0): half the
difference of the neighbours' places, at either end half that of the only neighbour, and where the last place is the
first one half that of its neighbours around the joint. This is a Catmull-Rom spline that is uniform in the number of
the key: unequal times between keys change the pace at a key at once, and not the curve.
"""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array

DEVIATION = 0.005  # of straight lines between rows from the way, at the same time, at most [m]
FINE = 256  # moments looked at between two keys
SPARE = 2e-4  # of the deviation is kept for what happens between those moments and for rounding [m]


def place(keys: Array, times: Array) -> Array:
    """Places (..., 2) [m] at times (...) [s] on the way through keys (k, 3) t [s], x, y [m]."""
    points, tangents = keys[:, 1:], _tangents(keys[:, 1:])
    i = np.clip(np.searchsorted(keys[:, 0], times, side="right") - 1, 0, len(keys) - 2)
    s = ((times - keys[i, 0]) / (keys[i + 1, 0] - keys[i, 0]))[..., None]
    s2, s3 = s * s, s * s * s
    ends = (2 * s3 - 3 * s2 + 1) * points[i] + (3 * s2 - 2 * s3) * points[i + 1]
    return np.asarray(ends + (s3 - 2 * s2 + s) * tangents[i] + (s3 - s2) * tangents[i + 1])


def rows(keys: Array, deviation: float = DEVIATION) -> Array:
    """Rows (l, 3) t [s], x, y [m] on the same way, few, with straight lines between that leave it by so little [m]."""
    shares = np.arange(FINE) / FINE
    times = np.append((keys[:-1, :1] + shares * np.diff(keys[:, :1], axis=0)).ravel(), keys[-1, 0])
    way = np.column_stack([times, place(keys, times)])
    kept, last = [0], len(way) - 1
    while kept[-1] < last:
        kept.append(_farthest(way, kept[-1], last, deviation - SPARE))
    return way[kept]


def _tangents(points: Array) -> Array:
    padded = np.vstack([points[:1], points, points[-1:]])
    if np.array_equal(points[0], points[-1]):
        padded[0], padded[-1] = points[-2], points[1]
    return np.asarray(0.5 * (padded[2:] - padded[:-2]))


def _farthest(way: Array, first: int, last: int, deviation: float) -> int:
    """The number of a moment up to which a straight line from `first` stays close."""
    good, step = first + 1, 1
    while good + step <= last and _close(way[first : good + step + 1], deviation):
        good, step = good + step, 2 * step
    bad = min(good + step, last + 1)
    while bad - good > 1:
        middle = (good + bad) // 2
        if _close(way[first : middle + 1], deviation):
            good = middle
        else:
            bad = middle
    return good


def _close(piece: Array, deviation: float) -> bool:
    shares = (piece[:, :1] - piece[0, 0]) / (piece[-1, 0] - piece[0, 0])
    off = piece[:, 1:] - (piece[0, 1:] + shares * (piece[-1, 1:] - piece[0, 1:]))
    return bool(np.hypot(*off.T).max() <= deviation)
