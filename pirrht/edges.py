"""Which proposed curves are edges: whether they are free, end in the goal, change the class."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pirrht.clearance import (
    BLOCKED,
    FREE,
    LEAST_STEP,
    UNSURE,
    Field,
    _surely_blocked,
    border,
    clearance,
)
from pirrht.collision import Collision
from pirrht.curves import Curves, along, cut, entry_of_curve
from pirrht.homology import Homology
from pirrht.jit import kernel
from pirrht.scene import Array, Goal
from pirrht.windings import Turns, pairs_of_curve, summed


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
        cut(path.length[-1], s, length[-1])
        share = length.sum(axis=1) / np.maximum(path.length.sum(axis=1), 1e-300)
        return replace(path, length=length, cost=path.cost * share)

    def curve_free(self, start: Array, curvature: Array, length: Array) -> bool:
        """Whether one curve (P pieces) is free."""
        status = certify_curve(self.field, start, curvature, length)
        return bool(status == FREE or (status == UNSURE and self._ask(start, curvature, length)))

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
def certify_point(field, x, y):  # type: ignore[no-untyped-def]
    """FREE, BLOCKED or UNSURE for one position."""
    if clearance(field, x, y) > 0.0:
        return FREE
    return BLOCKED if border(field, x, y) <= 0.0 or _surely_blocked(field, x, y) else UNSURE


@kernel
def certify_curve(field, start, curvature, length):  # type: ignore[no-untyped-def]
    """FREE, BLOCKED or UNSURE for one curve: discs of certified clearance must cover it.

    Where they do not, the walk goes on in small steps: most such curves soon enter an obstacle beyond doubt.
    """
    x, y, theta = start[0], start[1], start[2]
    verdict = FREE
    for p in range(length.shape[0]):
        s, kappa, ux, uy = 0.0, curvature[p], math.cos(theta), math.sin(theta)
        while True:
            if abs(kappa) * s < 1e-9:
                px, py = x + s * ux, y + s * uy
            else:
                end = theta + kappa * s
                px, py = x + (math.sin(end) - uy) / kappa, y - (math.cos(end) - ux) / kappa
            c = clearance(field, px, py)
            if c < LEAST_STEP:
                if border(field, px, py) <= 0.0 or _surely_blocked(field, px, py):
                    return BLOCKED
                verdict = UNSURE
                c = 0.5 * field.spacing
            if s >= length[p]:
                break
            s = min(s + c, length[p])
        if p + 1 < length.shape[0]:
            x, y, theta = along(x, y, theta, kappa, length[p])
    return verdict


@kernel
def surely_free(field, start, curvature, length):  # type: ignore[no-untyped-def]
    """Whether the field alone certifies a curve; it does not tell blocked from unsure."""
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        kappa, total = curvature[p], length[p]
        turns = abs(kappa) * total >= 1e-9
        ux, uy = math.cos(theta), math.sin(theta)
        s = 0.0
        while s < total:
            if turns:
                end = theta + kappa * s
                c = clearance(field, x + (math.sin(end) - uy) / kappa, y - (math.cos(end) - ux) / kappa)
            else:
                c = clearance(field, x + s * ux, y + s * uy)
            if c < LEAST_STEP:
                return False
            s += c
        x, y, theta = along(x, y, theta, kappa, total)
    return clearance(field, x, y) >= LEAST_STEP


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
        cut(length[i], s, cut_length[i])
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
