"""Measure polylines, and cut them anew."""

import numpy as np

from pirrht.arrays import Array


def lengths(line: Array) -> Array:
    """Return the length of a polyline (k, d) up to each of its points, (k,) [m]."""
    return np.append(0.0, np.cumsum(np.hypot.reduce(np.diff(line, axis=0), axis=1)))


def interpolated(line: Array, at: Array, places: Array) -> Array:
    """Return points (p, d) at places (p,) on a polyline (k, d) whose points are at places (k,)."""
    return np.column_stack([np.interp(places, at, column) for column in line.T])


def even(line: Array, count: int) -> Array:
    """Return a polyline (k, d) cut anew into `count` points at equal distances, (count, d)."""
    along = lengths(line)
    return interpolated(line, along, np.linspace(0.0, along[-1], count))
