"""Keep to speeds from which a robot can stop in what is free, as the dynamic window does (Fox, Burgard, Thrun 1997).

Plans change speeds at once, and wheels with inertia do not. A control is admissible if the robot, which drives on under
it until it has braked, meets nothing. Of one that is not, the largest admissible share is taken: the curvature of the
path stays. Where no share is, the robot turns on the spot if that is free.

Before a robot enters what its lidar never showed on its blind side, it turns to look; where it cannot, it is slow.
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
    shares: tuple[float, ...] = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1)  # of the control that are tried
    look_rate: float = 2.0  # rate at which the robot turns to look [rad/s]
    look_angle: float = 0.75 * math.pi  # by which it does: what was behind is ahead then [rad]
    look_apart: float = 0.5  # between the places of two looks at least [m]
    unseen_speed: float = 0.3  # on a way that is hidden where the robot cannot look [m/s]


TUNING = GovernorTuning()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Governor:
    """Lowers controls, velocities of a robot, to those from which it can stop, among static and moving obstacles."""

    dynamics: Dynamics
    static: Space
    deceleration: float  # [m/s^2]
    moving: Moving = field(default_factory=NoMoving)
    now: float = 0.0  # when the plan begins, on the clock of moving obstacles [s]
    sure: bool = True  # whether their motions are known; else they may stop at any time as well
    blind: BlindSide | None = None  # of the lidar that guides the robot
    tuning: GovernorTuning = TUNING

    def admissible(self, x: Array, u: Array, s: float = 0.0) -> Array:
        """Return the largest admissible share of a control (m,) at state x (n,), or what of it moves no place.

        It is s [s] after the plan began.
        """
        if self.blind is not None and self.now + s >= self.blind.time:
            self.blind.time = self.now + s
            u = self._looking(self.blind, x, u, s)
        for share in self.tuning.shares:
            if self._free(self._way(x, share * u), s):
                return share * u
        _, spot = self._parts(x, u)
        return spot if self._free(self._way(x, spot), s) else np.zeros(len(u))

    def _looking(self, blind: BlindSide, x: Array, u: Array, s: float) -> Array:
        """Return a turn on the spot while the robot looks, else a control (m,), slow where its way is hidden.

        A look goes on until what was behind is ahead, whatever plans want meanwhile, and is the only one near its
        place: what it has not shown is hidden behind something, or the robot has no room to turn.
        """
        t = self.tuning
        hidden = blind.heading is None and self._hidden(blind, self._way(x, u))
        if not hidden and blind.heading is None:
            return u
        pose = x[list(self.dynamics.reads(True))]
        onward, spot = self._parts(x, u)
        turn = self._parts(x, np.ones(len(u)))[1]
        turn *= t.look_rate / np.hypot.reduce(turn)
        if hidden and (blind.looked is None or np.hypot(*(pose[:2] - blind.looked)) > t.look_apart):
            pieces = math.ceil(t.look_angle * blind.footprint.reach / t.spacing)
            for side in (1.0, -1.0) if spot @ turn >= 0.0 else (-1.0, 1.0):
                if self._free(self._way(x, side * turn, t.look_angle / t.look_rate, pieces), s):
                    blind.side = side
                    blind.heading = float(pose[2]) + side * t.look_angle
                    break
        if blind.heading is not None:
            rest = math.remainder(blind.side * (blind.heading - pose[2]), 2.0 * math.pi)
            if rest > 0.0 and self._free(self._way(x, blind.side * turn), s):
                return np.asarray(blind.side * turn)
            blind.heading = None
            blind.looked = pose[:2].copy()
        if not hidden:
            return u
        least = min(1.0, t.unseen_speed / max(float(np.hypot.reduce(self._gain(x) @ u)), 1e-9))
        for share in (share for share in t.shares if 1.0 > share > least):
            if not self._hidden(blind, self._way(x, spot + share * onward)):
                return spot + share * onward
        return spot + least * onward

    def _parts(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return what of a control (m,) moves the place, and what does not."""
        gain = self._gain(x)
        onward = np.linalg.pinv(gain) @ (gain @ u)
        return onward, u - onward

    def _gain(self, x: Array) -> Array:
        """Return how controls move the place (d, m) [m/s per control]."""
        d = self.dynamics
        return np.asarray(d.G_c(x)[: len(d.position)])

    def _way(self, x: Array, u: Array, time: float | None = None, pieces: int = 2) -> list[tuple[float, Array]]:
        """Return times [s] and states (n,) of a robot that drives under a control (m,), None: until it has braked."""
        d = self.dynamics
        speed = float(np.hypot.reduce(self._gain(x) @ u))
        time = self.tuning.lag + 0.5 * speed / self.deceleration if time is None else time
        pieces = max(pieces, math.ceil(speed * time / self.tuning.spacing))
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
            when = (time,) if self.sure else (0.0, time)
            if moving.J and min(moving.clearance(pose(x), self.now + s + t) for t in when) < nearest:
                return False
        return True

    def _hidden(self, blind: BlindSide, way: list[tuple[float, Array]]) -> bool:
        """Return whether a way leads through what the lidar never showed on its blind side."""
        return blind.hides(np.array([x for _, x in way])[:, list(self.dynamics.reads(True))])


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
    blind: BlindSide | None = None, *, sure: bool = True,
) -> Plan:  # fmt: skip
    """Return a plan whose controls keep to speeds from which a robot can stop; a deceleration of 0 is none [m/s^2]."""
    if deceleration <= 0.0:
        return plan
    moving = NoMoving() if moving is None else moving
    governor = Governor(
        dynamics=dynamics, static=static, deceleration=deceleration, moving=moving, now=now, blind=blind, sure=sure
    )
    return replace(plan, law=GovernedLaw(plan.law or plan.at, governor))
