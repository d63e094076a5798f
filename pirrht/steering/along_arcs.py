"""Motions along arcs and straight pieces: at one speed, or each at the speed that its curvature asks for.

With the cost rate q + (r_v v^2 + r_w w^2) / 2 and w = k v on a piece of curvature k, a meter costs least at the speed
v = sqrt(2 q / (r_v + r_w k^2)); it then costs sqrt(2 q (r_v + r_w k^2)) = 2 q / v.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import TWO_PI, Curves, along, entry_of_curve, truncate
from pirrht.geometry.certify import BLOCKED, UNSURE, certify_curve
from pirrht.geometry.collision import Collision
from pirrht.jit.jit import inlined, kernel
from pirrht.steering.motion import Motion, MotionKernels, Surroundings
from pirrht.steering.trajectory import Trajectory
from pirrht.topology.crossings import pairs_of_curve

SAME = 1e-6  # headings that differ by less are one [rad]


class Arcs(NamedTuple):
    """The arrays of k `Curves` of P pieces that kernels need."""

    start: Array  # (k, 3) x, y [m], heading of travel [rad]
    curvature: Array  # (k, P) [1/m]
    length: Array  # (k, P) [m]
    cost: Array  # (k,) [cost]
    heads: Array  # (k, n) last states


def _record(curves: Curves) -> Arcs:
    return Arcs(curves.start, curves.curvature, curves.length.copy(), curves.cost.copy(), curves.heads)


@inlined
def _entry(arcs, i, around):  # type: ignore[no-untyped-def]
    """Length of curve i, and where on it the goal's disc begins [m]; infinity if it does not."""
    start, length, whole, s = arcs.start[i], arcs.length[i], 0.0, np.inf
    for p in range(length.shape[0]):
        whole += length[p]
    if math.hypot(start[0] - around.goal_x, start[1] - around.goal_y) <= 1.001 * (around.reach + whole):
        s = entry_of_curve(start, arcs.curvature[i], length, around.goal_x, around.goal_y, around.reach)
    return whole, s


@kernel
def _judge(arcs, into_goal, around, status, enters):  # type: ignore[no-untyped-def]
    unsure = 0
    for i in range(status.shape[0]):
        length, left = arcs.length[i], 0.0
        whole, s = _entry(arcs, i, around)
        enters[i] = s < np.inf
        if enters[i] and not into_goal[i]:
            status[i] = BLOCKED
            continue
        truncate(length, s, length)
        status[i] = certify_curve(around.field, arcs.start[i], arcs.curvature[i], length)
        unsure += status[i] == UNSURE
        for p in range(length.shape[0]):
            left += length[p]
        arcs.cost[i] *= left / max(whole, 1e-300)
    return unsure


@inlined
def _pairs(arcs, i, around, to_goal, marker, turn, count):  # type: ignore[no-untyped-def]
    x, y = arcs.heads[i, 0], arcs.heads[i, 1]
    return pairs_of_curve(
        around.cuts, arcs.start[i], arcs.curvature[i], arcs.length[i], to_goal, x, y, marker, turn, count
    )


@inlined
def _most(arcs):  # type: ignore[no-untyped-def]
    return arcs.length.shape[1]


def _ask(arcs: Arcs, i: int, space: FreeSpace) -> bool:
    """Ask FCL: one swept capsule where a curve is straight, bisection where it turns."""
    collision, length = space.collision, arcs.length[i]
    x, y, theta = (float(v) for v in arcs.start[i])
    for kappa, total in zip(arcs.curvature[i], length, strict=True):
        if total <= 0 and not np.all(length <= 0):
            continue
        pose, end = (x, y, theta), along(x, y, theta, kappa, total)
        if kappa == 0:
            free = bool(collision.segments_free(np.array([[x, y]]), np.array([end[:2]]))[0])
        else:
            free = _arc_free(pose, kappa, float(total), collision)
        if not free:
            return False
        x, y, theta = end
    return True


def _arc_free(pose: tuple[float, float, float], kappa: float, total: float, collision: Collision) -> bool:
    return collision.bisect_free(lambda s: np.array(along(*pose, kappa, s)[:2]), total)


def _until_goal(path: Curves, around: Surroundings) -> Curves:
    s = entry_of_curve(path.start[-1], path.curvature[-1], path.length[-1], around.goal_x, around.goal_y, around.reach)
    length = path.length.copy()
    truncate(path.length[-1], s, length[-1])
    share = length.sum(axis=1) / np.maximum(path.length.sum(axis=1), 1e-300)
    return replace(path, length=length, cost=path.cost * share)


