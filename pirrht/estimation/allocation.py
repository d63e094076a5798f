"""How the samples of a plan are shared out among references: by what those around each contributed so far.

The variance of psi is the sum over references of N_h var_h(w), so for a given total it is least with N_h proportional
to the deviation of a weight around h (Neyman 1934). Estimated is the root mean square, which is no smaller: a
reference whose samples hardly weigh anything gets few. The counts are fixed before the samples of a plan are drawn, so
the estimate of psi stays unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pirrht.estimation.estimate import Estimate

PLANS = 5.0  # contributions are averaged over about so many plans
LEAST = 0.15  # of N goes to every reference, whatever it contributed
FEWEST = 8  # samples that every reference gets, if N allows


class Allocation:
    """Remembers, by class from the start of the drive, what samples around its reference contributed."""

    def __init__(self, samples: int) -> None:
        self.samples = samples  # N, on average over references
        self._contribution: dict[str, float] = {}

    def forget(self) -> None:
        """Start anew, with equal counts."""
        self._contribution = {}

    def counts(self, names: Sequence[str]) -> list[int]:
        """Samples around each reference, (H,), H N in all; a class seen for the first time counts as an average one."""
        H, N = len(names), self.samples
        known = [self._contribution[name] for name in names if name in self._contribution]
        usual = float(np.mean(known)) if known else 0.0
        if usual <= 0.0:
            return [N] * H
        raw = np.array([self._contribution.get(name, usual) for name in names])
        least = min(N, max(FEWEST, math.ceil(LEAST * N)))
        exact = least + H * (N - least) * raw / raw.sum()
        number = np.floor(exact).astype(int)
        missing = H * N - int(number.sum())
        number[np.argsort(number - exact, kind="stable")[:missing]] += 1
        return [int(n) for n in number]

    def learn(self, names: Sequence[str], estimate: Estimate) -> None:
        """Take in what the samples of a plan contributed; `names` (H,) are classes in the order of its samples."""
        first = estimate.rollouts.leads.first
        for name, start, stop in zip(names, first[:-1], first[1:], strict=False):
            found = math.sqrt(float(np.mean(estimate.weight[start:stop] ** 2)))
            before = self._contribution.get(name, found)
            self._contribution[name] = before + (found - before) / PLANS
