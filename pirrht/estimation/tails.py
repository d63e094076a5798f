"""How heavy the tail of importance weights is: what no weight that was drawn can tell by its size alone.

The largest of S weights are distributed like a generalised Pareto's, whose shape k tells how many moments the weights
have: from 1/2 on their variance is infinite, and the more k exceeds 0.7, the more samples it takes till errors that
are estimated mean anything (Vehtari, Simpson, Gelman, Yao and Gabry, JMLR 2024). The fit is the one of that paper:
Zhang and Stephens' (Technometrics 2009), drawn a little towards 1/2.
"""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array

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
