"""Replay of samples: a path is a function of seed and number alone, so that its steps are not kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.estimation.estimate import Rollouts
from pirrht.estimation.tuning import TUNING
from pirrht.estimation.weights import normalised
from pirrht.rollouts.backend import Backend
from pirrht.rollouts.tables import Chosen


class Replay(NamedTuple):
    """Makes control sequences and paths of the samples of an estimate."""

    backend: Backend

    def trace(self, rollouts: Rollouts, chosen: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """Return states (c, T+1, n) of chosen samples (c,), and the number of steps of each, (c,)."""
        return self.backend.trace(rollouts.setup, rollouts.leads, rollouts.origin, chosen)

    def tapes(self, rollouts: Rollouts, groups: Sequence[NDArray[np.bool_]]) -> tuple[Array, Array, Array]:
        """Return open-loop controls of groups of samples, with weights normalised within each group.

        Args:
            groups: disjoint masks (S,) of samples.

        Returns:
            weight times control (G, T, m), the weight still under way at each step (G, T), effective sample sizes (G,).
        """
        ess, weight, group = np.zeros(len(groups)), np.zeros(rollouts.size), np.full(rollouts.size, -1, dtype=np.int64)
        for g, mask in enumerate(groups):
            weight[mask], ess[g] = normalised(rollouts.log_weight[mask])
            group[mask] = g
        number = np.flatnonzero(weight > TUNING.negligible)
        chosen = Chosen(number, group[number], weight[number])
        controls = self.backend.controls(rollouts.setup, rollouts.leads, rollouts.origin, chosen, len(groups))
        return *controls, ess

    def tape(self, parts: Sequence[Rollouts]) -> tuple[Array, Array]:
        """Return open-loop controls (T, m) of all samples (paper, end of IV-C), and the weight under way (T,)."""
        top = max(float(part.log_weight.max()) for part in parts)
        share = np.array([float(np.exp(part.log_weight - top).sum()) for part in parts])
        share /= share.sum()
        tapes = [self.tapes(part, [np.ones(part.size, dtype=np.bool_)])[:2] for part in parts]
        tape = sum(w * one[0] for w, (one, _) in zip(share, tapes, strict=True))
        alive = sum(w * one[0] for w, (_, one) in zip(share, tapes, strict=True))
        return np.asarray(tape), np.asarray(alive)
