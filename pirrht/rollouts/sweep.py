"""Find the first exit within a step without position noise: it is swept through the clearance field."""

from __future__ import annotations

import math

import numpy as np

from pirrht.geometry.arcs import entry_of_piece
from pirrht.geometry.field import clearance
from pirrht.jit.jit import inlined, kernel
from pirrht.rollouts.first_exit import COLLISION, GOAL, INSIDE, endpoint_exit
from pirrht.rollouts.tuning import TUNING


@inlined
def turn_of(vx, vy, wx, wy, dx, dy, dt):  # type: ignore[no-untyped-def]
    """Angle [rad] by which a step of dt [s] turns that goes (dx, dy) [m] while its velocity v [m/s] becomes w."""
    square = dx * dx + dy * dy
    if square == 0.0:
        return 0.0
    return max(-TUNING.arc, min(TUNING.arc, dt * ((wy - vy) * dx - (wx - vx) * dy) / square))


@kernel
def sweep_exit(arena, x, y, nx, ny, turn=0.0):  # type: ignore[no-untyped-def]
    """Judge how a step from (x, y) to (nx, ny) [m] without position noise ends, by certified clearances.

    A step that turns [rad] is an arc next to its chord; into the goal it counts as straight.
    Returns: INSIDE or the Outcome, share of the step until the exit.
    """
    exit, share, _ = _march(arena, x, y, nx, ny, turn, 0.0, 0.0)
    return exit, share


@inlined
def sweep_onward(arena, x, y, nx, ny, turn, room):  # type: ignore[no-untyped-def]
    """Judge a step of a path of many: no wall is nearer to (x, y) than `room` [m], as far as is known.

    What the clearances at both ends of a step cover between them is not marched.
    Returns: INSIDE or the Outcome, share of the step until the exit, room at its end.
    """
    arc = math.sqrt(((nx - x) * (nx - x) + (ny - y) * (ny - y)) * (1.0 + 0.25 * turn * turn))
    (gx, gy), reach = arena.goal, arc + arena.radius
    if (gx - x) * (gx - x) + (gy - y) * (gy - y) > reach * reach:
        if arc < room:
            return INSIDE, 1.0, room - arc
        ahead = clearance(arena.field, nx, ny)
        if ahead > 0.0 and arc < room + ahead:
            return INSIDE, 1.0, ahead
        return _march(arena, x, y, nx, ny, turn, room, ahead)
    return _march(arena, x, y, nx, ny, turn, room, 0.0)


@kernel
def _march(arena, x, y, nx, ny, turn, room, ahead):  # type: ignore[no-untyped-def]
    """March what `room` [m] around the start and `ahead` [m] around the end leave open; 0 where nothing is known."""
    length = math.sqrt((nx - x) ** 2 + (ny - y) ** 2)
    if length == 0.0:
        exit, share = endpoint_exit(arena, nx, ny)
        return exit, share, 0.0
    field, (gx, gy) = arena.field, arena.goal
    ux, uy = (nx - x) / length, (ny - y) / length
    until, reach = np.inf, length + arena.radius
    if (gx - x) * (gx - x) + (gy - y) * (gy - y) <= reach * reach:
        until = entry_of_piece(x, y, math.atan2(uy, ux), 0.0, length, gx, gy, arena.radius)
    stop = min(length, until)
    bow, pace = 0.5 * turn / length, 1.0 / math.sqrt(1.0 + 0.25 * turn * turn)
    s = min(stop, room * pace)
    while True:
        aside = bow * s * (length - s)
        c = clearance(field, x + s * ux + aside * uy, y + s * uy - aside * ux)
        if c <= 0.0:
            return COLLISION, s / length, 0.0
        if s >= stop:
            break
        if ahead > 0.0 and length - s < (c + ahead) * pace:
            return INSIDE, 1.0, ahead
        s = min(stop, s + max(c, 0.1 * field.spacing) * pace)
    return (GOAL, until / length, 0.0) if until < np.inf else (INSIDE, 1.0, c)
