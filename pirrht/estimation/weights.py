"""Weights of samples: the rules that make them, standard errors and tails.

Weights stay logarithms until they are normalised: phi/lambda can exceed a million.

The largest of S weights are distributed like a generalised Pareto's, whose shape k gives the number of their moments:
from 1/2 on their variance is infinite, and the more k exceeds 0.7, the more samples reliable errors take (Vehtari,
Simpson, Gelman, Yao and Gabry, JMLR 2024). The fit is that paper's: Zhang and Stephens' (Technometrics 2009), drawn a
little towards 1/2.
"""

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.estimation.sampling import TUNING, EstimationTuning
from pirrht.jit.jit import kernel
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollouts.tables import Paths


def log_weights(problem: Problem, rule: str, paths: Paths, first: IntArray, part: slice = slice(None)) -> Array:
    """Return the logarithm of each sample's contribution to psi, (S,) [nats], or of a part of them.

    Mixture weight of a sample with cost S from N_g samples of each proposal Q_g: exp(-S / lambda) / sum_g (N_g / N)
    dQ_g/dP. All proposals count in every denominator, so that none of them makes psi biased.

    Args:
        rule: one of WEIGHTS; "average" is the paper's (sections III-B and IV-C). Under "biased" samples weigh by their
            cost alone (Trevisan and Alonso-Mora, IEEE RA-L 2024): no estimate of psi.
        first: (H+1,) first sample of each reference; the last entry is S.
    """
    number = np.diff(first)
    S = int(first[-1])
    outcome = paths.outcome[part]
    log_weight = paths.log_survival[part] - paths.work[part] / problem.temperature
    log_weight[outcome == Outcome.COLLISION] -= problem.phi / problem.temperature
    if rule == "average":
        samples = np.arange(S)[part]
        own = np.searchsorted(first, samples, side="right") - 1
        # The paper averages H estimators; with unequal counts each sample stands for S / (H N_h) of them.
        log_weight += np.log(S / (len(number) * number[own])) - paths.log_ratio[samples, own]
    elif rule != "biased":
        ratio = paths.log_ratio[part]
        top = ratio[:, 0].copy()
        for column in ratio.T[1:]:  # few and long: several times as fast as a maximum along the rows
            np.maximum(top, column, out=top)
        log_weight -= top + np.log(np.einsum("sh,h->s", np.exp(ratio - top[:, None]), number / S))
    log_weight[outcome == Outcome.TIMEOUT] = -np.inf
    return log_weight


def normalised(log_weight: Array) -> tuple[Array, float]:
    """Normalise weights given as logarithms (S,) [nats]; return their effective size too. Zeros and 0 without any."""
    top = float(log_weight.max(initial=-np.inf))
    if not np.isfinite(top):
        return np.zeros(len(log_weight)), 0.0
    relative = np.exp(log_weight - top)
    weight: Array = relative / relative.sum()
    return weight, float(1.0 / np.sum(weight**2))


def tail_shape(log_weight: Array, tuning: EstimationTuning = TUNING) -> float:
    """Estimate the tail shape k of weights from their logarithms (S,) [nats], -inf for zero; nan if there are few."""
    known = log_weight[np.isfinite(log_weight)]
    count = int(min(tuning.tail_share * len(log_weight), tuning.tail_roots * np.sqrt(len(log_weight)), len(known) - 1))
    if len(known) < tuning.tail_weights or count < tuning.tail_weights // 5:
        return float("nan")
    largest = np.partition(known, len(known) - count - 1)[-count - 1 :]
    largest = np.exp(np.sort(largest) - largest.max())
    excess = largest[1:] - largest[0]
    if not excess[len(excess) // 4] > 0.0:
        return float("nan")  # nearly all are equal
    return (count * _pareto(excess) + tuning.prior_weight * tuning.prior_shape) / (count + tuning.prior_weight)


def heavy(shape: float, count: int, tuning: EstimationTuning = TUNING) -> bool:
    """Check for a tail too heavy for standard errors estimated from so many weights."""
    return bool(shape > min(tuning.heavy, 1.0 - 1.0 / np.log10(max(count, 11))))


def _pareto(x: Array) -> float:
    """Fit the shape of a generalised Pareto distribution to sorted values (m,) above its threshold."""
    m = len(x)
    points = 30 + int(np.sqrt(len(x)))
    quarter = x[int(m / 4 + 0.5) - 1]
    grid = 1.0 / x[-1] + (1.0 - np.sqrt(points / (np.arange(1, points + 1) - 0.5))) / (3.0 * quarter)
    shape = np.mean(np.log1p(-grid[:, None] * x), axis=1)
    likelihood = m * (np.log(-grid / shape) - shape - 1.0)
    weight = np.exp(likelihood - likelihood.max())
    return float(np.mean(np.log1p(-float(np.sum(grid * weight) / np.sum(weight)) * x)))


@kernel
def scatter(terms, first, step, outlying):  # type: ignore[no-untyped-def]
    """Return standard deviations (k,) of sums of terms (S, k), those from first[h] on being identically distributed.

    `step` terms in a row count as one: 2 for antithetic pairs, which are independent only together. A single term
    around a reference is its own deviation. The largest term counts `outlying` times more: where a few terms dominate
    a sum, larger ones are likely still unseen.
    """
    k = terms.shape[1]

    variance = np.zeros(k)
    mean = np.empty(k)
    largest = np.zeros(k)

    for h in range(first.shape[0] - 1):
        begin = first[h]
        end = first[h + 1]
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
    return np.sqrt(variance + outlying * largest)


def deviation(terms: Array, first: IntArray, paired: bool, tuning: EstimationTuning = TUNING) -> Array:
    """Return standard deviations (k,) of sums of terms (S, k), independent or in antithetic pairs (`scatter`)."""
    return np.asarray(scatter(np.ascontiguousarray(terms), first, 2 if paired else 1, tuning.outlying))


def shrinkage(mean: Array, error: Array) -> Array:
    """Return the shares (1 - error^2 / mean^2)+ of means that count, from 0 within their standard errors up to 1.

    This is the positive part of Stein's estimate (James and Stein 1961; Baranchik 1964) component by component, as in
    Breiman's garrote (Technometrics 1995). What a control costs beyond the optimum is the mean of half the square of
    its error, weighted by R. With Gaussian errors that square is a third of error^2 where there is nothing to find, at
    most 1.5 error^2 (around 2.4 errors), and error^2 far off. The bias is towards zero: error^2 / mean far off, half an
    error at most (around 1.8 errors).
    """
    known = np.abs(mean) > error
    shares = np.zeros_like(mean)
    shares[known] = 1.0 - (error[known] / mean[known]) ** 2
    return shares
