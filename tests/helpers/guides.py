"""Guides as a controller has them, and what samples around proposals say of psi."""

from collections.abc import Sequence

import numpy as np
from batches import led

from pirrht import PathIntegral, Trajectory
from pirrht.proposals.guidance import DDPGuidance
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.proposal import ProposalControl

Found = tuple[float, float, float]  # log psi, its standard error and the share of effective samples


def best(
    guidance: DDPGuidance, x: np.ndarray, times: np.ndarray, key: int, trajectory: Trajectory,
    last: DDPGuide | None = None, elapsed: float = 0.0, time: float = 0.0,
) -> DDPGuide | None:  # fmt: skip
    """The best local optimum from x (n,), started from a guide made `elapsed` [s] ago if there is one."""
    found = guidance.optima(guidance.query(x, times, key, time), trajectory, [] if last is None else [last], elapsed)
    return found[0] if found else None


def valid(
    integral: PathIntegral, x: np.ndarray, times: np.ndarray, winding: tuple[int, ...], trajectory: Trajectory
) -> DDPGuide:
    """The best guide of a class, which must be valid."""
    assert isinstance(integral.guidance, DDPGuidance)
    guide = best(integral.guidance, x, times, integral.space.homology.key(winding), trajectory)
    assert guide is not None
    assert guide.valid
    return guide


def psi_around(
    integral: PathIntegral, x: np.ndarray, times: np.ndarray, leads: Sequence[ProposalControl], count: int, seed: int
) -> Found:
    """What `count` samples around each of some proposals say together."""
    log_weight = led(integral, x, times, *leads, count=count, seed=seed).log_weight
    w = np.exp(log_weight - log_weight.max())
    error = float(w.std() / w.mean() / np.sqrt(len(w)))
    return float(log_weight.max() + np.log(w.mean())), error, float(w.mean() ** 2 / (w**2).mean())
