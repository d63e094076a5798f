"""Intervals and tests for shares and means of runs, and for pairs of runs that met equal noise.

SciPy does the work and is imported late, since a report is one command of many.
"""

from collections.abc import Sequence
from math import nan, sqrt
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from pirrht.arrays import Array

Z = 1.959963984540054  # of a two-sided 95 % interval
REPEATS = 10_000
BLOCK = 4_000_000  # numbers that are drawn at a time


class Interval(TypedDict):
    """An estimate with its 95 % interval; NaN where there is nothing to estimate from."""

    value: float
    low: float
    high: float


UNKNOWN = Interval(value=nan, low=nan, high=nan)


def wilson(successes: int, runs: int) -> Interval:
    """A share with Wilson's score interval (Wilson 1927)."""
    from scipy.stats import binomtest

    if runs == 0:
        return UNKNOWN
    known = binomtest(successes, runs).proportion_ci(method="wilson")
    return Interval(value=successes / runs, low=float(known.low), high=float(known.high))


def mean(values: ArrayLike, over: ArrayLike | None = None, seed: int = 0) -> Interval:
    """A mean over independent runs (k,), with a percentile bootstrap interval if there are two or more.

    Args:
        over: of pairs of runs, the other's values (k,); then the ratio of both means, by a bootstrap that draws pairs.
    """
    from scipy.stats import bootstrap

    def statistic(*drawn: Array, axis: int = -1) -> Any:
        means = [np.mean(x, axis=axis) for x in drawn]
        return means[0] if over is None else means[0] / means[1]

    samples = [np.asarray(x, dtype=float) for x in (values, over) if x is not None]
    if len(samples[0]) == 0:
        return UNKNOWN
    value = float(statistic(*samples))
    if len(samples[0]) == 1:
        return Interval(value=value, low=nan, high=nan)
    found = bootstrap(
        samples, statistic, paired=over is not None, vectorized=True, n_resamples=REPEATS,
        batch=max(1, BLOCK // len(samples[0])), method="percentile", rng=np.random.default_rng(seed),
    ).confidence_interval  # fmt: skip
    return Interval(value=value, low=float(found.low), high=float(found.high))


def paired_shares(gained: int, lost: int, pairs: int) -> Interval:
    """The difference of two shares over pairs, with the adjusted Wald interval of Bonett and Price (2012).

    Of `gained` pairs only the first succeeded, of `lost` only the second. SciPy has no interval for pairs.
    """
    if pairs == 0:
        return UNKNOWN
    up, down = (gained + 1) / (pairs + 2), (lost + 1) / (pairs + 2)
    half = Z * sqrt((up + down - (up - down) ** 2) / (pairs + 2))
    low, high = max(-1.0, up - down - half), min(1.0, up - down + half)
    return Interval(value=(gained - lost) / pairs, low=low, high=high)


def mcnemar(gained: int, lost: int) -> float:
    """Exact two-sided p-value that pairs of unequal outcome are as often one way as the other (McNemar 1947)."""
    from scipy.stats import binomtest

    return float(binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def sign_flips(differences: ArrayLike, seed: int = 0) -> float:
    """Two-sided p-value that differences (k,) of pairs are symmetric about zero, by flipping signs (Fisher 1935).

    All flips up to 13 pairs, beyond that 10 000 random ones, with the one at hand counted among them.
    """
    from scipy.stats import permutation_test

    d = np.asarray(differences, dtype=float)
    if len(d) < 2 or not d.any():  # one pair is as probable either way
        return 1.0

    found = permutation_test(  # of the distance from zero: both sides at once, whatever their shape
        (d,), lambda x, axis: np.abs(np.sum(x, axis=axis)), permutation_type="samples", alternative="greater",
        vectorized=True, n_resamples=REPEATS, batch=max(1, BLOCK // len(d)), rng=np.random.default_rng(seed),
    )  # fmt: skip
    return float(found.pvalue)


def holm(p: Sequence[float]) -> list[float]:
    """p-values adjusted for their number, so that the chance of any false finding stays below 5 % (Holm 1979).

    SciPy adjusts for the false discovery rate only.
    """
    adjusted, worst = [0.0] * len(p), 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        worst = max(worst, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = worst
    return adjusted
