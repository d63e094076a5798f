"""Build the legs of a Dubins path, the last of which leads into the goal's disc, and tighten the joints between them.

A shortened path is straight between the obstacles it bends around, so its arcs are divided in the middle and the legs
between these joints are Dubins curves again: few numbers describe the path, a pattern search finds them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.arcs import TWO_PI, along, entry_of_curve, truncate
from pirrht.geometry.certify import LEAST_STEP, surely_free
from pirrht.geometry.field import clearance
from pirrht.jit.jit import kernel
from pirrht.steering.dubins import shortest
from pirrht.topology.crossings import key_of_pairs, pairs_of_curve

SHORT = 1e-9  # pieces below this length [m] are rounding


class Pieces(NamedTuple):
    """Pieces of a path in a row, with room for more: where each begins, and what of it."""

    pose: Array  # (k, 3) x, y [m], heading [rad]
    curvature: Array  # (k,) [1/m]; (k, 3) where three pieces make a leg
    length: Array  # (k,) or (k, 3) as well [m]


@kernel
def approach(around, start, side, curvature, length):  # type: ignore[no-untyped-def]
    """Write the leg from a pose (3,) into the disc that turns to `side`, then heads for the goal point; its length [m].

    It goes to `curvature` (3,) [1/m] and `length` (3,) [m]; `side` is 1 (left) or -1. It meets the disc at right
    angles, as the shortest path into a disc with free heading does. Where the goal point is too close for that, the leg
    is an arc, and infinitely long if the arc misses the disc.
    """
    x, y, theta, radius = start[0], start[1], start[2], around.radius
    vx = around.goal_x - x + side * radius * math.sin(theta)
    vy = around.goal_y - y - side * radius * math.cos(theta)
    square = vx * vx + vy * vy - radius * radius
    curvature[0], curvature[1], curvature[2] = side / radius, 0.0, 0.0
    length[0], length[1], length[2] = TWO_PI * radius, 0.0, 0.0
    if square > 0.0:
        length[1] = math.sqrt(square)
        turn = side * (math.atan2(vy, vx) - theta) + math.atan2(radius, length[1])
        length[0] = radius * (turn - TWO_PI * math.floor(turn / TWO_PI + 1e-12))
    s = entry_of_curve(start, curvature, length, around.goal_x, around.goal_y, around.reach)
    truncate(length, s, length)
    return s


@kernel
def key_of_leg(around, start, curvature, length, last, x, y):  # type: ignore[no-untyped-def]
    """Additive key of the whole turns of a leg from a pose (3,) to (x, y) [m]; the last goes on straight to the goal.

    The leg is `curvature` (P,) [1/m], `length` (P,) [m]. Paths with common ends are homologous exactly when the keys of
    their legs have equal sums.
    """
    most = length.shape[0] * around.weights.shape[0]
    marker, turn = np.empty(most, np.int32), np.empty(most, np.int16)
    count = pairs_of_curve(around.cuts, start, curvature, length, last, x, y, marker, turn, 0)
    return key_of_pairs(marker, turn, 0, count, around.weights)


@kernel
def append(pieces, count, start, curvature, length):  # type: ignore[no-untyped-def]
    """Append a leg from a pose (3,), `curvature` (P,) [1/m], `length` (P,) [m], to `count` pieces; number of pieces.

    Neighbours that turn alike become one.
    """
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        if length[p] < SHORT:
            continue
        if count > 0 and abs(pieces.curvature[count - 1] - curvature[p]) < SHORT:
            pieces.length[count - 1] += length[p]
        else:
            pieces.pose[count, 0], pieces.pose[count, 1], pieces.pose[count, 2] = x, y, theta
            pieces.curvature[count], pieces.length[count] = curvature[p], length[p]
            count += 1
        x, y, theta = along(x, y, theta, curvature[p], length[p])
    return count


LEVELS = 5  # step sizes, each half of the one before
PASSES = 2  # over the path with one step size
FIRST_STEP = 0.25  # [turning radii], [rad]
GAIN = 1e-6  # a move must save this share of its two legs


@kernel
def tighten(around, pieces, count):  # type: ignore[no-untyped-def]
    """Move the joints of `count` of k `Pieces` (k,), in place; number of pieces. k is at least 3 (count + 1)."""
    legs = Pieces(np.empty((count + 1, 3)), np.zeros((count + 1, 3)), np.zeros((count + 1, 3)))
    last = _legs(pieces, count, legs) - 1
    trial, stale = Pieces(np.empty((1, 3)), np.empty((2, 3)), np.empty((2, 3))), np.empty(last + 2, np.bool_)
    for level in range(LEVELS):
        stale[:] = True  # where a move may succeed, since a neighbour was moved after the last try with this step
        for _ in range(PASSES):
            for i in range(1, last + 1):
                if stale[i]:
                    stale[i] = False
                    if _moves(around, legs, last, i, FIRST_STEP * 0.5**level, trial):
                        stale[i - 1 : i + 2] = True
    count = 0
    for i in range(last + 1):
        count = append(pieces, count, legs.pose[i], legs.curvature[i], legs.length[i])
    return count


@kernel
def _moves(around, legs, last, i, step, trial):  # type: ignore[no-untyped-def]
    """Try the eight moves of joint i by one step sideways and in heading; whether one succeeded."""
    moved, joint, to = False, legs.pose[i], trial.pose[0]
    for move in range(9):
        if move == 4:
            continue
        side, turn = (move // 3 - 1) * step, (move % 3 - 1) * step
        to[0] = joint[0] - side * around.radius * math.sin(joint[2])
        to[1] = joint[1] + side * around.radius * math.cos(joint[2])
        to[2] = joint[2] + turn
        moved = _move(around, legs, last, i, trial) or moved
    return moved


@kernel
def _legs(pieces, count, legs):  # type: ignore[no-untyped-def]
    """Divide every arc but the first piece in the middle; number of legs, each of which begins at a joint."""
    made, used, pose = 0, 0, pieces.pose
    for k in range(3):
        legs.pose[0, k] = pose[0, k]
    for p in range(count):
        kappa, half = pieces.curvature[p], pieces.length[p]
        if p > 0 and kappa != 0.0:
            half *= 0.5
        legs.curvature[made, used], legs.length[made, used] = kappa, half
        used += 1
        if half < pieces.length[p]:
            made, used = made + 1, 1
            x, y, theta = along(pose[p, 0], pose[p, 1], pose[p, 2], kappa, half)
            legs.pose[made, 0], legs.pose[made, 1], legs.pose[made, 2] = x, y, theta
            legs.curvature[made, 0], legs.length[made, 0] = kappa, pieces.length[p] - half
    return made + 1


@kernel
def _last_leg(around, start, kappa, ell):  # type: ignore[no-untyped-def]
    """Write the shortest leg into the disc; its length."""
    left = approach(around, start, 1.0, kappa, ell)
    right = approach(around, start, -1.0, kappa, ell)
    return right if right < left else approach(around, start, 1.0, kappa, ell)


@kernel
def _outside(around, start, kappa, ell):  # type: ignore[no-untyped-def]
    """Tell whether a leg keeps out of the goal's disc, as all but the last must."""
    return entry_of_curve(start, kappa, ell, around.goal_x, around.goal_y, around.reach) == np.inf


