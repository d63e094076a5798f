"""Shorten a Dubins path inside its homology class, under one bound on its curvature.

A round replaces parts of the path by the best chain of Dubins curves between stations along it, a shortest-path problem
of its own, then tightens the joints where the chain bends. New pieces are certified by the clearance field and turn
around the markers as the pieces they replace.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import Curves, along, entry_of_curve
from pirrht.geometry.certify import surely_free
from pirrht.jit.jit import kernel
from pirrht.shortening.dubins_legs import Pieces, append, approach, key_of_leg, tighten
from pirrht.steering.dubins import Dubins, length_between, shortest
from pirrht.steering.motion import Surroundings

ROUNDS = (12, 16)  # stations of each round; more rounds or stations gain a few parts in a thousand
GAIN = 1e-5  # a shortcut must save this share of the path
APART = 0.4  # least distance of stations that shortcuts join, in mean distances


class Stations(NamedTuple):
    """Poses along a path from each of which a leg leads to the next, with room for the disc as the last."""

    legs: Pieces  # (n+1, 3) each
    active: NDArray[np.bool_]  # (n+1,) whether shortcuts may join here
    key: NDArray[np.int64]  # (n+1,) additive key of the path up to a station
    best: Array  # (n+1,) length of the best chain up to it [m]


def shortcut(path: Curves, steering: Dubins, space: FreeSpace, rounds: tuple[int, ...] = ROUNDS) -> Curves:
    """Shorten a path of (k, P) pieces into the goal's disc, or return it: (l, 3) pieces of its class, never longer [m].

    `rounds` are numbers of stations. Kept stretches of the path are not judged again.
    """
    around = Surroundings.of(space, steering.radius)
    room = 9 * (path.length.size + max(rounds) + 1)
    pieces = Pieces(np.empty((room, 3)), np.empty(room), np.empty(room))
    count = _pieces(path.start, path.curvature, path.length, pieces)
    for stations in rounds:
        if count == 0 or 9 * (count + stations + 1) > room:  # each step can at worst triple the pieces
            break
        count = _chain(around, pieces, count, stations)
        count = tighten(around, pieces, count)
    if count == 0 or pieces.length[:count].sum() >= path.length.sum():
        return path
    return in_rows(Pieces(*(part[:count] for part in pieces)), steering.cost_per_meter)


def in_rows(pieces: Pieces, cost_per_meter: float) -> Curves:
    """Arrange consecutive pieces as curves of three pieces each."""
    count = len(pieces.length)
    kappa, ell = np.zeros((2, -(-count // 3), 3))
    kappa.flat[:count], ell.flat[:count] = pieces.curvature, pieces.length
    start = pieces.pose[::3].copy()
    end = np.array(along(*pieces.pose[-1], pieces.curvature[-1], pieces.length[-1]))
    return Curves(
        start=start, curvature=kappa, length=ell, cost=ell.sum(axis=1) * cost_per_meter, tails=start,
        heads=np.vstack([start[1:], end]),
    )  # fmt: skip


@kernel
def _pieces(start, curvature, length, pieces):  # type: ignore[no-untyped-def]
    """Rows of curves as one list of pieces; number of pieces."""
    count = 0
    for i in range(start.shape[0]):
        count = append(pieces, count, start[i], curvature[i], length[i])
    return count


@kernel
def _chain(around, pieces, count, stations):  # type: ignore[no-untyped-def]
    """Replace `count` pieces by the best chain, in place; number of pieces, at most 3 (count + stations)."""
    whole = 0.0
    for p in range(count):
        whole += pieces.length[p]
    room = count + stations + 1
    legs = Pieces(np.empty((room, 3)), np.zeros((room, 3)), np.zeros((room, 3)))
    along_path = Stations(legs, np.empty(room, np.bool_), np.zeros(room, np.int64), np.zeros(room))
    n = _stations(pieces, count, whole / stations, along_path)
    at, key, best = legs.pose, along_path.key, along_path.best
    for i in range(n):
        after, last = min(i + 1, n - 1), i == n - 1
        key[i + 1] = key[i] + key_of_leg(
            around, at[i], legs.curvature[i], legs.length[i], last, at[after, 0], at[after, 1]
        )
    total, source = np.empty(2 * n), np.empty(n + 1, np.int64)
    links = Pieces(at, np.empty((n + 1, 3)), np.empty((n + 1, 3)))
    for j in range(1, n + 1):
        best[j] = best[j - 1] + legs.length[j - 1, 0]
        source[j] = -1
        if j == n or along_path.active[j]:
            _estimate(around, along_path, n, j, total)
            source[j] = _link(around, along_path, n, j, total, links.curvature[j], links.length[j])
    return _collect(legs, n, source, links, pieces)


@kernel
def _stations(pieces, count, spacing, stations):  # type: ignore[no-untyped-def]
    """Divide pieces into intervals of at most `spacing`, one leg each from station i on; their number."""
    n = 0
    since = np.inf
    pose, legs, active = pieces.pose, stations.legs, stations.active
    for p in range(count):
        parts = math.ceil(pieces.length[p] / spacing)
        for i in range(parts):
            x, y, theta = along(pose[p, 0], pose[p, 1], pose[p, 2], pieces.curvature[p], pieces.length[p] * i / parts)
            legs.pose[n, 0], legs.pose[n, 1], legs.pose[n, 2] = x, y, theta
            legs.curvature[n, 0], legs.length[n, 0] = pieces.curvature[p], pieces.length[p] / parts
            active[n] = since > APART * spacing
            since = legs.length[n, 0] if active[n] else since + legs.length[n, 0]
            n += 1
    return n


@kernel
def _estimate(around, stations, n, j, total):  # type: ignore[no-untyped-def]
    """Lengths to station j over a shortcut from i, total[2 i]; j = n is the disc, entered two ways."""
    kappa, ell = np.empty(3), np.empty(3)
    at, active, best = stations.legs.pose, stations.active, stations.best
    for i in range(j):
        total[2 * i], total[2 * i + 1] = np.inf, np.inf
        least = best[j] - best[i]
        if not active[i]:
            continue
        if j == n:
            if math.hypot(around.goal_x - at[i, 0], around.goal_y - at[i, 1]) - around.reach < least:
                total[2 * i] = best[i] + approach(around, at[i], 1.0, kappa, ell)
                total[2 * i + 1] = best[i] + approach(around, at[i], -1.0, kappa, ell)
        elif math.hypot(at[j, 0] - at[i, 0], at[j, 1] - at[i, 1]) < least:
            total[2 * i] = best[i] + length_between(at[i], at[j], around.radius, least)


@kernel
def _link(around, stations, n, j, total, kappa, ell):  # type: ignore[no-untyped-def]
    """Station with the shortest admissible shortcut to j, -1 if none beats best[j]; writes the shortcut."""
    at, best = stations.legs.pose, stations.best
    to = at[min(j, n - 1)]
    while True:
        c = 0
        for i in range(1, 2 * j):
            if total[i] < total[c]:
                c = i
        i = c // 2
        if total[c] >= best[j] * (1.0 - GAIN):
            return -1
        if j == n:
            approach(around, at[i], 1.0 - 2.0 * (c % 2), kappa, ell)
            outside = True
        else:
            shortest(at[i], at[j], around.radius, kappa, ell)
            outside = entry_of_curve(at[i], kappa, ell, around.goal_x, around.goal_y, around.reach) == np.inf
        if outside:
            key = key_of_leg(around, at[i], kappa, ell, j == n, to[0], to[1])
            if key == stations.key[j] - stations.key[i] and surely_free(around.field, at[i], kappa, ell):
                best[j] = total[c]
                return i
        total[c] = np.inf


@kernel
def _collect(legs, n, source, links, pieces):  # type: ignore[no-untyped-def]
    """Write the pieces of the best chain of legs and links; their number."""
    order = np.empty(n + 1, np.int64)
    order[0] = n
    joints = 1
    while order[joints - 1] > 0:
        j = order[joints - 1]
        order[joints] = j - 1 if source[j] < 0 else source[j]
        joints += 1
    count = 0
    for c in range(joints - 2, -1, -1):
        i, j = order[c + 1], order[c]
        if source[j] < 0:
            count = append(pieces, count, legs.pose[i], legs.curvature[i], legs.length[i])
        else:
            count = append(pieces, count, legs.pose[i], links.curvature[j], links.length[j])
    return count
