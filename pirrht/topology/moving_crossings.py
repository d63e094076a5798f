"""Count the whole turns of straight legs and of sampled paths about moving markers, at rays that they cross.

Legs: seen from a marker, a leg, the base of its head and the base of its tail backwards are closed. That winds as often
as it crosses one ray. Of most legs a marker is outside the triangle with the goal point, and they cross nothing.

Sampled paths: the ray of a marker leaves it away from the goal point, and moves along. A path completed straight to the
goal point, where it waits, crosses it as often, counter-clockwise positive, as its class differs from that of the goal
point; the crossings of the base are taken off once. With g the goal point seen from the marker and r the path's place
seen from the goal point, a path is on the ray where g x r = 0 and g . r + g . g < 0.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.geometry.tuning import TUNING as GEOMETRY
from pirrht.jit.jit import inlined, kernel, load_float64, load_int64, part
from pirrht.topology.crossings import NO_CIRCLE, Cuts, crossed
from pirrht.topology.tracks import (
    BOX,
    MarkerTrajectories,
    crossing,
    crossings_of_step,
    crossings_of_waiting,
    places_at,
    rows_of,
    seen_from,
)
from pirrht.topology.tuning import TUNING


class MarkerTable(NamedTuple):
    """Static and moving markers, as kernels take them."""

    cuts: Cuts  # of static markers; they know the goal point
    tracks: MarkerTrajectories
    speed: float  # of bases about moving markers [m/s]


@kernel
def crossings_of_leg(markers, a, b, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    """Append the pairs that a straight leg adds to the class of its head to marker, turn (l,) [turns]; number of pairs.

    It goes from a to b, (3) each [m, m, s]; `to_goal`: b is where it enters the goal's disc, and goes on to the goal
    point. There are `count` pairs already; `markers` is a record with the fields of `MarkerTable`.
    """
    cuts = markers.cuts
    count = crossed(cuts, a[0], a[1], b[0], b[1], NO_CIRCLE, marker, turn, count)
    for j in range(markers.tracks.J):
        whole = whole_turns(markers.tracks, j, (cuts.goal_x, cuts.goal_y), markers.speed, a, b, to_goal)
        if whole != 0:
            marker[count], turn[count] = cuts.M + j, whole
            count += 1
    return count


@kernel
def whole_turns(tracks, j, goal, speed, a, b, to_goal):  # type: ignore[no-untyped-def]
    """Whole turns that a straight edge in space and time adds about moving marker j to the class of its head.

    Seen from the marker the edge, the base of its head and the base of its tail backwards are closed: that winds as
    often as it crosses one ray. Args: `MarkerTrajectories`, j, goal (2) [m], base speed [m/s], tail, head, or where it
    enters the goal's disc, (3) each [m, m, s], and whether it ends there and goes on straight to the goal point.
    """
    gx, gy = goal
    (ax, ay, s), (bx, by, t) = a, b
    late = t if to_goal else t + math.hypot(gx - bx, gy - by) / speed
    if outside(tracks, j, (ax, ay), (bx, by), goal, s, max(s + math.hypot(gx - ax, gy - ay) / speed, late)):
        return 0
    first = seen_from(tracks, j, ax, ay, s)
    last = seen_from(tracks, j, bx, by, t)
    base = crossings_of_base(tracks, j, goal, speed, a, first)
    if to_goal:
        lx, ly = seen_from(tracks, j, gx, gy, t)
        head = crossing(last[0], last[1], lx, ly) - crossings_of_waiting(tracks, j, gx, gy, t, lx, ly)
    else:
        head = crossings_of_base(tracks, j, goal, speed, b, last)
    return crossings_of_step(tracks, j, a, b, first, last) + head - base


@kernel
def crossings_of_base(tracks, j, goal, speed, start, first):  # type: ignore[no-untyped-def]
    """Crossings of the ray of marker j by the base from `start`, less those of waiting at its end forever.

    Start (3) [m, m, s], goal point (2) [m], speed of bases [m/s]; `first` (2) is where the marker sees the start [m].
    """
    (x, y, t), (gx, gy) = start, goal
    arrives = t + math.hypot(gx - x, gy - y) / speed
    last = seen_from(tracks, j, gx, gy, arrives)
    return crossings_of_step(tracks, j, start, (gx, gy, arrives), first, last) - crossings_of_waiting(
        tracks, j, gx, gy, arrives, last[0], last[1]
    )


@kernel
def outside(tracks, j, a, b, goal, s, t):  # type: ignore[no-untyped-def]
    """Return whether moving marker j is surely outside of the triangle a, b, goal, (2,) each [m], from s to t [s]."""
    first = _far_side(a, b, goal)
    second = _far_side(b, goal, a)
    third = _far_side(goal, a, b)

    begin, _, period = rows_of(tracks, j)
    box = load_int64(tracks.first_box, j)
    last = load_int64(tracks.first_box, j + 1)

    now = s
    one = True
    two = True
    three = True

    while one or two or three:
        own, left = now - load_float64(tracks.time, begin), math.inf
        if period > 0.0:
            own -= max(math.floor(own / period), 0.0) * period
            left = period - own
        i = min(max(int(own / TUNING.box_span), 0), last - box - 1)
        if period > 0.0 or i < last - box - 1:
            left = min(left, (i + 1) * TUNING.box_span - own)
        at = tracks.boxes + 8 * BOX * (box + i)

        one = one and _beyond(first, at)
        two = two and _beyond(second, at)
        three = three and _beyond(third, at)

        now += max(left, GEOMETRY.moment)
        if now > t:
            return one or two or three
    return False


@inlined
def _far_side(u, v, w):  # type: ignore[no-untyped-def]
    """Line through u and v [m] as numbers a, b, c: a x + b y - c [m^2] is positive where w [m] is not."""
    (ux, uy), (vx, vy), (wx, wy) = u, v, w
    nx, ny = uy - vy, vx - ux
    if nx * (wx - ux) + ny * (wy - uy) > 0.0:
        nx, ny = -nx, -ny
    return nx, ny, nx * ux + ny * uy


@inlined
def _beyond(line, box):  # type: ignore[no-untyped-def]
    """Return whether all of a box, at its address, has a number of `_far_side` that is positive beyond rounding."""
    a, b, c = line
    x = load_float64(box, 0 if a > 0.0 else 2)

    return a * x + b * load_float64(box, 1 if b > 0.0 else 3) - c > TUNING.outside_margin


class RayTable(NamedTuple):
    """J markers that move, at the ends of T steps."""

    goal: Array  # (T + 1, 2, J) the goal point as seen from each [m]
    weight: IntArray  # (J,) additive key of one turn
    opening: int  # additive key of the turns that the base takes off
    goal_x: float  # goal point [m]
    goal_y: float  # [m]

    @classmethod
    def of(
        cls, tracks: MarkerTrajectories, weight: IntArray, goal: Array, x: Array, times: Array, arrival: float
    ) -> "RayTable":
        """Mark paths from x (n,) over steps that end at times (T + 1,); its base arrives at a time [s].

        `weight` (J,) are the additive keys of one turn, `goal` (2,) is the goal point [m].
        """
        fine = np.linspace(times[0], arrival, 2 + int((arrival - times[0]) / TUNING.base_piece))
        base = x[:2] + np.linspace(0.0, 1.0, len(fine))[:, None] * (goal - x[:2])
        seen, along = (_goal_seen(tracks, goal, some) for some in (times, fine))
        goal_x, goal_y = goal.tolist()
        # At its end, the goal point itself, it is on no ray.
        return cls(
            seen, weight, -int(_key_of_path(cls(along, weight, 0, goal_x, goal_y), base, len(base) - 2)), goal_x, goal_y
        )


SPOT = 4  # numbers of the last place of a path: step, share of it, and place as seen from the goal point [m]
NO_RAYS = RayTable(np.zeros((1, 2, 0)), np.zeros(0, dtype=np.int64), 0, 0.0, 0.0)


class Watch(NamedTuple):
    """Scratch of one path after another."""

    side: Array  # (J,) side of the ray of each moving marker on which the path is
    spot: Array  # (SPOT,) where that was evaluated


WATCH: Any = Watch


def _goal_seen(tracks: MarkerTrajectories, goal: Array, times: Array) -> Array:
    """Return the goal point (2,) as seen from each marker at times (T,) [s], (T, 2, J) [m]."""
    places = np.empty((tracks.J, len(times), 2))
    places_at(tracks, times, places)
    return np.ascontiguousarray(goal[:, None] - places.transpose(1, 2, 0))


@inlined
def side_of_ray(gx, gy, rx, ry):  # type: ignore[no-untyped-def]
    """Return the side of a marker's ray that a place is on and how far along it, where that is negative [m^2]."""
    return gx * ry - gy * rx, gx * rx + gy * ry + gx * gx + gy * gy


