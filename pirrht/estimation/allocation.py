"""Allocation of a plan's samples to references and within each class, by what earlier samples contributed.

The variance of psi is the sum over references of N_h var_h(w), so for a given total it is least with N_h proportional
to the deviation of a weight around h (Neyman 1934). Estimated is the root mean square, which is no smaller: a
reference whose samples hardly weigh anything gets few. Before anything is known, the promise of a way replaces it; a
class that is promised less than exp(-16) of another gets only a few samples that hold its tape. The counts are
fixed before the samples of a plan are drawn, so the estimate of psi stays unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl
from pirrht.proposals.tuning import TUNING

PLANS = 5.0  # contributions are averaged over about so many plans
LEAST = 0.15  # of N goes to every reference that is worth it, and of a class around and beside its guide
RENEWED = 10  # plans for which a shortfall is taken as known
FEWEST = 8  # samples that every reference gets, if N allows


class Allocation:
    """Remembers, by class from the start of the drive, what samples around its reference contributed."""

    def __init__(self, samples: int) -> None:
        self.samples = samples  # N, on average over references
        self._contribution: dict[str, float] = {}
        self._shortfall: dict[str, tuple[float, int]] = {}  # and plans since it was found

    def forget(self) -> None:
        """Start anew, with the promises of ways."""
        self._contribution, self._shortfall = {}, {}

    def inherit(self, before: Allocation, names: Mapping[str, str]) -> None:
        """Take over earlier classes under their present `names`."""
        self._contribution = {names[name]: value for name, value in before._contribution.items() if name in names}
        self._shortfall = {names[name]: value for name, value in before._shortfall.items() if name in names}

    def counts(self, names: Sequence[str], promised: Sequence[float], worth: Sequence[bool]) -> list[int]:
        """Return the samples around each reference, (H,), N on average over those that are worth it.

        Args:
            names: of the classes, (H,); a new one counts as an average one.
            promised: predicted log psi of each, (H,) [nats].
            worth: whether each is worth more than the fewest samples, (H,).
        """
        N, least = self.samples, min(self.samples, max(FEWEST, math.ceil(LEAST * self.samples)))
        chosen = np.asarray(worth) if any(worth) else np.ones(len(names), dtype=np.bool_)
        number = np.full(len(names), min(N, FEWEST))
        some = [name for name, one in zip(names, chosen, strict=True) if one]
        number[chosen] = self._shared(some, np.asarray(promised)[chosen], N * len(some), least)
        return [int(n) for n in number]

    def shortfalls(self, names: Sequence[str]) -> list[float]:
        """Return the last losses of predicted log psi to walls, (H,) [nats]; 0 where unknown."""
        return [self._shortfall.get(name, (0.0, 0))[0] for name in names]

    def note(self, names: Sequence[str], shortfalls: Sequence[float]) -> None:
        """Update shortfalls (H,) [nats], infinite where none was found; drop old ones."""
        for name, found in zip(names, shortfalls, strict=True):
            if math.isfinite(found):
                self._shortfall[name] = (found, 0)
            elif name in self._shortfall:
                before, age = self._shortfall.pop(name)
                if age + 1 < RENEWED:
                    self._shortfall[name] = (before, age + 1)

    def _shared(self, names: Sequence[str], promised: Array, total: int, least: int) -> Array:
        """Distribute a total number of samples, at least so many each, (l,)."""
        known = [self._contribution[name] for name in names if name in self._contribution]
        usual = float(np.mean(known)) if known else 0.0
        if usual > 0.0:
            raw = np.array([self._contribution.get(name, usual) for name in names])
        else:
            raw = np.exp(promised - promised.max()) if np.isfinite(promised).all() else np.ones(len(names))
        exact = least + (total - least * len(names)) * raw / raw.sum()
        number: Array = np.floor(exact)
        number[np.argsort(number - exact, kind="stable")[: total - int(number.sum())]] += 1
        return number

    def learn(self, names: Sequence[str], estimate: Estimate) -> None:
        """Learn the contributions of a plan's samples; `names` are classes in their order."""
        first = estimate.rollouts.leads.first
        for name, start, stop in zip(names, first[:-1], first[1:], strict=False):
            found = math.sqrt(float(np.mean(estimate.weight[start:stop] ** 2)))
            before = self._contribution.get(name, found)
            self._contribution[name] = before + (found - before) / PLANS


@dataclass(slots=True)
class DefensiveComponent:
    """Splits the samples of a class between its guide and another lead, if there is one."""

    shares: dict[str, float] = field(default_factory=dict)  # of samples beside the guide, by class

    def split(self, proposals: Sequence[Proposal], beside: Callable[[int], ProposalControl | None]) -> list[Proposal]:
        """Give some samples of the k-th class to the lead `beside(k)`, if that is not None."""
        kept, more = [], []
        few = min(TUNING.few, max((one.count for one in proposals), default=0) - 1)
        for k, one in enumerate(proposals):
            other = beside(k) if one.count > few else None  # so few samples can hardly carry weight
            count = 0 if other is None else min(round(self.shares.get(one.name, 0.5) * one.count), one.count - 1)
            kept.append(replace(one, count=one.count - count))
            if other is not None and count > 0:
                more.append(replace(one, lead=other, count=count))
        return kept + more

    def learn(self, batch: Batch, estimate: Estimate) -> None:
        """Learn for each class the weight of the samples beside its guide."""
        weights: dict[str, list[float]] = {}
        for one, weight in zip(batch.proposals, estimate.proposal_weights, strict=True):
            weights.setdefault(one.name, []).append(weight)
        for name, found in weights.items():
            if len(found) == 2 and sum(found) > 0.0:
                self.shares[name] = float(np.clip(found[1] / sum(found), LEAST, 1.0 - LEAST))
