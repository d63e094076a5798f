"""Intervals and tests for shares and means of runs, and for pairs of runs that met equal noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array

Z = 1.959963984540054  # of a two-sided 95 % interval
REPEATS = 10_000
BLOCK = 4_000_000  # numbers that are drawn at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """An estimate with its 95 % interval; NaN where there is nothing to estimate from."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside; False if unknown."""
        return self.low > 0.0 or self.high < 0.0


UNKNOWN = Interval(value=nan, low=nan, high=nan)


def wilson(successes: int, runs: int) -> Interval:
    """A share with Wilson's score interval (Wilson 1927)."""
    if runs == 0:
        return UNKNOWN
    share, spread = successes / runs, Z**2 / runs
    center = (share + spread / 2) / (1 + spread)
    half = Z * sqrt(share * (1 - share) / runs + spread / (4 * runs)) / (1 + spread)
    low = 0.0 if successes == 0 else center - half
    high = 1.0 if successes == runs else center + half
    return Interval(value=share, low=low, high=high)


def mean(values: ArrayLike, seed: int = 0) -> Interval:
    """A mean with its percentile bootstrap interval; without an interval if there are fewer than two values.

    Args:
        values: (k,) independent runs.
    """
    x = np.asarray(values, dtype=float)
    if len(x) < 2:
        return Interval(value=float(x.mean()) if len(x) else nan, low=nan, high=nan)
    return _interval(float(x.mean()), _resampled(x[:, None], seed)[:, 0])


def ratio(above: ArrayLike, below: ArrayLike, seed: int = 0) -> Interval:
    """The ratio of two means over pairs (k,), with the interval of a bootstrap that draws pairs."""
    pairs = np.column_stack([above, below]).astype(float)
    if len(pairs) < 2:
        return Interval(value=float(pairs[0, 0] / pairs[0, 1]) if len(pairs) else nan, low=nan, high=nan)
    means = _resampled(pairs, seed)
    return _interval(float(pairs[:, 0].mean() / pairs[:, 1].mean()), means[:, 0] / means[:, 1])


def paired_shares(gained: int, lost: int, pairs: int) -> Interval:
    """The difference of two shares over pairs, with the adjusted Wald interval of Bonett and Price (2012).

    Args:
        gained, lost: pairs of which only the first, or only the second, succeeded.
    """
    if pairs == 0:
        return UNKNOWN
    up, down = (gained + 1) / (pairs + 2), (lost + 1) / (pairs + 2)
    half = Z * sqrt((up + down - (up - down) ** 2) / (pairs + 2))
    low, high = max(-1.0, up - down - half), min(1.0, up - down + half)
    return Interval(value=(gained - lost) / pairs, low=low, high=high)


def mcnemar(gained: int, lost: int) -> float:
    """Exact two-sided p-value that pairs of unequal outcome are as often one way as the other (McNemar 1947)."""
    odd, few = gained + lost, min(gained, lost)
    tail = sum(comb(odd, k) for k in range(few + 1))
    return min(1.0, 2 * tail / (1 << odd))


def sign_flips(differences: ArrayLike, seed: int = 0) -> float:
    """Two-sided p-value that differences (k,) of pairs are symmetric about zero, by flipping signs (Fisher 1935).

    All flips up to 13 pairs, beyond that 10 000 random ones, with the one at hand counted among them.
    """
    d = np.asarray(differences, dtype=float)
    if len(d) == 0 or not d.any():
        return 1.0
    exact = 2 ** len(d) <= REPEATS
    if exact:
        signs = 1 - 2 * ((np.arange(2 ** len(d))[:, None] >> np.arange(len(d))) & 1)
        sums: Array = signs @ d
    else:
        rng, rows = np.random.default_rng(seed), max(1, BLOCK // len(d))
        blocks = [min(rows, REPEATS - at) for at in range(0, REPEATS, rows)]
        sums = np.concatenate([(1 - 2 * rng.integers(0, 2, (size, len(d)))) @ d for size in blocks])
    as_far = int(np.sum(np.abs(sums) >= abs(float(d.sum())) * (1 - 1e-12)))
    p: float = as_far / len(sums) if exact else (as_far + 1) / (len(sums) + 1)
    return p


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted for their number, so that the chance of any false finding stays below 5 % (Holm 1979)."""
    adjusted, worst = [0.0] * len(p), 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        worst = max(worst, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = worst
    return adjusted


def _resampled(rows: Array, seed: int) -> Array:
    """Means (REPEATS, c) of rows (k, c) drawn with replacement."""
    rng, size = np.random.default_rng(seed), max(1, BLOCK // len(rows))
    blocks = [min(size, REPEATS - at) for at in range(0, REPEATS, size)]
    return np.concatenate([rows[rng.integers(0, len(rows), (block, len(rows)))].mean(axis=1) for block in blocks])


def _interval(value: float, resampled: Array) -> Interval:
    low, high = np.percentile(resampled, (2.5, 97.5))
    return Interval(value=value, low=float(low), high=float(high))
