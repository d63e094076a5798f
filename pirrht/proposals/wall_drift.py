"""Wall drift, the part of a control due to the nearest walls, and the bias that walls cause in a mean control.

In free space psi falls like exp(-k r), k^2 = 2 q / (lambda b^2). Near a wall it vanishes like the distance c, as
c / (c + offset): optimal paths drift away from it. In a tube the offset is that of the class's psi, elsewhere constant.

Where noise acts on the position and q is constant, the optimal control is a martingale along the optimal paths of a
point: u* = lambda R^-1 G' grad log psi, and grad psi solves the equation that psi solves. So the mean control over any
time is u* now, under any proposal; but for walls, at which grad psi does not vanish as psi does. A flat one at a
distance c from which the point goes away at a speed s (seen from it, if it moves) has psi ~ sinh(g c), g = s / b^2, and
within t the slope of log psi falls short by

    g [erfc((c - s t) / (b sqrt(2 t))) / (exp(2 g c) - 1) + erfc((c + s t) / (b sqrt(2 t))) / (1 - exp(-2 g c))],

1/c erfc(c / (b sqrt(2 t))) along it: g E[exp(-k tau); tau <= t] / sinh(g c), tau being when passive paths meet it. For
s = 0 that is Bessel's process in three dimensions, whose drift 1/c is a strict local martingale. The speed s far from
the wall follows from the mean itself.
"""

import dataclasses
import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.geometry.space import Space, SpaceKernels
from pirrht.geometry.world import Moving, merging
from pirrht.jit.jit import kernel
from pirrht.problem import Problem
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.first_exit import slope_for

MOMENTS, SHARES = np.polynomial.legendre.leggauss(TUNING.moments)
MOMENTS = 0.5 * (MOMENTS + 1.0)  # on a time from 0 to 1
SHARES = 0.5 * SHARES


class Scales(NamedTuple):
    """Lengths and noise of a problem at a state."""

    noise: float  # mean variance per second of the noises [m^2/s or rad^2/s]
    decay: float  # k of psi = exp(-k r) in free space, for points [1/m]
    wall_offset: float  # of walls without a tube (`wall_slope`) [m]

    @classmethod
    def of(cls, problem: Problem, x: Array) -> "Scales":
        """Evaluate the scales at x (n,)."""
        B = problem.dynamics.B_c(x)
        noise = float(np.trace(B @ B.T)) / problem.dynamics.m
        decay = float(np.sqrt(2.0 * problem.least_rate / (problem.temperature * noise)))
        return cls(noise=noise, decay=decay, wall_offset=TUNING.wall_offset / decay)


def window(noise: float, near: float, times: Array, longest: float, least: float = TUNING.averaged) -> int:
    """Return the number of leading steps of a grid (T+1,) [s] over which the control now is averaged, at least one.

    The rest of the control changes about as fast as `noise` (`Scales`) carries a path to the nearest wall or goal,
    `near` [m]. The average is over `least` to `longest` [s].
    """
    span = min(max(TUNING.averaged_share * near**2 / noise, least), longest)
    return max(1, int(np.searchsorted(times, span + 1e-9, side="right")) - 1)


def linear_law_weight(noise: float, near: float) -> float:
    """Return the valid share of a linear law among moving obstacles, `near` [m] to walls and goal: 1 far from them."""
    return min(1.0, TUNING.averaged_share * near**2 / (noise * TUNING.averaged_moving))


def under_way(noise: float, off: Array, times: Array) -> int:
    """Return the number of times (k,) [s] before which hardly a path arrives, `off` (k,) [m] the goal's disc."""
    early = off < TUNING.arriving * np.sqrt(noise * times)
    return int(np.argmax(early)) if early.any() else len(times)


