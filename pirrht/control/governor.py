"""Keep to speeds from which a robot can stop in what is free, as the dynamic window does (Fox, Burgard, Thrun 1997).

Plans change speeds at once, and wheels with inertia do not. A control is admissible if the robot, which drives on under
it until it has braked, meets nothing. Of one that is not, the largest admissible share is taken: the curvature of the
path stays. Where no share is, the robot turns on the spot if that is free.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Law, Plan
from pirrht.geometry.space import Space, at_states, pose_at
from pirrht.geometry.world import Moving, NoMoving
from pirrht.systems.dynamics import Dynamics


class GovernorTuning(NamedTuple):
    """Numbers of the governor."""

    lag: float = 0.2  # time until brakes act: wheels are not at the speed that was commanded, and plans are old [s]
    every: float = 0.02  # time for which a share is kept [s]
    spacing: float = 0.04  # of the poses on the way that are judged [m]
    shares: tuple[float, ...] = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1)  # of the control that are tried


TUNING = GovernorTuning()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Governor:
    """Lowers controls, velocities of a robot, to those from which it can stop, among static and moving obstacles."""

    dynamics: Dynamics
    static: Space
    deceleration: float  # [m/s^2]
    moving: Moving = field(default_factory=NoMoving)
    now: float = 0.0  # when the plan begins, on the clock of moving obstacles [s]
    tuning: GovernorTuning = TUNING

    def admissible(self, x: Array, u: Array, s: float = 0.0) -> Array:
        """Return the largest admissible share of a control (m,) at state x (n,), or what of it moves no place.

        It is s [s] after the plan began.
        """
        for share in self.tuning.shares:
            if self.stops(x, share * u, s):
                return share * u
        gain = self._gain(x)
        spot = u - np.linalg.pinv(gain) @ (gain @ u)
        return spot if self.stops(x, spot, s) else np.zeros(len(u))

    def _gain(self, x: Array) -> Array:
        """Return how controls move the place (d, m) [m/s per control]."""
        d = self.dynamics
        return np.asarray(d.G_c(x)[: len(d.position)])

    def stops(self, x: Array, u: Array, s: float = 0.0) -> bool:
        """Return whether a robot at state x (n,) that drives under a control (m,) meets nothing before it stands."""
        d = self.dynamics
        kernels = self.static.kernels
        reads = d.reads(kernels.turns)
        clear = at_states(kernels, reads).clearance
        pose = pose_at(reads)
        moving = self.moving
        speed = float(np.hypot.reduce(self._gain(x) @ u))
        time = self.tuning.lag + 0.5 * speed / self.deceleration
        pieces = max(2, math.ceil(speed * time / self.tuning.spacing))
        least = min(0.0, clear(self.static, x))  # out of a margin
        nearest = min(0.0, moving.clearance(pose(x), self.now + s))
        still = np.zeros(d.m)
        for k in range(1, pieces + 1):
            x = d.step(x, u, still, time / pieces)
            if clear(self.static, x) < least:
                return False
            if moving.J and moving.clearance(pose(x), self.now + s + k * time / pieces) < nearest:
                return False
        return True


@dataclass(slots=True, eq=False)
class GovernedLaw:
    """A law whose controls are admissible; a share is kept for a while."""

    law: Law
    governor: Governor
    _until: float = field(default=-math.inf, init=False)  # time since the plan [s]
    _share: Array = field(default_factory=lambda: np.ones(1), init=False)

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        u = self.law(x, s)
        if s >= self._until or s < self._until - 2.0 * self.governor.tuning.every:
            found = self.governor.admissible(x, u, s)
            self._share = np.divide(found, u, out=np.ones(len(u)), where=np.abs(u) > 1e-9)
            self._until = s + self.governor.tuning.every
        return self._share * u


def governed(
    plan: Plan, dynamics: Dynamics, static: Space, deceleration: float, moving: Moving | None = None, now: float = 0.0
) -> Plan:  # fmt: skip
    """Return a plan whose controls keep to speeds from which a robot can stop; a deceleration of 0 is none [m/s^2]."""
    if deceleration <= 0.0:
        return plan
    moving = NoMoving() if moving is None else moving
    governor = Governor(dynamics=dynamics, static=static, deceleration=deceleration, moving=moving, now=now)
    return replace(plan, law=GovernedLaw(plan.law or plan.at, governor))
