"""Motions along arcs and straight pieces, each driven at the speed that its curvature asks for.

With the cost rate q + (r_v v^2 + r_w w^2) / 2 and w = k v on a piece of curvature k, a meter costs least at the speed
v = sqrt(2 q / (r_v + r_w k^2)); it then costs sqrt(2 q (r_v + r_w k^2)) = 2 q / v. All else is as with other arcs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import inlined, kernel
from pirrht.geometry.arcs import Curves, entry_of_curve, truncate
from pirrht.geometry.certify import BLOCKED, UNSURE, certify_curve
from pirrht.steering.along_arcs import ARCS
from pirrht.steering.motion import Motion, MotionKernels, Surroundings
from pirrht.steering.trajectory import Trajectory


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
def _judge(arcs, into_goal, around, status, enters):  # type: ignore[no-untyped-def]
    start, curvature, lengths, price = arcs.start, arcs.curvature, arcs.length, arcs.price
    field, gx, gy, reach = around.field, around.goal_x, around.goal_y, around.reach
    unsure = 0
    for i in range(status.shape[0]):
        length, whole, s = lengths[i], 0.0, np.inf
        for p in range(length.shape[0]):
            whole += length[p]
        if math.hypot(start[i, 0] - gx, start[i, 1] - gy) <= 1.001 * (reach + whole):
            s = entry_of_curve(start[i], curvature[i], length, gx, gy, reach)
        enters[i] = s < np.inf
        if enters[i] and not into_goal[i]:
            status[i] = BLOCKED
            continue
        if enters[i]:
            truncate(length, s, length)
            arcs.cost[i] = 0.0
            for p in range(length.shape[0]):
                arcs.cost[i] += price[i, p] * length[p]
        status[i] = certify_curve(field, start[i], curvature[i], length)
        unsure += status[i] == UNSURE
    return unsure


KERNELS = MotionKernels(_judge, ARCS.kernels.pairs, ARCS.kernels.most)


def priced(path: Curves, straight: float, turning: float) -> Curves:
    """The same curves (k, P) at prices as `price_of` takes them."""
    return replace(path, cost=np.sum(_prices(path.curvature, straight, turning) * path.length, axis=1))


def _prices(curvature: Array, straight: float, turning: float) -> Array:
    return np.asarray(np.sqrt(straight + turning * curvature**2))


@cache
def priced_arcs(q: float, straight: float, turning: float) -> Motion:
    """The kind of motions for a rate of cost q [cost/s] and prices as `price_of` takes them."""

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
            controls=np.column_stack([speed, curvature * speed]),
            durations=length / speed,
            path=path,
            cost=float(path.cost.sum()),
            length=float(length.sum()),
        )

    return Motion(KERNELS, record, ARCS.ask, until_goal, trajectory, ARCS.between)
