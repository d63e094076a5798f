"""The best chain of shortcuts between stations along a path, a shortest-path problem of its own."""

from __future__ import annotations

import math

import numpy as np

from pirrht.compiled.jit import kernel
from pirrht.geometry.arcs import along, entry_of_curve
from pirrht.geometry.certify import surely_free
from pirrht.shortening.dubins_legs import append, approach, key_of_leg
from pirrht.steering.dubins import length_between, shortest

GAIN = 1e-5  # a shortcut must save this share of the path
APART = 0.4  # least distance of stations that shortcuts join, in mean distances


@kernel
def chain(task, pose, curvature, length, count, stations):  # type: ignore[no-untyped-def]
    """Replace `count` pieces by the best chain, in place; number of pieces, at most 3 (count + stations)."""
    whole = 0.0
    for p in range(count):
        whole += length[p]
    room = count + stations + 1
    at, kappa, ell = np.empty((room, 3)), np.zeros((room, 3)), np.zeros((room, 3))
    active = np.empty(room, np.bool_)
    n = _stations(pose, curvature, length, count, whole / stations, at, kappa, ell, active)
    swept = np.zeros(n + 1, np.int64)
    for i in range(n):
        after = min(i + 1, n - 1)
        swept[i + 1] = swept[i] + key_of_leg(task, at[i], kappa[i], ell[i], i == n - 1, at[after, 0], at[after, 1])
    best, total, source = np.zeros(n + 1), np.empty(2 * n), np.empty(n + 1, np.int64)
    link_kappa, link_ell = np.empty((n + 1, 3)), np.empty((n + 1, 3))
    for j in range(1, n + 1):
        best[j] = best[j - 1] + ell[j - 1, 0]
        source[j] = -1
        if j == n or active[j]:
            _estimate(task, at, active, n, j, best, total)
            source[j] = _link(task, at, n, j, swept, best, total, link_kappa[j], link_ell[j])
    return _collect(at, kappa, ell, n, source, link_kappa, link_ell, pose, curvature, length)


@kernel
def _stations(pose, curvature, length, count, spacing, at, kappa, ell, active):  # type: ignore[no-untyped-def]
    """Cut pieces into intervals of at most `spacing`, one leg each from at[i] on; their number."""
    n = 0
    since = np.inf
    for p in range(count):
        parts = math.ceil(length[p] / spacing)
        for i in range(parts):
            x, y, theta = along(pose[p, 0], pose[p, 1], pose[p, 2], curvature[p], length[p] * i / parts)
            at[n, 0], at[n, 1], at[n, 2] = x, y, theta
            kappa[n, 0], ell[n, 0] = curvature[p], length[p] / parts
            active[n] = since > APART * spacing
            since = ell[n, 0] if active[n] else since + ell[n, 0]
            n += 1
    return n


@kernel
def _estimate(task, at, active, n, j, best, total):  # type: ignore[no-untyped-def]
    """Lengths to station j over a shortcut from i, total[2 i]; j = n is the disc, entered two ways."""
    kappa, ell = np.empty(3), np.empty(3)
    for i in range(j):
        total[2 * i], total[2 * i + 1] = np.inf, np.inf
        room = best[j] - best[i]
        if not active[i]:
            continue
        if j == n:
            if math.hypot(task.goal[0] - at[i, 0], task.goal[1] - at[i, 1]) - task.reach < room:
                total[2 * i] = best[i] + approach(task, at[i], 1.0, kappa, ell)
                total[2 * i + 1] = best[i] + approach(task, at[i], -1.0, kappa, ell)
        elif math.hypot(at[j, 0] - at[i, 0], at[j, 1] - at[i, 1]) < room:
            total[2 * i] = best[i] + length_between(at[i], at[j], task.radius, room)


@kernel
def _link(task, at, n, j, swept, best, total, kappa, ell):  # type: ignore[no-untyped-def]
    """Station with the shortest admissible shortcut to j, -1 if none beats best[j]; writes the shortcut."""
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
            approach(task, at[i], 1.0 - 2.0 * (c % 2), kappa, ell)
            outside = True
        else:
            shortest(at[i], at[j], task.radius, kappa, ell)
            outside = entry_of_curve(at[i], kappa, ell, task.goal[0], task.goal[1], task.reach) == np.inf
        if outside:
            key = key_of_leg(task, at[i], kappa, ell, j == n, to[0], to[1])
            if key == swept[j] - swept[i] and surely_free(task.field, at[i], kappa, ell):
                best[j] = total[c]
                return i
        total[c] = np.inf


@kernel
def _collect(at, kappa, ell, n, source, link_kappa, link_ell, pose, curvature, length):  # type: ignore[no-untyped-def]
    """Write the pieces of the best chain; their number."""
    order = np.empty(n + 1, np.int64)
    order[0] = n
    links = 1
    while order[links - 1] > 0:
        j = order[links - 1]
        order[links] = j - 1 if source[j] < 0 else source[j]
        links += 1
    count = 0
    for c in range(links - 2, -1, -1):
        i, j = order[c + 1], order[c]
        if source[j] < 0:
            count = append(pose, curvature, length, count, at[i], kappa[i], ell[i])
        else:
            count = append(pose, curvature, length, count, at[i], link_kappa[j], link_ell[j])
    return count