def shortfall(c: float, s: float, variance: float, span: float) -> float:
    """Return the loss of slope of log psi in the mean over a time span [s] at a flat wall c [m] away, [1/m].

    The point goes away from it at a speed s [m/s], 0 at least, under noise of the variance b^2 [m^2/s].
    """
    g, total = max(s, 0.0) / variance, 0.0
    if g * c > TUNING.out_of_reach:
        return 0.0
    for moment, share in zip(MOMENTS, SHARES, strict=True):
        t = span * moment
        spread = math.sqrt(2.0 * variance * t)
        if g * c < TUNING.along:
            total += share * math.erfc(c / spread) / c
        else:
            near = math.erfc((c - s * t) / spread)
            far = math.erfc((c + s * t) / spread)
            total += share * g * (near / math.expm1(2.0 * g * c) - far / math.expm1(-2.0 * g * c))
    return float(total)


def speed_of(mean: float, c: float, variance: float, span: float) -> float:
    """Solve for the speed s of `shortfall` by the slope's mean [1/m], as seen from the wall; 0 at least."""
    low, high = 0.0, max(mean, 0.0) * variance  # the mean is no less than s / variance
    for _ in range(TUNING.bisections):
        s = 0.5 * (low + high)
        now = 1.0 / c if s * c < TUNING.along * variance else s / variance / math.tanh(s * c / variance)
        low, high = (low, s) if now - shortfall(c, s, variance, span) >= mean else (s, high)
    return low


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallDrift:
    """Wall drift as a function of the state.

    It changes fast with the position, so it is evaluated at the state itself; the rest of the control, which samples
    estimate, changes slowly and is averaged over the leading steps.
    """

    problem: Problem
    static: Space
    offset: float  # `ProposalTables.wall_offset` [m]; 0: no drift
    step: float  # first of the rollouts [s]
    moving: Moving  # moving obstacles
    behind: float = 0.0  # `ProposalTables.set_back` [m]
    slack: float = 0.0  # by which the field's clearance is too small where the plan was made [m]
    time: float = 0.0  # of the plan, on their clock [s]
    known: tuple[Array, float] | None = dataclasses.field(init=False, repr=False, default=None)  # `_at`, if constant

    def __post_init__(self) -> None:
        if self.problem.dynamics.constant:
            object.__setattr__(self, "known", self._at(np.zeros(self.problem.dynamics.n)))

    def __call__(self, x: Array, s: float = 0.0, closest: float | None = None) -> Array:
        """Return the control (m,) at x (n,), s [s] after the plan, for walls at least `closest` [m] away (or `_at`)."""
        if self.offset <= 0.0:
            return np.zeros(self.problem.dynamics.m)
        return np.asarray(self.gain(x) @ np.array(slope_for(len(self.pose(x)))(self.walls(x, s, closest), self.offset)))

    def gain(self, x: Array) -> Array:
        """Return lambda R^-1 G' at x (n,), (m, rows), the control per slope of log psi."""
        return self._at(x)[0]

    def walls(self, x: Array, s: float = 0.0, closest: float | None = None) -> tuple[Any, ...]:
        """Return the two nearest walls (`SpaceKernels`) at x (n,), s [s] after the plan, `closest` [m] at least."""
        closest = self._at(x)[1] if closest is None else closest
        pose = self.pose(x)
        found: tuple[Any, ...] = kept_off(self.static.kernels)(self.static, pose, closest, self.slack, self.behind)
        if self.moving.J == 0:
            return found
        rows = self.moving.walls(pose, self.time + s, TUNING.drift_near * self.offset)
        return tuple(merging(len(pose))(found, rows, len(rows), closest))

    def pose(self, x: Array) -> tuple[float, ...]:
        """Take the pose of a state (n,)."""
        return tuple(x[list(self.problem.dynamics.reads(self.static.kernels.turns))].tolist())

    def gains(self, x: Array) -> Array:
        """Return the rows of G at x (n,) that move the pose, (k, m); those that are zero for good are zero."""
        d = self.problem.dynamics
        return d.whole(d.G_c(x))[list(d.reads(self.static.kernels.turns))]

    def _at(self, x: Array) -> tuple[Array, float]:
        """Return lambda R^-1 G' = G^-1 BB' at x (n,), and the distance of walls below which drift stays constant."""
        if self.known is not None:
            return self.known
        B = self.problem.dynamics.B_c(x)
        # A robot that reacts between plans may come closer than a rollout's step would let it.
        nearest = TUNING.constant_below if self.moving.J == 0 else TUNING.constant_below_moving
        closest = nearest * float(np.sqrt((B @ B.T).diagonal().max() * self.step))
        return self.problem.dynamics.control_gain(x) @ B.T, closest


