"""Scales of noise and cost at a state, and the wall drift there.

In free space psi falls like exp(-k r), k^2 = 2 q / (lambda b^2). Near a wall it vanishes like the distance c, as
c / (c + reach): optimal paths drift away from it, the push. On a way the reach is that of the class's psi; for other
leads, and for a control that is held, it is constant.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.field import Field, two_walls
from pirrht.jit.jit import kernel
from pirrht.moving.exits import walls_among
from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.problem import Problem
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.first_exit import wall_slope


class Scales(NamedTuple):
    """Lengths and noise of a problem at a state."""

    noise: float  # mean variance per second of the noises [m^2/s or rad^2/s]
    decay: float  # k of psi = exp(-k r) in free space, for ways of points [1/m]
    reach: float  # of walls without a way (`wall_slope`) [m]

    @classmethod
    def of(cls, problem: Problem, x: Array) -> Scales:
        """Evaluate the scales at x (n,)."""
        B = problem.dynamics.B_c(x)
        noise = float(np.trace(B @ B.T)) / problem.dynamics.m
        decay = float(np.sqrt(2.0 * problem.least_rate / (problem.temperature * noise)))
        return cls(noise=noise, decay=decay, reach=TUNING.reach / decay)


def window(noise: float, near: float, times: Array, longest: float, least: float = TUNING.averaged) -> int:
    """Return the number of leading steps of a grid (T+1,) [s] over which the control now is averaged, at least one.

    Less the lead, the optimal control changes about as fast as `noise` (`Scales`) carries a path to the nearest wall or
    goal, `near` [m]. The average is over `least` to `longest` [s].
    """
    span = min(max(TUNING.averaged_share * near**2 / noise, least), longest)
    return max(1, int(np.searchsorted(times, span + 1e-9, side="right")) - 1)


def trust(noise: float, near: float) -> float:
    """Return the valid share of a linear law among moving obstacles, `near` [m] to walls and goal.

    It is 1 where the shortest `window` suffices, and 0 where noise (`Scales`) carries paths to a wall within that.
    """
    return min(1.0, TUNING.averaged_share * near**2 / (noise * TUNING.averaged_moving))


def under_way(noise: float, off: Array, times: Array) -> int:
    """Return the number of times (k,) [s] before which hardly a path arrives, `off` (k,) [m] the goal's disc."""
    early = off < TUNING.arriving * np.sqrt(noise * times)
    return int(np.argmax(early)) if early.any() else len(times)


def squeezed(noise: float, room: Array, times: Array) -> float:
    """Return how much walls ahead matter, from 0 to 1, by the clearance `room` (k,) [m] at some times (k,) [s]."""
    least = float(np.min(room / np.sqrt(noise * times)))
    return min(max((TUNING.loose - least) / (TUNING.loose - TUNING.tight), 0.0), 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallDrift:
    """Wall drift, the part of the control due to the nearest walls, as a function of the state.

    It changes fast with the position, so it is evaluated at the state itself; the rest of the control, which samples
    estimate, changes slowly and is averaged over the leading steps.
    """

    problem: Problem
    field: Field
    reach: float  # `ProposalTables.wall_offset` [m]; 0: no drift
    step: float  # first of the rollouts [s]
    traffic: MovingObstacleArrays  # moving obstacles
    beyond: float = 0.0  # `ProposalTables.set_back` [m]
    slack: float = 0.0  # by which the field's clearance is too small where the plan was made [m]
    time: float = 0.0  # of the plan, on their clock [s]
    known: tuple[Array, float] | None = dataclasses.field(init=False, repr=False)  # `_at`, if constant

    def __post_init__(self) -> None:
        d = self.problem.dynamics
        object.__setattr__(self, "known", None)
        object.__setattr__(self, "known", self._at(np.zeros(d.n)) if d.constant else None)

    def __call__(self, x: Array, s: float = 0.0, closest: float | None = None) -> Array:
        """Return the control (m,) at x (n,), s [s] after the plan, for walls at least `closest` [m] away (or `_at`)."""
        if self.reach <= 0.0:
            return np.zeros(self.problem.dynamics.m)
        gain, least = self._at(x)
        least = least if closest is None else closest
        if self.traffic.J == 0:
            slope = _slope_at(self.field, x[0], x[1], least, self.slack, self.beyond, self.reach)
        else:
            slope = wall_slope(*self._found(x, s, least), self.reach)
        return np.asarray(gain @ np.array(slope))

    def gain(self, x: Array) -> Array:
        """Return lambda R^-1 G' at x (n,), (m, rows), the control per slope of log psi."""
        return self._at(x)[0]

    def walls(self, x: Array, s: float = 0.0) -> tuple[Any, ...]:
        """Return the two nearest walls (`two_walls`) at x (n,), s [s] after the plan, at least `_at` [m] away."""
        return self._found(x, s, self._at(x)[1])

    def _found(self, x: Array, s: float, closest: float) -> tuple[Any, ...]:
        found: tuple[Any, ...] = _walls_at(self.field, x[0], x[1], closest, self.slack, self.beyond)
        if self.traffic.J == 0:
            return found
        among: tuple[Any, ...] = walls_among(
            self.traffic, found, x[0], x[1], self.time + s, TUNING.drift_near * self.reach, closest
        )
        return among

    def _at(self, x: Array) -> tuple[Array, float]:
        """Return lambda R^-1 G' = G^-1 BB' at x (n,), and the distance of walls below which drift stays constant."""
        if self.known is not None:
            return self.known
        d = self.problem.dynamics
        B = d.B_c(x)
        # A robot that reacts between plans may come closer than a rollout's step would let it.
        nearest = TUNING.constant_below if self.traffic.J == 0 else TUNING.constant_below_moving
        closest = nearest * float(np.sqrt((B @ B.T).diagonal().max() * self.step))
        return d.climbing_gain(x), closest


@kernel
def _walls_at(field, x, y, closest, slack, beyond):  # type: ignore[no-untyped-def]
    """Return `two_walls` at (x, y), the nearest `slack` and both `beyond` farther, none nearer than `closest` [m]."""
    c, nx, ny, d, mx, my = two_walls(field, x, y)
    c, d, least = np.float32(c + slack + beyond), np.float32(d + beyond), np.float32(closest)
    return max(c, least), nx, ny, max(d, least), mx, my


@kernel
def _slope_at(field, x, y, closest, slack, beyond, reach):  # type: ignore[no-untyped-def]
    """Return `wall_slope` of `_walls_at` for a reach [m], 2 numbers [1/m]."""
    c, nx, ny, d, mx, my = _walls_at(field, x, y, closest, slack, beyond)
    return wall_slope(c, nx, ny, d, mx, my, reach)
