"""Moving the places where a Dubins path bends, sideways and in heading, until no move shortens it.

A taut path is straight between the obstacles it bends around, so its arcs are cut in the middle and the legs
between these places are Dubins curves again: few numbers describe the path, a pattern search settles them.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import kernel
from pirrht.geometry.arcs import along, entry_of_curve
from pirrht.geometry.certify import LEAST_STEP, surely_free
from pirrht.geometry.field import clearance
from pirrht.shortening.dubins_legs import append, approach, key_of_leg
from pirrht.steering.dubins import shortest

LEVELS = 5  # step sizes, each half of the one before
SWEEPS = 2  # passes over the path with one step size
FIRST_STEP = 0.25  # [turning radii], [rad]
GAIN = 1e-6  # a move must save this share of its two legs


@kernel
def settle(task, pose, curvature, length, count):  # type: ignore[no-untyped-def]
    """Settle `count` pieces, in place; number of pieces. There is room for 3 (count + 1)."""
    way, kappa, ell = np.empty((count + 1, 3)), np.zeros((count + 1, 3)), np.zeros((count + 1, 3))
    legs = _legs(pose, curvature, length, count, way, kappa, ell)
    to, trial, stale = np.empty(3), np.empty((2, 2, 3)), np.empty(legs + 1, np.bool_)
    for level in range(LEVELS):
        stale[:] = True  # where a move may succeed, since a neighbour was moved after the last try with this step
        for _ in range(SWEEPS):
            for i in range(1, legs):
                if stale[i]:
                    stale[i] = False
                    if _moves(task, way, kappa, ell, legs, i, FIRST_STEP * 0.5**level, to, trial):
                        stale[i - 1 : i + 2] = True
    count = 0
    for i in range(legs):
        count = append(pose, curvature, length, count, way[i], kappa[i], ell[i])
    return count


@kernel
def _moves(task, way, kappa, ell, legs, i, step, to, trial):  # type: ignore[no-untyped-def]
    """Try the eight moves of way i by one step sideways and in heading; whether one succeeded."""
    moved = False
    for move in range(9):
        if move == 4:
            continue
        side, turn = (move // 3 - 1) * step, (move % 3 - 1) * step
        to[0] = way[i, 0] - side * task.radius * math.sin(way[i, 2])
        to[1] = way[i, 1] + side * task.radius * math.cos(way[i, 2])
        to[2] = way[i, 2] + turn
        moved = _move(task, way, kappa, ell, legs, i, to, trial[0], trial[1]) or moved
    return moved


@kernel
def _legs(pose, curvature, length, count, way, kappa, ell):  # type: ignore[no-untyped-def]
    """Cut every arc but the first piece in the middle; number of legs, of which leg i begins at way[i]."""
    legs, used = 0, 0
    for k in range(3):
        way[0, k] = pose[0, k]
    for p in range(count):
        half = 0.5 * length[p] if p > 0 and curvature[p] != 0.0 else length[p]
        kappa[legs, used], ell[legs, used] = curvature[p], half
        used += 1
        if half < length[p]:
            legs, used = legs + 1, 1
            x, y, theta = along(pose[p, 0], pose[p, 1], pose[p, 2], curvature[p], half)
            way[legs, 0], way[legs, 1], way[legs, 2] = x, y, theta
            kappa[legs, 0], ell[legs, 0] = curvature[p], length[p] - half
    return legs + 1


@kernel
def _last_leg(task, start, kappa, ell):  # type: ignore[no-untyped-def]
    """Write the shortest leg into the disc; its length."""
    left = approach(task, start, 1.0, kappa, ell)
    right = approach(task, start, -1.0, kappa, ell)
    return right if right < left else approach(task, start, 1.0, kappa, ell)


@kernel
def _outside(task, start, kappa, ell):  # type: ignore[no-untyped-def]
    """Whether a leg keeps out of the goal's disc, as all but the last must."""
    return entry_of_curve(start, kappa, ell, task.goal[0], task.goal[1], task.reach) == np.inf


@kernel
def _move(task, way, kappa, ell, legs, i, to, new_kappa, new_ell):  # type: ignore[no-untyped-def]
    """Move way i to a pose if both legs become admissible and shorter together; whether it did."""
    if clearance(task.field, to[0], to[1]) < LEAST_STEP:
        return False
    a, last = way[i - 1], i + 1 == legs
    limit = 0.0
    for k in range(3):
        limit += (1.0 - GAIN) * (ell[i - 1, k] + ell[i, k])
    b = way[i if last else i + 1]
    ahead = (task.goal[0], task.goal[1]) if last else (b[0], b[1])
    rest = math.hypot(ahead[0] - to[0], ahead[1] - to[1]) - (task.reach if last else 0.0)
    if math.hypot(to[0] - a[0], to[1] - a[1]) + rest >= limit:  # no curves are shorter than straight lines
        return False
    first = shortest(a, to, task.radius, new_kappa[0], new_ell[0])
    if first + rest >= limit:
        return False
    if last:
        second = _last_leg(task, to, new_kappa[1], new_ell[1])
    else:
        second = shortest(to, b, task.radius, new_kappa[1], new_ell[1])
    if first + second >= limit or not _outside(task, a, new_kappa[0], new_ell[0]):
        return False
    if not last and not _outside(task, to, new_kappa[1], new_ell[1]):
        return False
    old = key_of_leg(task, a, kappa[i - 1], ell[i - 1], False, way[i, 0], way[i, 1])
    old += key_of_leg(task, way[i], kappa[i], ell[i], last, b[0], b[1])
    new = key_of_leg(task, a, new_kappa[0], new_ell[0], False, to[0], to[1])
    new += key_of_leg(task, to, new_kappa[1], new_ell[1], last, b[0], b[1])
    if new != old:
        return False
    if not (
        surely_free(task.field, a, new_kappa[0], new_ell[0]) and surely_free(task.field, to, new_kappa[1], new_ell[1])
    ):
        return False
    for k in range(3):
        way[i, k] = to[k]
        for side in range(2):
            kappa[i - 1 + side, k], ell[i - 1 + side, k] = new_kappa[side, k], new_ell[side, k]
    return True