@kernel
def _move(around, legs, last, i, trial):  # type: ignore[no-untyped-def]
    """Move joint i to the trial's pose if both legs become admissible and shorter together; whether it did."""
    joints, kappa, ell = legs.pose, legs.curvature, legs.length
    to, new_kappa, new_ell = trial.pose[0], trial.curvature, trial.length
    if clearance(around.field, to[0], to[1]) < LEAST_STEP:
        return False
    a, b, ends = joints[i - 1], joints[min(i + 1, last)], i == last
    limit = 0.0
    for k in range(3):
        limit += (1.0 - GAIN) * (ell[i - 1, k] + ell[i, k])
    ahead = (around.goal_x, around.goal_y) if ends else (b[0], b[1])
    rest = math.hypot(ahead[0] - to[0], ahead[1] - to[1]) - (around.reach if ends else 0.0)
    if math.hypot(to[0] - a[0], to[1] - a[1]) + rest >= limit:  # no curves are shorter than straight lines
        return False
    first = shortest(a, to, around.radius, new_kappa[0], new_ell[0])
    if first + rest >= limit:
        return False
    if ends:
        second = _last_leg(around, to, new_kappa[1], new_ell[1])
    else:
        second = shortest(to, b, around.radius, new_kappa[1], new_ell[1])
    if first + second >= limit or not _outside(around, a, new_kappa[0], new_ell[0]):
        return False
    if not ends and not _outside(around, to, new_kappa[1], new_ell[1]):
        return False
    old = key_of_leg(around, a, kappa[i - 1], ell[i - 1], False, joints[i, 0], joints[i, 1])
    old += key_of_leg(around, joints[i], kappa[i], ell[i], ends, b[0], b[1])
    new = key_of_leg(around, a, new_kappa[0], new_ell[0], False, to[0], to[1])
    new += key_of_leg(around, to, new_kappa[1], new_ell[1], ends, b[0], b[1])
    if new != old or not surely_free(around.field, a, new_kappa[0], new_ell[0]):
        return False
    if not surely_free(around.field, to, new_kappa[1], new_ell[1]):
        return False
    for k in range(3):
        joints[i, k] = to[k]
        for side in range(2):
            kappa[i - 1 + side, k], ell[i - 1 + side, k] = new_kappa[side, k], new_ell[side, k]
    return True