def _trajectory(steering: Any, path: Curves) -> Trajectory:
    """Make piecewise constant controls along a path whose rows are consecutive curves."""
    pieces = path.curvature.shape[1]
    heading = path.start[:, 2:] + np.cumsum(path.curvature * path.length, axis=1) - path.curvature * path.length
    length, keep = path.length.ravel(), path.length.ravel() > 0
    total = float(length.sum())
    return Trajectory(
        controls=steering.controls(heading.reshape(-1, pieces).ravel()[keep], path.curvature.ravel()[keep]),
        durations=length[keep] / steering.speed, path=path, cost=total * steering.cost_per_meter, length=total,
    )  # fmt: skip


def _between(path: Curves, i: int, shares: Array) -> Array:
    """States along motion i: positions of a system of two states; poses of one whose third is the heading."""
    n = path.tails.shape[1]
    if n > 3 or (n == 3 and abs(math.remainder(path.tails[i, 2] - path.start[i, 2], TWO_PI)) > SAME):
        return np.empty((0, n))
    length, states = path.length[i], np.empty((len(shares), n))
    for k, s in enumerate(shares * length.sum()):
        pose, left = tuple(float(v) for v in path.start[i]), float(s)
        for curvature, piece in zip(path.curvature[i], length, strict=True):
            pose = along(*pose, curvature, min(left, piece))
            left = max(0.0, left - piece)
        states[k] = pose[:n]
    return states


ARCS = Motion(MotionKernels(_judge, _pairs, _most), _record, _ask, _until_goal, _trajectory, _between)


class PricedArcs(NamedTuple):
    """The arrays of k `Curves` of P pieces that kernels need, with the price of each piece."""

    start: Array  # (k, 3) x, y [m], heading of travel [rad]
    curvature: Array  # (k, P) [1/m]
    length: Array  # (k, P) [m]
    price: Array  # (k, P) [cost/m]
    cost: Array  # (k,) [cost]
    heads: Array  # (k, n) last states


@inlined
def price_of(straight, turning, curvature):  # type: ignore[no-untyped-def]
    """Cost per meter of a curvature [cost/m]; straight = 2 q r_v [cost^2/m^2], turning = 2 q r_w [cost^2]."""
    return math.sqrt(straight + turning * curvature * curvature)


@kernel
def _judge_priced(arcs, into_goal, around, status, enters):  # type: ignore[no-untyped-def]
    unsure = 0
    for i in range(status.shape[0]):
        length = arcs.length[i]
        _, s = _entry(arcs, i, around)
        enters[i] = s < np.inf
        if enters[i] and not into_goal[i]:
            status[i] = BLOCKED
            continue
        if enters[i]:
            truncate(length, s, length)
            arcs.cost[i] = 0.0
            for p in range(length.shape[0]):
                arcs.cost[i] += arcs.price[i, p] * length[p]
        status[i] = certify_curve(around.field, arcs.start[i], arcs.curvature[i], length)
        unsure += status[i] == UNSURE
    return unsure


PRICED = MotionKernels(_judge_priced, ARCS.kernels.pairs, ARCS.kernels.most)


def priced(path: Curves, straight: float, turning: float) -> Curves:
    """Price curves (k, P) as `price_of` does."""
    return replace(path, cost=np.sum(_prices(path.curvature, straight, turning) * path.length, axis=1))


def _prices(curvature: Array, straight: float, turning: float) -> Array:
    return np.asarray(np.sqrt(straight + turning * curvature**2))


@cache
def priced_arcs(q: float, straight: float, turning: float) -> Motion:
    """Make the kind of motions for a rate of cost q [cost/s] and prices of `price_of`."""

    def prices(curvature: Array) -> Array:
        return _prices(curvature, straight, turning)

    def record(curves: Curves) -> PricedArcs:
        length, cost = curves.length.copy(), curves.cost.copy()
        return PricedArcs(curves.start, curves.curvature, length, prices(curves.curvature), cost, curves.heads)

    def until_goal(path: Curves, around: Surroundings) -> Curves:
        return priced(ARCS.until_goal(path, around), straight, turning)

    def trajectory(steering: Any, path: Curves) -> Trajectory:
        """Piecewise constant speeds and turn rates along a path whose rows are consecutive curves."""
        keep = path.length.ravel() > 0
        length, curvature = path.length.ravel()[keep], path.curvature.ravel()[keep]
        speed = 2.0 * q / prices(curvature)
        return Trajectory(
            controls=np.column_stack([speed, curvature * speed]), durations=length / speed, path=path,
            cost=float(path.cost.sum()), length=float(length.sum()),
        )  # fmt: skip

    return Motion(PRICED, record, ARCS.ask, until_goal, trajectory, ARCS.between)
