"""Move along arcs and straight pieces at one speed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import TWO_PI, Curves, along, entry_of_curve, truncate
from pirrht.geometry.certify import certify_curve, surely_free
from pirrht.jit.jit import kernel, part
from pirrht.steering.motion import Motion, MotionKernels
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import pairs_of_curve


@part
def _entry(curves, i, around):  # type: ignore[no-untyped-def]
    start, length, whole = curves.start[i], curves.length[i], 0.0
    for p in range(length.shape[0]):
        whole += length[p]
    if math.hypot(start[0] - around.goal_x, start[1] - around.goal_y) > 1.001 * (around.goal_radius + whole):
        return np.inf
    return entry_of_curve(start, curves.curvature[i], length, around.goal_x, around.goal_y, around.goal_radius)


@part
def _cut(curves, i, s):  # type: ignore[no-untyped-def]
    length, whole, left = curves.length[i], 0.0, 0.0
    for p in range(length.shape[0]):
        whole += length[p]
    truncate(length, s, length)
    for p in range(length.shape[0]):
        left += length[p]
    curves.cost[i] *= left / max(whole, 1e-300)  # a curve of no length costs nothing


@part
def _certify(curves, i, around, prepared):  # type: ignore[no-untyped-def]
    return certify_curve(around.field, curves.start[i], curves.curvature[i], curves.length[i])


@part
def _sure(curves, i, around):  # type: ignore[no-untyped-def]
    return surely_free(around.field, curves.start[i], curves.curvature[i], curves.length[i])


@part
def _pairs(curves, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    curve, head = (curves.start[i], curves.curvature[i], curves.length[i]), (curves.heads[i, 0], curves.heads[i, 1])
    return pairs_of_curve(around.cuts, curve, to_goal, head, marker, turn, count)


@part
def _most(curves):  # type: ignore[no-untyped-def]
    return curves.length.shape[1]


@kernel
def _between(curves, i, share, out):  # type: ignore[no-untyped-def]
    """Write a position, or a pose of a system of three states whose third is the heading."""
    n, length, left = out.shape[0], curves.length[i], 0.0
    x, y, theta = curves.start[i, 0], curves.start[i, 1], curves.start[i, 2]
    if n > 3 or (n == 3 and abs(math.sin(0.5 * (curves.tails[i, 2] - theta))) > 1e-6):  # the third is no heading
        return False
    for p in range(length.shape[0]):
        left += share * length[p]
    for p in range(length.shape[0]):
        x, y, theta = along(x, y, theta, curves.curvature[i, p], min(left, length[p]))
        left = max(0.0, left - length[p])
    out[0], out[1] = x, y
    if n == 3:
        out[2] = theta - TWO_PI * math.floor((theta + math.pi) / TWO_PI)
    return True


def _free(curves: Curves, i: int, space: FreeSpace) -> bool:
    """Ask FCL: one swept capsule where a curve is straight, bisection where it turns."""
    collision, length, pose = space.collision, curves.length[i], tuple(curves.start[i].tolist())
    for kappa, total in zip(curves.curvature[i].tolist(), length.tolist(), strict=True):
        if total <= 0 and not np.all(length <= 0):
            continue
        end = along(*pose, kappa, total)
        if kappa == 0:
            free = bool(collision.segments_free(np.array([pose[:2]]), np.array([end[:2]]))[0])
        else:
            free = collision.bisect_free(lambda s, at=(*pose, kappa): np.array(along(*at, s)[:2]), total)  # type: ignore[misc]
        if not free:
            return False
        pose = end
    return True


def _trajectory(steering: Any, path: Curves) -> Trajectory:
    """Make piecewise constant controls along a path whose rows are consecutive curves."""
    turned = path.curvature * path.length
    heading = path.start[:, 2:] + np.cumsum(turned, axis=1) - turned
    length, keep = path.length.ravel(), path.length.ravel() > 0
    total = float(length.sum())
    return Trajectory(
        controls=steering.controls(heading.ravel()[keep], path.curvature.ravel()[keep]),
        durations=length[keep] / steering.speed, path=path, cost=total * steering.cost_per_meter, length=total,
    )  # fmt: skip


ARCS = Motion(MotionKernels(_entry, _cut, _certify, _sure, _pairs, _most, _between), _free, _trajectory)
