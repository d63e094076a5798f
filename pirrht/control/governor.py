"""Keep to speeds from which a robot can stop in what is free, as the dynamic window does (Fox, Burgard, Thrun 1997).

Plans change speeds at once, and wheels with inertia do not. A control is admissible if the robot, which drives on under
it until it has braked, meets nothing. Of one that is not, the largest admissible share is taken: the curvature of the
path stays. Where no share is, the robot turns on the spot if that is free.

A robot that a lidar guides also stops before what its lidar never showed on its blind side: it turns to look.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Law, Plan
from pirrht.geometry.space import Space, at_states, pose_at
from pirrht.geometry.world import Moving, NoMoving
from pirrht.mapping.blind_side import BlindSide
from pirrht.systems.dynamics import Dynamics


class GovernorTuning(NamedTuple):
    """Numbers of the governor."""

    lag: float = 0.2  # time until brakes act: wheels are not at the speed that was commanded, and plans are old [s]
    every: float = 0.02  # time for which a share is kept [s]
    spacing: float = 0.04  # of the poses on the way that are judged [m]
    shares: tuple[float, ...] = (0.85, 0.7, 0.55, 0.4, 0.25, 0.1)  # of a control that is not admissible, in turn
    look_rate: float = 2.0  # rate at which the robot turns to look [rad/s]


TUNING = GovernorTuning()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Governor:
    """Lowers controls, velocities of a robot, to those from which it can stop, among static and moving obstacles."""

    dynamics: Dynamics
    static: Space
    deceleration: float  # [m/s^2]
    moving: Moving = field(default_factory=NoMoving)
    now: float = 0.0  # when the plan begins, on the clock of moving obstacles [s]
    blind: BlindSide | None = None  # of the lidar that guides the robot
    tuning: GovernorTuning = TUNING

    def admissible(self, x: Array, u: Array, s: float = 0.0) -> Array:
        """Return the largest admissible share of a control (m,) at state x (n,), or what of it moves no place.

        It is s [s] after the plan began. If the way is hidden, the robot turns in addition.
        """
        way = self._way(x, u)
        hidden = self._hidden(way)
        if not hidden and self._free(way, s):
            return u
        gain = self._gain(x)
        onward = np.linalg.pinv(gain) @ (gain @ u)
        if hidden and (looking := self._looking(x, onward, s)) is not None:
            return looking
        for share in self.tuning.shares[-1:] if hidden else self.tuning.shares:
            if self._free(self._way(x, share * u), s):
                return share * u
        spot = u - onward
        return spot if self._free(self._way(x, spot), s) else np.zeros(len(u))

    def _looking(self, x: Array, onward: Array, s: float) -> Array | None:
        """Return the largest share of a control (m,) with a turn on the spot, to look; None: no turn is free."""
        assert self.blind is not None
        gain = self._gain(x)
        turn = np.ones(len(onward))
        turn -= np.linalg.pinv(gain) @ (gain @ turn)
        turn *= self.tuning.look_rate / np.hypot.reduce(turn)
        for side in (self.blind.side, -self.blind.side):
            for share in (*self.tuning.shares, 0.0):
                u = share * onward + side * turn
                way = self._way(x, u)
                if self._free(way, s) and not self._hidden(way):
                    self.blind.side = side
                    return u
        return None

    def _gain(self, x: Array) -> Array:
        """Return how controls move the place (d, m) [m/s per control]."""
        d = self.dynamics
        return np.asarray(d.G_c(x)[: len(d.position)])

    def _way(self, x: Array, u: Array) -> list[tuple[float, Array]]:
        """Return times [s] and states (n,) of a robot that drives under a control (m,) until it has braked."""
        d = self.dynamics
        speed = float(np.hypot.reduce(self._gain(x) @ u))
        time = self.tuning.lag + 0.5 * speed / self.deceleration
        pieces = max(2, math.ceil(speed * time / self.tuning.spacing))
        still = np.zeros(d.m)
        way = [(0.0, x)]
        for k in range(1, pieces + 1):
            x = d.step(x, u, still, time / pieces)
            way.append((k * time / pieces, x))
        return way

    def _free(self, way: list[tuple[float, Array]], s: float) -> bool:
        """Return whether a robot meets nothing on its way, or comes out of a margin."""
        kernels = self.static.kernels
        reads = self.dynamics.reads(kernels.turns)
        clear = at_states(kernels, reads).clearance
        pose = pose_at(reads)
        moving = self.moving
        (_, x), *onward = way
        least = min(0.0, clear(self.static, x))
        nearest = min(0.0, moving.clearance(pose(x), self.now + s))
        for time, x in onward:
            if clear(self.static, x) < least:
                return False
            if moving.J and moving.clearance(pose(x), self.now + s + time) < nearest:
                return False
        return True

    def _hidden(self, way: list[tuple[float, Array]]) -> bool:
        """Return whether a way leads through what the lidar never showed on its blind side."""
        if self.blind is None:
            return False
        poses = np.array([x for _, x in way])[:, list(self.dynamics.reads(True))]
        return self.blind.hides(poses)


@dataclass(slots=True, eq=False)
class GovernedLaw:
    """A law whose controls are admissible; a share is kept for a while."""

    law: Law
    governor: Governor
    _until: float = field(default=-math.inf, init=False)  # time since the plan [s]
    _share: Array = field(default_factory=lambda: np.ones(1), init=False)
    _more: Array = field(default_factory=lambda: np.zeros(1), init=False)  # in place of less: a turn to look

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        u = self.law(x, s)
        if s >= self._until or s < self._until - 2.0 * self.governor.tuning.every:
            found = self.governor.admissible(x, u, s)
            less = np.abs(found) <= np.abs(u)
            self._share = np.divide(found, u, out=np.array(less, dtype=float), where=less & (np.abs(u) > 1e-9))
            self._more = np.where(less, 0.0, found)
            self._until = s + self.governor.tuning.every
        return self._share * u + self._more


def governed(
    plan: Plan, dynamics: Dynamics, static: Space, deceleration: float, moving: Moving | None = None, now: float = 0.0,
    blind: BlindSide | None = None,
) -> Plan:  # fmt: skip
    """Return a plan whose controls keep to speeds from which a robot can stop; a deceleration of 0 is none [m/s^2]."""
    if deceleration <= 0.0:
        return plan
    moving = NoMoving() if moving is None else moving
    governor = Governor(
        dynamics=dynamics, static=static, deceleration=deceleration, moving=moving, now=now, blind=blind
    )
    return replace(plan, law=GovernedLaw(plan.law or plan.at, governor))
