"""Sampling in several batches, as many as a target or the time left requires.

The first batch alone is an unbiased estimate of psi. A number of batches that depends on their samples
(`Sampling.target`) tends to stop before heavy samples are met, so that the estimate is consistent but not unbiased; a
time limit does so as far as the time that samples take depends on their outcome.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate, Rollouts
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.tuning import EstimationTuning
from pirrht.proposals.proposal import Batch


def sample(
    integral: PathIntegral, batch: Batch, seed: int, *, left: Callable[[], float] | None = None, least: float = 0.0
) -> Estimate:
    """Sample the paths of a batch in one or more rounds, and weigh all (Algorithm 4, line 4).

    Args:
        seed: of the plan; equal seeds give equal paths.
        left: time left [s]; rounds are drawn until it is up.
        least: rounds are drawn up to so many effective samples.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    settings, tuning, number = integral.sampling, integral.tuning, np.asarray(batch.counts)
    parts: list[Rollouts] = []

    def draw(number: NDArray[np.int64]) -> None:
        parts.append(integral.rollout(batch.counting(number.tolist()), _seed(seed, len(parts))))

    if left is None:
        draw(number)
    else:
        part, before = tuning.first_round if integral.moving else 1.0, left()
        draw(np.maximum(1, np.rint(part * number)).astype(np.int64))
        _until(left, (before - left()) / part, part, number, draw, tuning)
    drawn, most = 1.0, max(1.0, settings.most / settings.samples)
    while settings.target is not None and drawn < most and not _so_far(integral, parts)[0] <= settings.target:
        more = min(drawn, most - drawn)
        draw(np.maximum(1, np.rint(more * number)).astype(np.int64))
        drawn += more
    most = min(tuning.first_plan, tuning.most / max(1.0, float(number.sum())))
    enough = 2 if least <= 0.0 or _so_far(integral, parts)[1] >= least else 0
    while enough < 2 and 2.0 * drawn <= most:  # twice: so many may be chance, until a heavy sample comes
        draw(np.rint(drawn * number).astype(np.int64))
        drawn *= 2.0
        enough = enough + 1 if _so_far(integral, parts)[1] >= least else 0
    return integral.weighed(parts, batch.named)


def _until(
    left: Callable[[], float], duration: float, drawn: float, number: NDArray[np.int64],
    draw: Callable[[NDArray[np.int64]], None], tuning: EstimationTuning,
) -> None:  # fmt: skip
    """Draw rounds while time is left; `drawn` times `number` (H,) samples are there, of `duration` [s] per `number`."""
    least, most = drawn, tuning.most / float(number.sum())
    while drawn < most:
        before = left()
        more = min(2.0 * drawn, most - drawn, tuning.filled * before / max(duration, 1e-6))
        if more < least:  # as few as that are not worth their overhead
            return
        draw(np.rint(more * number).astype(np.int64))
        duration, drawn = (before - left()) / more, drawn + more


def _so_far(integral: PathIntegral, parts: Sequence[Rollouts]) -> tuple[float, float]:
    """Return the control's largest standard error [control] and effective samples; inf and 0 without survivors."""
    try:
        estimate = integral.weighed(parts)
    except NoSurvivingSample:
        return np.inf, 0.0
    return float(estimate.control_error.max()), estimate.ess


def _seed(seed: int, r: int) -> int:
    """Return the seed of a round; that of the first is the plan's own."""
    return seed if r == 0 else int(np.random.SeedSequence([seed, r]).generate_state(1, np.uint64)[0] >> np.uint64(1))
