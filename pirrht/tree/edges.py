"""Which proposed curves are edges: whether they are free, end in the goal, change the class."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.freespace import FreeSpace
from pirrht.geometry.arcs import Curves, along, entry_of_curve, truncate
from pirrht.geometry.certify import BLOCKED, FREE, UNSURE, certify_curve, certify_point
from pirrht.geometry.collision import Collision
from pirrht.geometry.field import Field
from pirrht.geometry.scene import Goal
from pirrht.topology.homology import Homology
from pirrht.topology.turns import Turns, pairs_of_curve, summed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """What became of k proposed curves."""

    free: NDArray[np.bool_]  # (k,) usable as an edge
    cost: Array  # (k,) steering cost up to the goal's disc
    turns: Turns  # whole turns an edge adds to the class of its head
    length: Array  # (k, P) piece lengths, cut where a curve enters the goal's disc [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inspector:
    """Judges curves with the clearance field, and asks FCL where the field cannot certify."""

    field: Field
    collision: Collision
    homology: Homology
    goal: Goal

    @classmethod
    def of(cls, space: FreeSpace) -> Inspector:
        """That of an examined scene."""
        return cls(field=space.field, collision=space.collision, homology=space.homology, goal=space.scene.goal)

    def inspect(self, curves: Curves, into_goal: NDArray[np.bool_]) -> Edges:
        """Judge curves.

        A curve that enters the goal is an edge only if its head is a root (`into_goal`); it ends, and is paid
        for, where it first enters the disc. From there its class counts along the straight line to the goal.
        """
        k = len(curves.cost)
        status = np.empty(k, dtype=np.int8)
        first = np.empty(k + 1, dtype=np.int64)
        length, cost = np.empty_like(curves.length), np.empty(k)
        marker, turn, unsure = judge(
            self.field, curves.start, curves.curvature, curves.length, curves.cost, curves.heads,
            into_goal, self.homology.cuts, self.goal.center, self.goal.radius, status, first, length, cost,
        )  # fmt: skip
        for i in np.flatnonzero(status == UNSURE) if unsure else ():
            if self._ask(curves.start[i], curves.curvature[i], length[i]):
                status[i] = FREE
        return Edges(free=status == FREE, cost=cost, turns=Turns(first, marker, turn), length=length)

    def point_free(self, x: Array) -> bool:
        """Whether the robot may be at a state (n,)."""
        status = certify_point(self.field, x[0], x[1])
        return bool(status == FREE or (status == UNSURE and self.collision.free(x[None, :2])[0]))

    def cut_at_goal(self, path: Curves) -> Curves:
        """A path whose last curve ends where it first enters the goal's disc."""
        s = entry_of_curve(path.start[-1], path.curvature[-1], path.length[-1], *self.goal.center, self.goal.radius)
        length = path.length.copy()
        truncate(path.length[-1], s, length[-1])
        share = length.sum(axis=1) / np.maximum(path.length.sum(axis=1), 1e-300)
        return replace(path, length=length, cost=path.cost * share)

    def _ask(self, start: Array, curvature: Array, length: Array) -> bool:
        """FCL's own word on a curve: one swept capsule where it is straight, bisection where it turns."""
        x, y, theta = (float(v) for v in start)
        for kappa, total in zip(curvature, length, strict=True):
            if total <= 0 and not np.all(length <= 0):
                continue
            end = along(x, y, theta, kappa, total)
            if kappa == 0:
                free = bool(self.collision.segments_free(np.array([[x, y]]), np.array([end[:2]]))[0])
            else:
                free = self._arc_free(x, y, theta, kappa, float(total))
            if not free:
                return False
            x, y, theta = end
        return True

    def _arc_free(self, x: float, y: float, theta: float, kappa: float, total: float) -> bool:
        return self.collision.bisect_free(lambda s: np.array(along(x, y, theta, kappa, s)[:2]), total)


@kernel
def judge(field, start, curvature, length, price, heads, into_goal, cuts, goal, radius, status, first, cut_length, cost):  # type: ignore[no-untyped-def] # fmt: skip # noqa: E501
    """What `Inspector.inspect` finds without asking FCL; returns the pairs, and how many curves are unsure."""
    room = length.shape[1] * cuts.M  # pairs that one curve can have
    marker, turn = np.empty(2 * room + 256, np.int32), np.empty(2 * room + 256, np.int16)
    total = np.zeros(cuts.M, np.int16)
    used, unsure = 0, 0
    for i in range(length.shape[0]):
        first[i] = used
        whole, left, s = 0.0, 0.0, np.inf
        for p in range(length.shape[1]):
            whole += length[i, p]
        if math.hypot(start[i, 0] - goal[0], start[i, 1] - goal[1]) <= 1.001 * (radius + whole):
            s = entry_of_curve(start[i], curvature[i], length[i], goal[0], goal[1], radius)
        if s < np.inf and not into_goal[i]:
            status[i] = BLOCKED
            continue
        truncate(length[i], s, cut_length[i])
        status[i] = certify_curve(field, start[i], curvature[i], cut_length[i])
        if status[i] == BLOCKED:
            continue
        unsure += status[i] == UNSURE
        for p in range(length.shape[1]):
            left += cut_length[i, p]
        cost[i] = price[i] * (left / max(whole, 1e-300))
        if used + room > marker.shape[0]:
            marker = np.concatenate((marker, np.empty_like(marker)))
            turn = np.concatenate((turn, np.empty_like(turn)))
        end = pairs_of_curve(
            cuts, start[i], curvature[i], cut_length[i], s < np.inf, heads[i, 0], heads[i, 1], marker, turn, used
        )
        used = summed(total, marker, turn, used, end)
    first[length.shape[0]] = used
    return marker[:used].copy(), turn[:used].copy(), unsure
