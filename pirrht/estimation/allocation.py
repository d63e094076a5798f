"""Allocation of a plan's samples to classes and to the local optima of each, by what earlier samples contributed.

The variance of psi is the sum over references of N_h var_h(w), so for a given total it is least with N_h proportional
to the deviation of a weight around h (Neyman 1934). Estimated is the root mean square, which is no smaller: a
reference whose samples hardly weigh anything gets few. Before anything is known, the predicted psi of a class replaces
it. Two proposals of one class reach each other's paths, so they share its samples by the weight that these carry. The
counts are fixed before the samples of a plan are drawn, so the estimate of psi stays unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl
from pirrht.proposals.tuning import TUNING as PROPOSALS


class AllocationTuning(NamedTuple):
    """Numbers that allocation is tuned by."""

    plans: float = 5.0  # contributions are averaged over about so many plans; more lag behind a robot that moves
    least: float = 0.15  # share of N for every class worth it, and of a class for each proposal; lets others recover
    fewest: int = 8  # samples that every reference gets, if N allows: enough to notice a class that becomes worth more


TUNING = AllocationTuning()


@dataclass(slots=True)
class Allocation:
    """Distributes the samples of a plan, and learns from their weights.

    Attributes:
        contribution: root mean square weight of samples by class.
        shares: share of the samples of a class around its second proposal, by class.
    """

    contribution: dict[str, float] = field(default_factory=dict)
    shares: dict[str, float] = field(default_factory=dict)
    tuning: AllocationTuning = TUNING

    def counts(
        self, names: Sequence[str], predicted: Sequence[float], worth: Sequence[bool], samples: int
    ) -> list[int]:
        """Return the samples around each reference, (H,), so many on average over those that are worth it.

        Args:
            names: of the classes, (H,); a new one counts as an average one.
            predicted: log psi of each, (H,) [nats].
            worth: whether each is worth more than the fewest samples, (H,).
        """
        N, t = samples, self.tuning
        least = min(N, max(t.fewest, math.ceil(t.least * N)))
        chosen = np.asarray(worth) if any(worth) else np.ones(len(names), dtype=np.bool_)
        number = np.full(len(names), min(N, t.fewest))
        some = [name for name, one in zip(names, chosen, strict=True) if one]
        number[chosen] = self._shared(some, np.asarray(predicted)[chosen], N * len(some), least)
        return [int(n) for n in number]

    def _shared(self, names: Sequence[str], predicted: Array, total: int, least: int) -> Array:
        """Distribute a total number of samples, at least so many each, (l,)."""
        known = [self.contribution[name] for name in names if name in self.contribution]
        usual = float(np.mean(known)) if known else 0.0
        if usual > 0.0:
            raw = np.array([self.contribution.get(name, usual) for name in names])
        else:
            raw = np.exp(predicted - predicted.max()) if np.isfinite(predicted).all() else np.ones(len(names))
        exact = least + (total - least * len(names)) * raw / raw.sum()
        number: Array = np.floor(exact)
        number[np.argsort(number - exact, kind="stable")[: total - int(number.sum())]] += 1
        return number

    def split(self, proposals: Sequence[Proposal], second: Callable[[int], ProposalControl | None]) -> list[Proposal]:
        """Give some samples of the k-th class to its `second(k)` proposal, if that is not None."""
        first, more = [], []
        few = min(PROPOSALS.few, max((one.count for one in proposals), default=0) - 1)
        for k, one in enumerate(proposals):
            other = second(k) if one.count > few else None  # so few samples can hardly carry weight
            count = 0 if other is None else min(round(self.shares.get(one.name, 0.5) * one.count), one.count - 1)
            first.append(replace(one, count=one.count - count))
            if other is not None and count > 0:
                more.append(replace(one, lead=other, count=count))
        return first + more

    def learn(self, batch: Batch, estimate: Estimate) -> None:
        """Learn from the weights of a plan's samples."""
        weights: dict[str, list[float]] = {}
        first = estimate.rollouts.tables.first
        rows = zip(batch.proposals, first[:-1], first[1:], estimate.proposal_weights, strict=True)
        for one, start, stop, weight in rows:
            found = math.sqrt(float(np.mean(estimate.weight[start:stop] ** 2)))
            before = self.contribution.get(one.name, found)
            self.contribution[one.name] = before + (found - before) / self.tuning.plans
            weights.setdefault(one.name, []).append(weight)
        least = self.tuning.least
        for name, of_class in weights.items():
            if len(of_class) == 2 and sum(of_class) > 0.0:
                self.shares[name] = float(np.clip(of_class[1] / sum(of_class), least, 1.0 - least))