@inlined
def turn_at_ray(c, along, d, further):  # type: ignore[no-untyped-def]
    """Turn, -1, 0 or 1, of a step between two places as of `side_of_ray`, first (c, along), then (d, further)."""
    if (c > 0.0) == (d > 0.0) or along * abs(d) + further * abs(c) >= 0.0:
        return 0
    return 1 if c > 0.0 else -1


@inlined
def goal_from(marks, j, i, share):  # type: ignore[no-untyped-def]
    """Goal point as seen from marker j, a share of step i later than that begins [m]."""
    rest = 1.0 - share
    gx = rest * marks.goal[i, 0, j] + share * marks.goal[i + 1, 0, j]
    return gx, rest * marks.goal[i, 1, j] + share * marks.goal[i + 1, 1, j]


@kernel
def watch(marks):  # type: ignore[no-untyped-def]
    """Allocate scratch for paths."""
    return WATCH(np.empty(marks.weight.shape[0]), np.empty(SPOT))


@part
def begin(marks, x, watch):  # type: ignore[no-untyped-def]
    """Note the sides of rays on which a path from a position x begins; return its first additive key."""
    spot = watch.spot
    spot[:] = (0.0, 0.0, x[0] - marks.goal_x, x[1] - marks.goal_y)
    for j in range(watch.side.shape[0]):
        watch.side[j], _ = side_of_ray(marks.goal[0, 0, j], marks.goal[0, 1, j], spot[2], spot[3])
    return np.int64(marks.opening)


