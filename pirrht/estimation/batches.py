"""Sampling in several batches, as many as a target or the time left asks for.

The first batch alone is an unbiased estimate of psi. A number of batches that depends on what they found
(`Sampling.target`) tends to stop when heavy samples have not been met yet, so that the estimate is consistent, for ever
more samples exact, but not unbiased. So it is where time decides, as far as the time that samples take depends on what
becomes of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate, Rollouts
from pirrht.estimation.sampler import PathIntegral
from pirrht.guidance.leads import Batch

FILLED = 0.6  # of the time left is used by the next round, since the pace changes; with the last, it is all used
FIRST = 0.1  # of the samples of a plan come first where bodies move, lest what else a plan needs makes them late
FIRST_MOST = 64  # times the samples of a plan that the first of a drive draws at most (`Sampling.least`)
MOST = 150_000  # samples of a plan, however much time there is: weighing more of them takes longer than it is worth


def sample(
    integral: PathIntegral,
    batch: Batch,
    seed: int,
    *,
    left: Callable[[], float] | None = None,
    least: float = 0.0,
) -> Estimate:
    """Sample the paths of a batch, more like them as settings or time ask for, and weigh all (Algorithm 4, line 4).

    Args:
        seed: of the plan; equal seeds give equal paths.
        left: time left [s]; more batches are drawn until it is up.
        least: more batches are drawn until so many effective samples are there.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    settings, number = integral.sampling, np.asarray(batch.counts)
    parts: list[Rollouts] = []

    def draw(number: NDArray[np.int64]) -> None:
        parts.append(integral.rollout(batch.counting(number.tolist()), _seed(seed, len(parts))))

    if left is None:
        draw(number)
    else:
        part, before = FIRST if integral.moving else 1.0, left()
        draw(np.maximum(1, np.rint(part * number)).astype(np.int64))
        _until(left, (before - left()) / part, part, number, draw)
    drawn, most = 1.0, max(1.0, settings.most / settings.samples)
    while settings.target is not None and drawn < most and not _so_far(integral, parts)[0] <= settings.target:
        more = min(drawn, most - drawn)
        draw(np.maximum(1, np.rint(more * number)).astype(np.int64))
        drawn += more
    most = min(FIRST_MOST, MOST / max(1.0, float(number.sum())))
    enough = 2 if least <= 0.0 or _so_far(integral, parts)[1] >= least else 0
    while enough < 2 and 2.0 * drawn <= most:  # twice: so many may be chance, until a heavy sample comes
        draw(np.rint(drawn * number).astype(np.int64))
        drawn *= 2.0
        enough = enough + 1 if _so_far(integral, parts)[1] >= least else 0
    return integral.weighed(parts, batch.named)


def _until(
    left: Callable[[], float],
    pace: float,
    drawn: float,
    number: NDArray[np.int64],
    draw: Callable[[NDArray[np.int64]], None],
) -> None:
    """Draw rounds of samples while time is left: of `number` (H,) so many times as many are drawn, each `pace` [s]."""
    least, most = drawn, MOST / float(number.sum())
    while drawn < most:
        before = left()
        more = min(2.0 * drawn, most - drawn, FILLED * before / max(pace, 1e-6))
        if more < least:  # as few as that are not worth their overhead
            return
        draw(np.rint(more * number).astype(np.int64))
        pace, drawn = (before - left()) / more, drawn + more


def _so_far(integral: PathIntegral, parts: Sequence[Rollouts]) -> tuple[float, float]:
    """The control's largest standard error [control] and effective samples; infinite and 0 if none survives."""
    try:
        estimate = integral.weighed(parts)
    except NoSurvivingSample:
        return np.inf, 0.0
    return float(estimate.control_error.max()), estimate.ess


def _seed(seed: int, r: int) -> int:
    """Seed of a round; that of the first is the plan's own."""
    return seed if r == 0 else int(np.random.SeedSequence([seed, r]).generate_state(1, np.uint64)[0] >> np.uint64(1))
