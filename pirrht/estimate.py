"""What weighted samples say: psi, the value, the control, and how much of it each class accounts for.

Weights stay logarithms throughout: phi/lambda can exceed a million.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pirrht.errors import NoSurvivingSample
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollout import Guides, Paths
from pirrht.sampling import Sampling
from pirrht.scene import Array

OTHER = "other"


class Source(Protocol):
    """Who drew the samples: `pirrht.PathIntegral`."""

    problem: Problem
    sampling: Sampling

    def tapes(self, rollouts: Rollouts, groups: Sequence[NDArray[np.bool_]]) -> tuple[Array, Array, Array]:
        """Open-loop controls of groups of samples, the weight under way at each step, effective sample sizes."""

    def trace(self, rollouts: Rollouts, chosen: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """States of chosen samples, and the number of steps each took."""

    def push(self, x: Array, guides: Guides) -> Array:
        """The part of the control at x (n,) that the nearest wall accounts for, (m,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rollouts:
    """S sampled paths from one state; full states are simulated again for those that are shown."""

    x0: Array  # (n,)
    seed: int
    guides: Guides
    paths: Paths
    log_weight: Array  # (S,) log of each sample's contribution to psi; -inf for paths that ran out of time

    @property
    def size(self) -> int:
        """S."""
        return len(self.log_weight)


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What the samples say about one state."""

    control: Array  # (m,) u* now
    log_psi: float
    value: float  # v = -lambda log psi
    value_error: float  # standard error of the value; too small where `ess` is, as rare heavy samples were not seen
    control_error: Array  # (m,) standard error of the control
    ess: float  # effective sample size (sum w)^2 / sum w^2 of all samples
    weight: Array  # normalised weights of the samples in `rollouts`; with others in `parts` they sum to less than 1
    class_weights: dict[str, float]  # weight by the class of each sample's own path, "other" for the rest
    class_ess: dict[str, float]  # effective sample size within each class
    class_controls: dict[str, Array]  # (m,) u* now within each class, without what the nearest wall adds
    proposal_weights: list[float]  # weight by the reference a sample was drawn around
    survivors: int  # samples that reached the goal
    rollouts: Rollouts  # the last samples that have any weight
    parts: tuple[Rollouts, ...]  # all samples, in the rounds in which they were drawn
    source: Source

    @property
    def tape(self) -> Array:
        """Open-loop controls (T, m): the sum over all samples of weight times control carried."""
        return self._tape[0]

    @property
    def alive(self) -> Array:
        """Weight of the samples still under way at each step, (T,)."""
        return self._tape[1]

    @cached_property
    def _tape(self) -> tuple[Array, Array]:
        top = max(float(part.log_weight.max()) for part in self.parts)
        share = np.array([float(np.exp(part.log_weight - top).sum()) for part in self.parts])
        tapes = [self.source.tapes(part, [np.ones(part.size, dtype=np.bool_)])[:2] for part in self.parts]
        tape = sum(w * one[0] for w, (one, _) in zip(share / share.sum(), tapes, strict=True))
        alive = sum(w * one[0] for w, (_, one) in zip(share / share.sum(), tapes, strict=True))
        return np.asarray(tape), np.asarray(alive)


def log_weights(problem: Problem, rule: str, paths: Paths, number: NDArray[np.int64]) -> Array:
    """Logarithm of each sample's contribution to psi, (S,); `number` (H,) counts the samples around each reference."""
    final = np.where(paths.outcome == Outcome.COLLISION, problem.phi, 0.0)
    cost = -(paths.work + final) / problem.temperature
    H, S = len(number), len(paths.work)
    if rule == "average":
        own = np.repeat(np.arange(H), number)
        # The paper averages H estimators; with unequal counts each sample stands for S / (H N_h) of them.
        log_weight = cost - paths.log_ratio[np.arange(S), own] + np.log(S / (H * number[own]))
    else:
        log_weight = cost - _log_mean(paths.log_ratio, number / S)
    return np.where(paths.outcome == Outcome.TIMEOUT, -np.inf, log_weight)


def weigh(source: Source, parts: Sequence[Rollouts], classes: Mapping[int, str] | None = None) -> Estimate:
    """Weigh the samples; `classes` maps additive class keys to the names of the references' classes.

    Each part is weighed by its own proposals. Where these were fixed before it was drawn, the mean over all samples is
    an unbiased estimate of psi, even if they were chosen by what earlier parts found.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    paths, log_weight, first = joined(parts)
    top = float(log_weight.max())
    if not np.isfinite(top):
        raise NoSurvivingSample(
            collisions=int(np.sum(paths.outcome == Outcome.COLLISION)),
            timeouts=int(np.sum(paths.outcome == Outcome.TIMEOUT)),
        )
    relative = np.exp(log_weight - top)
    total = float(relative.sum())
    weight = relative / total
    log_psi = top + float(np.log(total)) - float(np.log(len(log_weight)))
    groups = _groups(paths.key, dict(classes or {}))
    drawn_around = np.array([float(weight[a:b].sum()) for a, b in zip(first[:-1], first[1:], strict=True)])
    ends = np.cumsum([part.size for part in parts])
    shown = max(i for i, part in enumerate(parts) if np.isfinite(part.log_weight.max()))
    rollouts, paired = parts[shown], parts[0].guides.mirrored
    return Estimate(
        control=mean_control(weight, paths) + source.push(rollouts.x0, rollouts.guides),
        log_psi=log_psi,
        value=-source.problem.temperature * log_psi,
        value_error=source.problem.temperature * deviation(weight, first, paired),
        control_error=_control_error(weight, paths, first, paired),
        ess=float(1.0 / np.sum(weight**2)),
        weight=weight[ends[shown] - rollouts.size : ends[shown]],
        class_weights={name: float(weight[mask].sum()) for name, mask in groups.items()},
        class_ess={name: _ess(weight[mask]) for name, mask in groups.items()},
        class_controls={name: mean_control(np.where(mask, weight, 0.0), paths) for name, mask in groups.items()},
        proposal_weights=drawn_around.reshape(len(parts), -1).sum(axis=0).tolist(),
        survivors=int(np.sum(paths.outcome == Outcome.GOAL)),
        rollouts=rollouts,
        parts=tuple(parts),
        source=source,
    )


def normalised(log_weight: Array) -> tuple[Array, float]:
    """Weights (S,) that sum to 1 and their effective sample size; zeros and 0 where no sample has any weight."""
    top = float(log_weight.max(initial=-np.inf))
    if not np.isfinite(top):
        return np.zeros(len(log_weight)), 0.0
    relative = np.exp(log_weight - top)
    weight: Array = relative / relative.sum()
    return weight, float(1.0 / np.sum(weight**2))


def joined(parts: Sequence[Rollouts]) -> tuple[Paths, Array, NDArray[np.int64]]:
    """All paths, their log weights (S,), and where those around each reference of each part begin; the last is S."""
    paths = (
        parts[0].paths if len(parts) == 1 else Paths(*map(np.concatenate, zip(*(p.paths for p in parts), strict=True)))
    )
    number = np.concatenate([np.diff(part.guides.first) for part in parts])
    return paths, np.concatenate([part.log_weight for part in parts]), np.concatenate([[0], np.cumsum(number)])


def _log_mean(log_ratio: Array, share: Array) -> Array:
    """log sum_g share_g exp(log_ratio_g), row by row."""
    top = log_ratio.max(axis=1)
    mean: Array = top + np.log(np.einsum("sh,h->s", np.exp(log_ratio - top[:, None]), share))
    return mean


def _ess(weight: Array) -> float:
    square = float(np.sum(weight**2))
    return float(weight.sum()) ** 2 / square if square > 0 else 0.0


def mean_control(weight: Array, paths: Paths) -> Array:
    """Control now (m,) of weighted samples, as a mean over the time in which they are on their way."""
    # Not `@`: waiting for each other costs the threads of a BLAS far more than such short sums do.
    mean: Array = np.einsum("s,sm->m", weight, paths.now) / max(float(np.einsum("s,s->", weight, paths.span)), 1e-300)
    return mean


def deviation(terms: Array, first: NDArray[np.int64], paired: bool) -> float:
    """Standard deviation of a sum of terms (S,), those around one reference being distributed alike.

    Terms are independent, or those of antithetic pairs are only so together. What stands alone around its reference
    says nothing about its spread; the term itself stands for it.
    """
    number = np.diff(first)
    own = np.repeat(np.arange(len(number)), number)
    if paired:
        pairs = (number + 1) // 2
        which = np.concatenate([[0], np.cumsum(pairs)])[own] + (np.arange(len(terms)) - first[own]) // 2
        terms, number = np.asarray(np.bincount(which, terms), dtype=float), pairs
        own = np.repeat(np.arange(len(pairs)), pairs)
    mean = np.bincount(own, terms, len(number)) / np.maximum(number, 1)
    square = np.bincount(own, (terms - np.where(number > 1, mean, 0.0)[own]) ** 2, len(number))
    return float(np.sqrt(square @ (number / np.maximum(number - 1, 1))))


def _control_error(weight: Array, paths: Paths, first: NDArray[np.int64], paired: bool) -> Array:
    """Standard error (m,) of the control, a ratio of sums over samples, to first order (delta method)."""
    off = weight[:, None] * (paths.now - paths.span[:, None] * mean_control(weight, paths))
    span = max(float(np.einsum("s,s->", weight, paths.span)), 1e-300)
    return np.array([deviation(column, first, paired) for column in off.T]) / span


def _groups(key: NDArray[np.int64], names: Mapping[int, str]) -> dict[str, NDArray[np.bool_]]:
    groups = {name: key == k for k, name in names.items()}
    rest = np.ones(len(key), dtype=np.bool_)
    for mask in groups.values():
        rest &= ~mask
    return {**groups, OTHER: rest}