@cache
def kept_off(space: SpaceKernels) -> Any:
    """Build the kernel (static, pose, closest, slack, behind) of the two nearest walls.

    The nearest is `slack` and both are `behind` farther, none is nearer than `closest` [m].
    """
    two_walls = space.walls

    @kernel
    def walls_at(static, pose, closest, slack, behind):  # type: ignore[no-untyped-def]
        c, n, d, m = two_walls(static, pose)

        c = np.float32(c + slack + behind)
        d = np.float32(d + behind)
        least = np.float32(closest)

        return max(c, least), n, max(d, least), m

    return walls_at


class FlatWalls(NamedTuple):
    """The two walls nearest to a point at the moment of a plan, which bias the mean of its control over a time."""

    drift: WallDrift
    x: Array  # (d,) [m]
    span: float  # over which the mean is taken [s]

    def missing(self, mean: Array) -> Array:
        """Return the control (m,) that a mean (m,) over `span` lacks near the walls."""
        now = self.drift.walls(self.x)
        then = self.drift.walls(self.x, TUNING.wall_step)

        slope = np.zeros(len(self.x))
        velocity = self.drift.gains(self.x) @ mean
        B = self.drift.problem.dynamics.B_c(self.x)

        for k in (0, 2):
            c = float(now[k])
            away = np.array(now[k + 1], dtype=float)
            variance = float(away @ B @ B.T @ away)
            near = variance > 0.0 and 0.0 < c < math.inf
            if near and shortfall(c, 0.0, variance, self.span) >= TUNING.unbiased / c:
                alike = (j for j in (0, 2) if away @ np.array(then[j + 1], dtype=float) > TUNING.same_wall)
                receding = min(((float(then[j]) - c) / TUNING.wall_step for j in alike), key=abs, default=0.0)
                speed = speed_of((float(away @ velocity) + receding) / variance, c, variance, self.span)
                slope += away * shortfall(c, speed, variance, self.span)
        return np.asarray(self.drift.gain(self.x) @ slope)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearWalls:
    """Wall drift at a state, and its effect on the mean control over leading steps.

    A proposal counts by its value at the start, and the mean is that of the rest. For a point whose optimal control is
    a martingale (`rollouts.step`) it does not, and the mean is corrected by the bias of walls.
    """

    push: Array  # wall drift, (m,); the mean is without it
    clipped: Array  # drift left out where a wall is very near, (m,)
    flat: FlatWalls | None = None

    @classmethod
    def of(cls, drift: WallDrift, x: Array, flat: FlatWalls | None = None) -> "NearWalls":
        """Evaluate the wall drift at x (n,) at the moment of a plan."""
        here = drift(x)
        return cls(push=here, clipped=drift(x, closest=TUNING.least_gap) - here, flat=flat)

    def corrected_control(self, mean: Array, proposed: Array) -> tuple[Array, Array]:
        """Return the control without wall drift, and its error, (m,) each.

        The error is a share of the bias of walls, or the mean's rest on top of the proposal's mean `proposed` (m,)
        where the drift is large against the rest of the control, nothing in the open.
        """
        if self.flat is not None:
            missing = self.flat.missing(mean)
            return mean + missing - self.push, TUNING.unsure * np.abs(missing)
        hard = float(np.linalg.norm(self.push))
        share = hard / (hard + float(np.linalg.norm(mean))) if hard > 0.0 else 0.0
        return mean, np.abs(share * (mean - proposed)) + np.abs(self.clipped)
