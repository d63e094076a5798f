"""Weights of samples: the two rules that make them, sums of them by class, standard errors, and how heavy their tail is.

The largest of S weights are distributed like a generalised Pareto's, whose shape k tells how many moments the weights
have: from 1/2 on their variance is infinite, and the more k exceeds 0.7, the more samples it takes till errors that
are estimated mean anything (Vehtari, Simpson, Gelman, Yao and Gabry, JMLR 2024). The fit is the one of that paper:
Zhang and Stephens' (Technometrics 2009), drawn a little towards 1/2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.compiled.jit import kernel

LEAST = 25  # weights from which on a shape is told
SHARE, ROOTS = 0.2, 3.0  # the tail is this share of all, or so many roots of their number, whichever is less
MIDDLE, PULL = 0.5, 10  # a shape is drawn towards this as if by so many weights
HEAVY = 0.7  # shapes from which on errors say little


def tail_shape(log_weight: Array) -> float:
    """Shape k of the tail of weights whose logarithms are (S,) [nats]; minus infinity is none, nan if there are few."""
    known = log_weight[np.isfinite(log_weight)]
    count = int(min(SHARE * len(log_weight), ROOTS * np.sqrt(len(log_weight)), len(known) - 1))
    if len(known) < LEAST or count < LEAST // 5:
        return float("nan")
    largest = np.partition(known, len(known) - count - 1)[-count - 1 :]
    largest = np.exp(np.sort(largest) - largest.max())
    excess = largest[1:] - largest[0]
    if not excess[len(excess) // 4] > 0.0:
        return float("nan")  # nearly all are equal
    return (count * _pareto(excess) + PULL * MIDDLE) / (count + PULL)


def heavy(shape: float, count: int) -> bool:
    """Whether a tail of so many weights is too heavy for errors that are estimated from them."""
    return bool(shape > min(HEAVY, 1.0 - 1.0 / np.log10(max(count, 11))))


def _pareto(x: Array) -> float:
    """Shape of a generalised Pareto distribution that sorted values (m,) above its threshold are drawn from."""
    m, points = len(x), 30 + int(np.sqrt(len(x)))
    quarter = x[int(m / 4 + 0.5) - 1]
    grid = 1.0 / x[-1] + (1.0 - np.sqrt(points / (np.arange(1, points + 1) - 0.5))) / (3.0 * quarter)
    shape = np.mean(np.log1p(-grid[:, None] * x), axis=1)
    likelihood = m * (np.log(-grid / shape) - shape - 1.0)
    weight = np.exp(likelihood - likelihood.max())
    best = float(np.sum(grid * weight) / np.sum(weight))
    return float(np.mean(np.log1p(-best * x)))


OUTLYING = 4.0  # calibrated on random scenes: with 0 a twentieth of plans near walls is off by more than 3 errors


class Groups(NamedTuple):
    """What the samples of each of G groups sum to."""

    weight: Array  # (G,) sum of weights
    square: Array  # (G,) of weights
    control: Array  # (G, m) weight times control now
    span: Array  # (G,) weight times the time that the control now is a mean over [s]


def grouped(weight: Array, key: NDArray[np.int64], keys: NDArray[np.int64], now: Array, span: Array) -> Groups:
    """Sums by key of samples, `now` (S, m), `span` (S,) [s]: a group for each of `keys`, the last for others."""
    G = len(keys) + 1
    sums = Groups(np.zeros(G), np.zeros(G), np.zeros((G, now.shape[1])), np.zeros(G))
    _group(weight, key, keys, now, span, sums)
    return sums


@kernel
def _group(weight, key, keys, now, span, sums):  # type: ignore[no-untyped-def]
    total, square, control, under_way = sums
    m, G = now.shape[1], keys.shape[0]
    for s in range(weight.shape[0]):
        w, k, g = weight[s], key[s], 0
        while g < G and keys[g] != k:
            g += 1
        total[g] += w
        square[g] += w * w
        under_way[g] += w * span[s]
        for j in range(m):
            control[g, j] += w * now[s, j]


@kernel
def centred(weight, now, span, control):  # type: ignore[no-untyped-def]
    """What each sample adds to psi and, to first order (delta method), to the control, a ratio of sums: (S, 1+m).

    Args: weights (S,), the control now integrated over a time, (S, m), that time (S,) [s], and the control (m,).
    """
    S, m = now.shape
    terms = np.empty((S, 1 + m))
    for s in range(S):
        terms[s, 0] = weight[s]
        for j in range(m):
            terms[s, 1 + j] = weight[s] * (now[s, j] - span[s] * control[j])
    return terms


@kernel
def scatter(terms, first, step):  # type: ignore[no-untyped-def]
    """Standard deviations (k,) of sums of terms (S, k), those from first[h] on being distributed alike, h = 0..H-1.

    `step` terms in a row are one: 2 for antithetic pairs, which are independent only together. What stands alone around
    its reference says nothing about its spread; the term itself stands for it. The largest term counts `OUTLYING` times
    more: where a sum rests on a handful of terms, larger ones are likely not to have been met.
    """
    k = terms.shape[1]
    variance, mean, largest = np.zeros(k), np.empty(k), np.zeros(k)
    for h in range(first.shape[0] - 1):
        begin, end = first[h], first[h + 1]
        number = (end - begin + step - 1) // step
        mean[:] = 0.0
        for s in range(begin, end if number > 1 else begin):
            for j in range(k):
                mean[j] += terms[s, j] / number
        scale = number / max(number - 1.0, 1.0)
        for s in range(begin, end, step):
            for j in range(k):
                off = -mean[j]
                for i in range(s, min(s + step, end)):
                    off += terms[i, j]
                square = scale * off * off
                variance[j] += square
                largest[j] = max(largest[j], square)
    return np.sqrt(variance + OUTLYING * largest)
