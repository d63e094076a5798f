"""Angles and distances between a heading and a goal's disc or a place."""

from __future__ import annotations

import math
from typing import NamedTuple

from pirrht.arrays import Array
from pirrht.jit.jit import inlined


class HomingTuning(NamedTuple):
    """Numbers of the controls by which samples home that outlive their proposal."""

    # Share of the goal's radius that is aimed at: the rim itself is missed under noise.
    aim: float = 0.9
    # Turn rate per heading error, and acceleration per error of the speed [1/s]: faster than noise turns robots.
    gain: float = 3.0
    # A rover drives where the disc lies less than pi / 2 over this to the side: faster it would circle around it.
    narrow: float = 3.0
    # A rover's turn rate at most, in those that the rate of cost asks for.
    rover_turn: float = 1.5
    # A car's turn rate at most, in turn rates whose noise costs as much as time.
    steepest: float = 6.0
    # Share of the cruising speed at which a car with inertia turns.
    slowest: float = 0.2


HOMING = HomingTuning()


@inlined
def wrapped(angle):  # type: ignore[no-untyped-def]
    """Wrap an angle to within half a turn of zero [rad]."""
    if -math.pi <= angle < math.pi:  # as nearly all are: a division waits longer than this asks
        return angle
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@inlined
def beyond_disc(dx, dy, theta, radius):  # type: ignore[no-untyped-def]
    """Angle to turn until a disc (dx, dy) [m] away lies ahead of a heading; 0 if it does [rad]."""
    off = wrapped(math.atan2(dy, dx) - theta)
    within = math.asin(min(1.0, HOMING.aim * radius / math.sqrt(dx * dx + dy * dy + 1e-12)))
    return max(0.0, off - within) + min(0.0, off + within)


def ahead(x: Array, place: Array) -> float:
    """Distance [m] along the heading from a state that begins with x, y [m] and heading [rad] to a place (2,)."""
    return math.cos(x[2]) * float(place[0] - x[0]) + math.sin(x[2]) * float(place[1] - x[1])
