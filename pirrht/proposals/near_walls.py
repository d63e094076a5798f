"""Estimation of the control now by the mean control over leading steps, and the bias of that mean near walls.

Where noise acts on the position and q is constant, the optimal control is a martingale along the optimal paths of a
point: u* = lambda R^-1 G' grad log psi, and grad psi solves the equation that psi solves. So the mean control over any
time is u* now, under any lead; but for walls, at which grad psi does not vanish as psi does. A flat one at a distance c
from which the point goes away at a speed s (seen from it, if it moves) has psi ~ sinh(g c), g = s / b^2, and within t
the slope of log psi falls short by

    g [erfc((c - s t) / (b sqrt(2 t))) / (exp(2 g c) - 1) + erfc((c + s t) / (b sqrt(2 t))) / (1 - exp(-2 g c))],

1/c erfc(c / (b sqrt(2 t))) along it: g E[exp(-k tau); tau <= t] / sinh(g c), tau being when passive paths meet it. For
s = 0 that is Bessel's process in three dimensions, whose drift 1/c is a strict local martingale. The speed s far from
the wall follows from the mean itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.proposals.tuning import TUNING
from pirrht.proposals.wall_drift import WallDrift

MOMENTS, SHARES = np.polynomial.legendre.leggauss(TUNING.moments)
MOMENTS, SHARES = 0.5 * (MOMENTS + 1.0), 0.5 * SHARES  # on a time from 0 to 1


def shortfall(c: float, s: float, variance: float, span: float) -> float:
    """Return the loss of slope of log psi at a flat wall in the mean over a time span [s], [1/m].

    Args:
        c: distance from the wall [m].
        s: speed away from it, as seen from it [m/s]; towards it counts as along it.
        variance: of the noise, b^2 [m^2/s].
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
            near, far = math.erfc((c - s * t) / spread), math.erfc((c + s * t) / spread)
            total += share * g * (near / math.expm1(2.0 * g * c) - far / math.expm1(-2.0 * g * c))
    return float(total)


def speed_of(mean: float, c: float, variance: float, span: float) -> float:
    """Solve for the speed s of `shortfall` by the slope's mean [1/m], as seen from the wall; 0 at least."""

    def off(s: float) -> float:
        g = s / variance
        now = 1.0 / c if g * c < TUNING.along else g / math.tanh(g * c)
        return now - shortfall(c, s, variance, span) - mean

    low, high = 0.0, max(mean, 0.0) * variance
    if off(low) >= 0.0:
        return 0.0
    for _ in range(TUNING.bisections):  # the mean is no less than s / variance
        middle = 0.5 * (low + high)
        low, high = (low, middle) if off(middle) >= 0.0 else (middle, high)
    return 0.5 * (low + high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearWalls:
    """Wall drift at a state, and its effect on a control that is the lead plus a mean over leading steps."""

    push: Array  # wall drift, (m,); the mean is without it
    held_back: Array  # drift left out where a wall is very near, (m,)

    def told(self, mean: Array, led: Array) -> tuple[Array, Array]:
        """Return the control without wall drift, and its error, (m,) each.

        The lead, of mean `led` (m,), counts by its value at the start; the error is the rest of the mean where the
        drift is large against the rest of the control, nothing in the open.
        """
        return mean, _unresolved(self.push, mean, mean - led) + np.abs(self.held_back)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearWallsOfMeans(NearWalls):
    """Wall drift and its effect on the mean of the whole control of a steady point (`rollouts.general.kind`)."""

    walls: tuple[tuple[float, Array, float], ...]  # distance [m], direction (2,) away and receding speed [m/s] of each
    gain: Array  # lambda R^-1 G', (m, 2)
    moved: Array  # G, (2, m)
    noise: Array  # BB', (2, 2) [m^2/s]
    span: float  # over which the mean is taken [s]
    counted: float  # share of the lead that counts by its value at the start, and of the drift in place of the rest

    @classmethod
    def of(cls, push: WallDrift, x: Array, span: float, counted: float) -> NearWallsOfMeans:
        """Evaluate the two walls that are nearest to x (2,) at the moment of a plan."""
        d, now, then = push.problem.dynamics, push.walls(x), push.walls(x, TUNING.wall_step)
        B, pushed = d.B_c(x), push(x)
        return cls(
            push=pushed, held_back=push(x, closest=TUNING.least_gap) - pushed, gain=push.gain(x), moved=d.G_c(x),
            noise=B @ B.T,
            walls=tuple(wall for wall in (_wall(now, then, k) for k in (0, 3)) if wall is not None),
            span=span, counted=counted,
        )  # fmt: skip

    def told(self, mean: Array, led: Array) -> tuple[Array, Array]:
        """Return the control without wall drift, and its error, (m,) each; add the bias of walls to the mean."""
        slope, velocity = np.zeros(2), self.moved @ mean
        for c, away, receding in self.walls:
            variance = float(away @ self.noise @ away)
            if shortfall(c, 0.0, variance, self.span) < TUNING.unbiased / c:
                continue
            speed = speed_of((float(away @ velocity) + receding) / variance, c, variance, self.span)
            slope += away * shortfall(c, speed, variance, self.span)
        missing = (1.0 - self.counted) * (self.gain @ slope)
        free: Array = mean + missing - (1.0 - self.counted) * self.push
        unresolved = self.counted * (_unresolved(self.push, mean, mean - led) + np.abs(self.held_back))
        return free, TUNING.unsure * np.abs(missing) + unresolved


def _unresolved(push: Array, mean: Array, found: Array) -> Array:
    """Return the share of `found` (m,) on top of the lead that the push is of push and control."""
    hard, rest = float(np.linalg.norm(push)), float(np.linalg.norm(mean))
    share = hard / (hard + rest) if hard > 0.0 else 0.0
    return np.abs(share * found)


def _wall(now: tuple[float, ...], then: tuple[float, ...], k: int) -> tuple[float, Array, float] | None:
    """Return one of two walls, whose numbers begin at k, and its receding speed; None if there is none."""
    c, away = float(now[k]), np.array([now[k + 1], now[k + 2]], dtype=float)
    if not (math.isfinite(c) and c > 0.0 and away.any()):
        return None
    later = [
        float(then[j]) for j in (0, 3) if away @ np.array([then[j + 1], then[j + 2]], dtype=float) > TUNING.same_wall
    ]
    return c, away, min(((d - c) / TUNING.wall_step for d in later), key=abs, default=0.0)
