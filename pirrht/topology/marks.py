"""Find whole turns of sampled paths about moving markers at rays that move along.

The ray of a marker leaves it away from the goal point. A path completed straight to the goal point, where it waits,
crosses it as often, counter-clockwise positive, as its class differs from that of the goal point itself; the base's
crossings are taken off once. With g the goal point as seen from the marker and r the path's place as seen from the goal
point, a path is on the ray where g x r = 0 and g . r + g . g < 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.jit.jit import inlined, kernel, part
from pirrht.topology.in_time import TimedHomology
from pirrht.topology.tracks import place_at

PER_PIECE = 0.02  # the base is looked at so often [s]


class RayTable(NamedTuple):
    """J markers that move, at the ends of T steps."""

    goal: Array  # (T + 1, 2, J) the goal point as seen from each [m]
    weight: IntArray  # (J,) additive key of one turn
    opening: int  # additive key of the turns that the base takes off

    @classmethod
    def of(cls, homology: TimedHomology, x: Array, times: Array) -> RayTable:
        """Mark paths from x (n,) over steps that end at times (T + 1,) on the clock of moving obstacles [s]."""
        moving = homology.moving
        weight = homology.hash_weights[homology.standing.M :]
        goal = np.empty((len(times), 2, moving.J))
        _seen(moving.tracks, moving.goal, times, goal)
        arrival = moving.arrival(x, float(times[0]))
        fine = np.linspace(times[0], arrival, 2 + int((arrival - times[0]) / PER_PIECE))
        base = np.empty((len(fine), 2, moving.J))
        _seen(moving.tracks, moving.goal, fine, base)
        return cls(goal, weight, int(_opening(base, weight, moving.goal, float(x[0]), float(x[1]))))


SPOT = 4  # numbers of the last place of a path: step, share of it, and place as seen from the goal point [m]
NO_MARKS = RayTable(np.zeros((1, 2, 0)), np.zeros(0, dtype=np.int64), 0)


@kernel
def _seen(tracks, goal, times, out):  # type: ignore[no-untyped-def]
    """Fill `out` (T, 2, J) with the goal point (2,) as seen from each marker at times (T,) [s]."""
    for i in range(times.shape[0]):
        for j in range(out.shape[2]):
            x, y = place_at(tracks, j, times[i])
            out[i, 0, j], out[i, 1, j] = goal[0] - x, goal[1] - y


@inlined
def seen_from(gx, gy, rx, ry):  # type: ignore[no-untyped-def]
    """Return the side of a marker's ray that a place is on and how far along it, where that is negative [m^2]."""
    return gx * ry - gy * rx, gx * rx + gy * ry + gx * gx + gy * gy


@inlined
def turn_at_ray(c, along, d, further):  # type: ignore[no-untyped-def]
    """Turn, -1, 0 or 1, of a step between two places as of `seen_from`, first (c, along), then (d, further)."""
    if (c > 0.0) == (d > 0.0):
        return 0
    if along * abs(d) + further * abs(c) >= 0.0:
        return 0
    return 1 if c > 0.0 else -1


@kernel
def _opening(base, weight, goal, x, y):  # type: ignore[no-untyped-def]
    """Additive key that takes off the turns of the base from (x, y) [m], along which markers are as in (k, 2, J)."""
    key, last = np.int64(0), base.shape[0] - 1
    rx, ry = x - goal[0], y - goal[1]
    for j in range(weight.shape[0]):
        c, along = seen_from(base[0, 0, j], base[0, 1, j], rx, ry)
        for i in range(1, last):
            rest = 1.0 - i / last
            d, further = seen_from(base[i, 0, j], base[i, 1, j], rest * rx, rest * ry)
            key -= turn_at_ray(c, along, d, further) * weight[j]
            c, along = d, further
    return key


@inlined
def goal_from(marks, j, i, share):  # type: ignore[no-untyped-def]
    """Goal point as seen from marker j, a share of step i later than that begins [m]."""
    rest = 1.0 - share
    gx = rest * marks.goal[i, 0, j] + share * marks.goal[i + 1, 0, j]
    return gx, rest * marks.goal[i, 1, j] + share * marks.goal[i + 1, 1, j]


@part
def open_sides(marks, goal, x, y, side, spot):  # type: ignore[no-untyped-def]
    """Write the first sides of (x, y) [m] of rays to `side` (J,), the place to `spot` (SPOT,); goal point (2) [m]."""
    spot[0], spot[1], spot[2], spot[3] = 0.0, 0.0, x - goal[0], y - goal[1]
    for j in range(side.shape[0]):
        side[j], _ = seen_from(marks.goal[0, 0, j], marks.goal[0, 1, j], spot[2], spot[3])


@part
def key_among(marks, goal, i, share, x, y, side, spot):  # type: ignore[no-untyped-def]
    """Additive key of the turns of a step that ends at (x, y) [m], a share of step i later than that begins.

    `side` and `spot` are as the last call has left them. A path hardly ever changes sides: only that is vectorized.
    """
    rx, ry, passed = x - goal[0], y - goal[1], 0
    for j in range(side.shape[0]):
        gx, gy = goal_from(marks, j, i, share)
        c = gx * ry - gy * rx
        passed += (side[j] > 0.0) != (c > 0.0)
        side[j] = c
    key = np.int64(0)
    if passed > 0:
        key = _turns(marks, i, share, rx, ry, side.shape[0], spot)
    spot[0], spot[1], spot[2], spot[3] = i, share, rx, ry
    return key


@kernel
def _turns(marks, i, share, rx, ry, count, spot):  # type: ignore[no-untyped-def]
    """Additive key of the turns from the last place to this one, for all markers."""
    key, before = np.int64(0), int(spot[0])
    for j in range(count):
        gx, gy = goal_from(marks, j, before, spot[1])
        c, along = seen_from(gx, gy, spot[2], spot[3])
        gx, gy = goal_from(marks, j, i, share)
        d, further = seen_from(gx, gy, rx, ry)
        key += turn_at_ray(c, along, d, further) * marks.weight[j]
    return key


@kernel
def key_of_path(marks, goal, states, length):  # type: ignore[no-untyped-def]
    """Additive key of the turns of the first `length` steps of states (T + 1, n), less those of the base."""
    side, spot = np.empty(marks.weight.shape[0]), np.empty(SPOT)
    open_sides(marks, goal, states[0, 0], states[0, 1], side, spot)
    key = np.int64(marks.opening)
    for i in range(length):
        key += key_among(marks, goal, i, 1.0, states[i + 1, 0], states[i + 1, 1], side, spot)
    return key