@part
def follow(marks, i, share, x, watch):  # type: ignore[no-untyped-def]
    """Additive key of the turns of a step that ends at a position x, a share of step i later than that begins.

    `watch` is as the last call has left it. A path hardly ever changes sides: only that is vectorized.
    """
    side, spot = watch.side, watch.spot
    rx = x[0] - marks.goal_x
    ry = x[1] - marks.goal_y
    passed = 0

    for j in range(side.shape[0]):
        gx, gy = goal_from(marks, j, i, share)
        c = gx * ry - gy * rx
        passed += (side[j] > 0.0) != (c > 0.0)
        side[j] = c
    key = _turns(marks, i, share, rx, ry, side.shape[0], spot) if passed > 0 else np.int64(0)

    spot[0] = i
    spot[1] = share
    spot[2] = rx
    spot[3] = ry

    return key


@kernel
def _turns(marks, i, share, rx, ry, count, spot):  # type: ignore[no-untyped-def]
    """Additive key of the turns from the last place to this one, for all markers."""
    key = np.int64(0)
    before = int(spot[0])

    for j in range(count):
        gx, gy = goal_from(marks, j, before, spot[1])
        c, along = side_of_ray(gx, gy, spot[2], spot[3])
        gx, gy = goal_from(marks, j, i, share)
        d, further = side_of_ray(gx, gy, rx, ry)
        key += turn_at_ray(c, along, d, further) * marks.weight[j]
    return key


@kernel
def _key_of_path(marks, states, length):  # type: ignore[no-untyped-def]
    """Additive key of the turns of the first `length` steps of states (T + 1, n), less those of the base."""
    notes = watch(marks)
    key = begin(marks, states[0], notes)
    for i in range(length):
        key += follow(marks, i, 1.0, states[i + 1], notes)
    return key
