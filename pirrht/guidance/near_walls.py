"""The control now from what paths apply on the mean over leading steps, and what walls do to that mean.

Where the position is the noise's and q is constant, the optimal control is a martingale along the optimal paths of a
point: u* = lambda R^-1 G' grad log psi, and grad psi solves the equation that psi solves. So the mean of what paths
apply over any time is u* now, whatever they are led by; but for walls, at which grad psi does not vanish as psi does.
A flat one at a distance c from which the point goes away at a speed s (seen from it, if it moves) has
psi ~ sinh(g c), g = s / b^2, and within t the slope of log psi falls short by

    g [erfc((c - s t) / (b sqrt(2 t))) / (exp(2 g c) - 1) + erfc((c + s t) / (b sqrt(2 t))) / (1 - exp(-2 g c))],

1/c erfc(c / (b sqrt(2 t))) along it: g E[exp(-k tau); tau <= t] / sinh(g c), tau being when passive paths meet it. For
s = 0 that is Bessel's process in three dimensions, whose drift 1/c is the textbook's local martingale that is none.
How fast the point goes away where the wall no longer counts, s, follows from the mean itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.guidance.walls import NEAREST, Push

MOMENTS, SHARES = np.polynomial.legendre.leggauss(8)
MOMENTS, SHARES = 0.5 * (MOMENTS + 1.0), 0.5 * SHARES  # on a time from 0 to 1
HALVINGS = 24  # in which a speed is found
NOTHING = 1e-9  # of 1/c, below which a mean misses nothing
ALONG = 1e-4  # of g c, below which a point goes along a wall
FAR = 300.0  # of g c, above which a wall is out of reach
SOON = 1e-3  # over which it is looked how fast a wall comes [s]
SAME = 0.99  # cosine of the directions of what is one wall then and now
UNSURE = 0.3  # share of what is missing that may be wrong, since walls are not flat nor alone


def shortfall(c: float, s: float, variance: float, span: float) -> float:
    """How much the slope of log psi falls short beside a flat wall in the mean over a time span [s], [1/m].

    Args:
        c: distance from the wall [m].
        s: speed away from it, as seen from it [m/s]; towards it counts as along it.
        variance: of the noise, b^2 [m^2/s].
    """
    g, total = max(s, 0.0) / variance, 0.0
    if g * c > FAR:
        return 0.0
    for moment, share in zip(MOMENTS, SHARES, strict=True):
        t = span * moment
        spread = math.sqrt(2.0 * variance * t)
        if g * c < ALONG:
            total += share * math.erfc(c / spread) / c
        else:
            near, far = math.erfc((c - s * t) / spread), math.erfc((c + s * t) / spread)
            total += share * g * (near / math.expm1(2.0 * g * c) - far / math.expm1(-2.0 * g * c))
    return float(total)


def speed_of(mean: float, c: float, variance: float, span: float) -> float:
    """The speed s of `shortfall` at which the slope's mean [1/m], as seen from the wall, is what it is; 0 at least."""

    def off(s: float) -> float:
        g = s / variance
        now = 1.0 / c if g * c < ALONG else g / math.tanh(g * c)
        return now - shortfall(c, s, variance, span) - mean

    low, high = 0.0, max(mean, 0.0) * variance
    if off(low) >= 0.0:
        return 0.0
    for _ in range(HALVINGS):  # the mean is no less than s / variance
        middle = 0.5 * (low + high)
        low, high = (low, middle) if off(middle) >= 0.0 else (middle, high)
    return 0.5 * (low + high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearWalls:
    """What the nearest walls do to a control now that is a mean over leading steps besides what samples follow.

    Attributes:
        push: what they account for at the state, (m,); the mean is told without it.
        held_back: what of it is left out where a wall is very near, (m,).
    """

    push: Array
    held_back: Array

    def told(self, mean: Array, led: Array) -> tuple[Array, Array]:
        """The control without the push, and what may be missing of it, (m,) each.

        What samples follow, of which `led` (m,) is the mean, counts as it is at the start; of what they found on top of
        it about as much again is missing where the push is large against the rest of the control, nothing in the open.
        """
        return mean, _unresolved(self.push, mean, mean - led) + np.abs(self.held_back)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NearWallsOfMeans(NearWalls):
    """The same where the mean is of all that paths apply: of a steady point (`rollouts.general.kind`).

    Attributes:
        walls: distance [m], direction (2,) away from it and how fast it recedes from who stands [m/s], of each.
        gain: lambda R^-1 G', (m, 2).
        moved: G, (2, m).
        noise: BB', (2, 2) [m^2/s].
        span: over which the mean is taken [s].
        counted: share of what samples follow that counts as it is at the start, and of the push in place of the rest.
    """

    walls: tuple[tuple[float, Array, float], ...]
    gain: Array
    moved: Array
    noise: Array
    span: float
    counted: float

    @classmethod
    def of(cls, push: Push, x: Array, span: float, counted: float) -> NearWallsOfMeans:
        """Beside the two walls that are nearest to x (2,) at the moment of a plan."""
        d, now, then = push.problem.dynamics, push.walls(x), push.walls(x, SOON)
        B, pushed = d.B_c(x), push(x)
        return cls(
            push=pushed, held_back=push(x, closest=NEAREST) - pushed, gain=push.gain(x), moved=d.G_c(x), noise=B @ B.T,
            walls=tuple(wall for wall in (_wall(now, then, k) for k in (0, 3)) if wall is not None),
            span=span, counted=counted,
        )  # fmt: skip

    def told(self, mean: Array, led: Array) -> tuple[Array, Array]:
        """As above, of the share that is counted; the rest of the mean falls short by what walls take off it."""
        slope, velocity = np.zeros(2), self.moved @ mean
        for c, away, receding in self.walls:
            variance = float(away @ self.noise @ away)
            if shortfall(c, 0.0, variance, self.span) < NOTHING / c:
                continue
            speed = speed_of((float(away @ velocity) + receding) / variance, c, variance, self.span)
            slope += away * shortfall(c, speed, variance, self.span)
        missing = (1.0 - self.counted) * (self.gain @ slope)
        free: Array = mean + missing - (1.0 - self.counted) * self.push
        unresolved = self.counted * (_unresolved(self.push, mean, mean - led) + np.abs(self.held_back))
        return free, UNSURE * np.abs(missing) + unresolved


def _unresolved(push: Array, mean: Array, found: Array) -> Array:
    """As much of what samples found on top of what they follow (m,) as the push is of push and control."""
    hard, rest = float(np.linalg.norm(push)), float(np.linalg.norm(mean))
    share = hard / (hard + rest) if hard > 0.0 else 0.0
    return np.abs(share * found)


def _wall(now: tuple[float, ...], then: tuple[float, ...], k: int) -> tuple[float, Array, float] | None:
    """One of two walls, the numbers of which begin at k, with how fast it recedes; None if there is none."""
    c, away = float(now[k]), np.array([now[k + 1], now[k + 2]], dtype=float)
    if not (math.isfinite(c) and c > 0.0 and away.any()):
        return None
    later = [float(then[j]) for j in (0, 3) if away @ np.array([then[j + 1], then[j + 2]], dtype=float) > SAME]
    return c, away, min(((d - c) / SOON for d in later), key=abs, default=0.0)
