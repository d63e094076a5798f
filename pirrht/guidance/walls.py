"""Scales of noise and cost at a state, and what the nearest walls add to the control there.

In free space psi falls like exp(-k r), k^2 = 2 q / (lambda b^2). Near a wall it vanishes like the distance c, as
c / (c + reach): samples lean away from it, the push. On a way the reach is what psi of the class has there; for what
follows no way, and for what walls add to a control that is held, it is the same everywhere.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel
from pirrht.geometry.field import Field
from pirrht.geometry.traffic import Traffic
from pirrht.problem import Problem
from pirrht.rollouts.among import walls_among
from pirrht.rollouts.first_exit import two_walls, wall_slope

FAR = 10.0  # reaches from where on what bodies add is nothing
REACH = 2.0  # decay lengths 1/k within which walls push what follows no way
AVERAGED = 0.04  # near walls and goal the control now is averaged over leading steps of this length together [s]
AMONG = 0.01  # likewise where bodies move: a gap that closes is passed, or not, in less than the above
SHARE = 0.5  # of the time in which noise carries a path to the nearest of them
NEAREST = 1e-4  # no wall is taken to be nearer [m]
SHARPER = 0.2  # of a rollout step's noise: nearer than that a wall pushes the robot no harder
CLOSING = 0.05  # the same where bodies move, since gaps that close leave a robot no room to be shy in
LOOSE, TIGHT = 1.2, 0.7  # room in deviations of noise since now, from where on walls ahead count, and all of them do
ARRIVING = 2.5  # deviations of noise since now within which paths arrive


class Scales(NamedTuple):
    """Lengths and noise that a problem has at a state."""

    noise: float  # variance per second that each noise adds, their mean [m^2/s or rad^2/s]
    decay: float  # k of psi = exp(-k r) in free space [1/m]; ways, of points that noise moves, are its only use
    reach: float  # of walls, as `wall_slope` takes it, beside what follows no way [m]

    @classmethod
    def of(cls, problem: Problem, x: Array) -> Scales:
        """Those at x (n,)."""
        B = problem.dynamics.B_c(x)
        noise = float(np.trace(B @ B.T)) / problem.dynamics.m
        decay = float(np.sqrt(2.0 * problem.least_rate / (problem.temperature * noise)))
        return cls(noise=noise, decay=decay, reach=REACH / decay)


def window(noise: float, near: float, times: Array, longest: float, least: float = AVERAGED) -> int:
    """Leading steps of a grid (T+1,) [s] over which the control now is averaged, at least one, at most `longest` [s].

    Besides the guide, which is followed exactly, the optimal control changes near walls and goal, the nearest of which
    is so near [m]: about as fast as `noise` (`Scales`) carries a path there. Averages over less than `least` [s] are
    asked for nowhere.
    """
    span = min(max(SHARE * near**2 / noise, least), longest)
    return max(1, int(np.searchsorted(times, span + 1e-9, side="right")) - 1)


def trust(noise: float, near: float) -> float:
    """Share of a linear law that tells how the control changes among bodies that move, `near` [m] to walls and goal.

    All of it where the shortest `window` would do; none where noise (`Scales`) carries paths to a wall within that.
    """
    return min(1.0, SHARE * near**2 / (noise * AMONG))


def under_way(noise: float, off: Array, times: Array) -> int:
    """Leading ones of some times (k,) [s] up to which hardly a path has arrived.

    Args:
        off: the goal's disc at these times, (k,) [m], on the way.
    """
    early = off < ARRIVING * np.sqrt(noise * times)
    return int(np.argmax(early)) if early.any() else len(times)


def squeezed(noise: float, room: Array, times: Array) -> float:
    """How surely walls count within some times [s] other than where one is now, from 0 to 1.

    Args:
        room: to walls at these times, (k,) [m], on the way.
    """
    least = float(np.min(room / np.sqrt(noise * times)))
    return min(max((LOOSE - least) / (LOOSE - TIGHT), 0.0), 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """The part of the control that the nearest walls account for, as a function of the state.

    It changes fast with the position, so it is taken at the state itself; the rest of the control, which samples tell,
    changes slowly and is averaged over the leading steps.
    """

    problem: Problem
    field: Field
    reach: float  # as `Leads.reach` [m]; 0: none
    step: float  # of the rollouts, their first [s]
    beyond: float = 0.0  # as `Leads.beyond` [m]
    slack: float = 0.0  # by which the field's clearance is too small where the plan was made [m]
    traffic: Traffic | None = None  # bodies that move
    time: float = 0.0  # of the plan, on their clock [s]
    known: tuple[Array, float] | None = dataclasses.field(init=False, repr=False)  # what `_at` tells, if constant

    def __post_init__(self) -> None:
        d = self.problem.dynamics
        object.__setattr__(self, "known", None)
        object.__setattr__(self, "known", self._at(np.zeros(d.n)) if d.constant else None)

    def __call__(self, x: Array, s: float = 0.0, closest: float | None = None) -> Array:
        """Control (m,) at x (n,), s [s] after the plan.

        Args:
            closest: no wall is taken to be nearer [m]; None: than where they push no harder.
        """
        if self.reach <= 0.0:
            return np.zeros(self.problem.dynamics.m)
        gain, harder = self._at(x)
        return np.asarray(gain @ self._slope(x, s, harder if closest is None else closest))

    def _slope(self, x: Array, s: float, closest: float) -> Array:
        """Slope of log psi (2,) [1/m] by the two nearest walls, none nearer than `closest` [m]."""
        if self.traffic is None:
            return np.array(_slope_at(self.field, x[0], x[1], closest, self.slack, self.beyond, self.reach))
        return np.array(wall_slope(*self._found(x, s, closest), self.reach))

    def gain(self, x: Array) -> Array:
        """lambda R^-1 G' at x (n,), (m, rows): what a slope of log psi is multiplied with."""
        return self._at(x)[0]

    def walls(self, x: Array, s: float = 0.0) -> tuple[Any, ...]:
        """The two nearest walls at x (n,) as `two_walls` gives them, none nearer than they push harder [m].

        Args:
            s: time since the plan, by which bodies have moved on [s].
        """
        return self._found(x, s, self._at(x)[1])

    def _found(self, x: Array, s: float, closest: float) -> tuple[Any, ...]:
        found: tuple[Any, ...] = _walls_at(self.field, x[0], x[1], closest, self.slack, self.beyond)
        if self.traffic is None:
            return found
        among: tuple[Any, ...] = walls_among(self.traffic, found, x[0], x[1], self.time + s, FAR * self.reach, closest)
        return among

    def _at(self, x: Array) -> tuple[Array, float]:
        """lambda R^-1 G' = G^-1 BB' at x (n,), and where walls begin to push no harder [m]."""
        if self.known is not None:
            return self.known
        d = self.problem.dynamics
        B = d.B_c(x)
        # A robot that reacts between plans may come closer than a rollout's step would let it.
        nearest = SHARPER if self.traffic is None else CLOSING
        closest = nearest * float(np.sqrt((B @ B.T).diagonal().max() * self.step))
        return d.climbing_gain(x), closest


@kernel
def _walls_at(field, x, y, closest, slack, beyond):  # type: ignore[no-untyped-def]
    """`two_walls` at (x, y), the nearest `slack` and both `beyond` farther, none nearer than `closest` [m]."""
    c, nx, ny, d, mx, my = two_walls(field, x, y)
    c, d, least = np.float32(c + slack + beyond), np.float32(d + beyond), np.float32(closest)
    return max(c, least), nx, ny, max(d, least), mx, my


@kernel
def _slope_at(field, x, y, closest, slack, beyond, reach):  # type: ignore[no-untyped-def]
    """`wall_slope` of these for a reach [m], 2 numbers [1/m]."""
    c, nx, ny, d, mx, my = _walls_at(field, x, y, closest, slack, beyond)
    return wall_slope(c, nx, ny, d, mx, my, reach)
