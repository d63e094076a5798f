"""Samples of one class around its guide and around something else, shared by what each weighed last."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pirrht.estimation.estimate import Estimate
from pirrht.guidance.leads import Batch, Lead, Proposal
from pirrht.guidance.tracking import FEW

LEAST = 0.15  # of the samples of a class go around its guide, and beside it


@dataclass(slots=True)
class Aside:
    """Splits the samples of a class where there is something for them to follow besides its guide."""

    shares: dict[str, float] = field(default_factory=dict)  # of samples beside the guide, by class

    def split(self, proposals: Sequence[Proposal], beside: Callable[[int], Lead | None]) -> list[Proposal]:
        """As many samples of each class as before, some of them around what goes beside its guide.

        Args:
            beside: what that is of the k-th proposal, None if there is nothing.
        """
        kept, more = [], []
        few = min(FEW, max((one.count for one in proposals), default=0) - 1)
        for k, one in enumerate(proposals):
            other = beside(k) if one.count > few else None  # so few samples can hardly carry weight
            count = 0 if other is None else min(round(self.shares.get(one.name, 0.5) * one.count), one.count - 1)
            kept.append(replace(one, count=one.count - count))
            if other is not None and count > 0:
                more.append(replace(one, lead=other, count=count))
        return kept + more

    def learn(self, batch: Batch, estimate: Estimate) -> None:
        """Note for each class what the samples beside its guide weighed."""
        weights: dict[str, list[float]] = {}
        for one, weight in zip(batch.proposals, estimate.proposal_weights, strict=True):
            weights.setdefault(one.name, []).append(weight)
        for name, found in weights.items():
            if len(found) == 2 and sum(found) > 0.0:
                self.shares[name] = float(np.clip(found[1] / sum(found), LEAST, 1.0 - LEAST))
