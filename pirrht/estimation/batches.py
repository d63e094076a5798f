"""Sampling in several rounds, each of which may depend on what the earlier ones found.

Every round is weighed by its own proposals. Those of a fixed number of rounds were fixed before they were drawn, so
the mean of psi over all rounds is unbiased however the guides were corrected in between. A number of rounds that
depends on what they found (`Sampling.target`) is another matter: it tends to stop when heavy samples have not been met
yet, so that the estimate is consistent, for ever more samples exact, but not unbiased. So it is where time decides,
as far as the time that samples take depends on what becomes of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.estimate import Estimate, Rollouts, normalised, weigh
from pirrht.estimation.sampler import NEGLIGIBLE, PathIntegral
from pirrht.guidance.tracking import Guide

DOUBT = 10.0  # a correction found by so many effective samples is halved
FILLED = 0.6  # of the time left is used by the next round, since the pace changes; with the last, it is all used
MOST = 150_000  # samples of a plan, however much time there is: weighing more of them takes longer than it is worth
SMOOTH = 0.2  # corrections are averaged over about this time [s]

Draw = Callable[[NDArray[np.int64], Array | None], Rollouts]  # by counts (H,) and correction (H, T, m)


def sample(
    integral: PathIntegral,
    x: Array,
    times: Array,
    controls: Array,
    seed: int,
    *,
    counts: Sequence[int] | None = None,
    corners: Sequence[Array] | None = None,
    guides: Sequence[Guide | None] | None = None,
    classes: Mapping[int, str] | None = None,
    left: Callable[[], float] | None = None,
) -> Estimate:
    """Sample paths as `PathIntegral.rollout` does, in the rounds that its settings ask for, and weigh them all.

    Args:
        left: time left [s]; more rounds are drawn until it is up.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    settings = integral.sampling
    number = np.full(len(controls), settings.samples) if counts is None else np.asarray(counts)
    parts: list[Rollouts] = []

    def draw(number: NDArray[np.int64], correction: Array | None) -> Rollouts:
        return integral.rollout(
            x, times, controls, _seed(seed, len(parts)), counts=number.tolist(), corners=corners, guides=guides,
            correction=correction,
        )  # fmt: skip

    before = 0.0 if left is None else left()
    correction = _in_rounds(integral, number, draw, parts)
    if left is not None:
        _until(left, before - left(), number, lambda number: parts.append(draw(number, correction)))
    if settings.target is None:
        return weigh(integral, parts, classes)
    drawn, most = 1.0, max(1.0, settings.most / settings.samples)
    while drawn < most and not _known(integral, parts, settings.target):
        more = min(drawn, most - drawn)
        parts.append(draw(np.maximum(1, np.rint(more * number)).astype(np.int64), correction))
        drawn += more
    return weigh(integral, parts, classes)


def _until(
    left: Callable[[], float], pace: float, number: NDArray[np.int64], draw: Callable[[NDArray[np.int64]], None]
) -> None:
    """Draw rounds of `number` (H,) samples and more while time is left; `pace` is what the first of them took [s]."""
    drawn, most = 1.0, MOST / float(number.sum())
    while drawn < most:
        before = left()
        more = min(2.0 * drawn, most - drawn, FILLED * before / max(pace, 1e-6))
        if more < 1.0:  # as few as that are not worth their overhead
            return
        draw(np.rint(more * number).astype(np.int64))
        pace, drawn = (before - left()) / more, drawn + more


def _in_rounds(integral: PathIntegral, number: NDArray[np.int64], draw: Draw, parts: list[Rollouts]) -> Array | None:
    """Append the rounds of a plan to `parts`; the correction that the last of them was drawn with."""
    rounds = min(integral.sampling.rounds, int(number.min()))
    correction: Array | None = None
    for r in range(rounds):
        parts.append(draw(number // rounds + (r < number % rounds), correction))
        if r + 1 < rounds:
            found = correction_by(integral, parts[-1])
            correction = found if correction is None else correction + found
    return correction


def _known(integral: PathIntegral, parts: Sequence[Rollouts], target: float) -> bool:
    """Whether the control is known up to `target`, as far as the samples can tell."""
    try:
        return float(weigh(integral, parts).control_error.max()) <= target
    except NoSurvivingSample:
        return False


def correction_by(integral: PathIntegral, rollouts: Rollouts) -> Array:
    """What noise adds to each guide in the mean of its own weighted samples, (H, T, m), smooth in time.

    It is shrunk where few samples tell.
    """
    guides = rollouts.guides
    total = np.zeros_like(guides.control)
    weight, trust = np.zeros(rollouts.size), np.zeros(len(total))
    for h, (a, b) in enumerate(zip(guides.first[:-1], guides.first[1:], strict=True)):
        weight[a:b], size = normalised(rollouts.log_weight[a:b])
        trust[h] = size / (size + DOUBT)
    chosen = np.flatnonzero(weight > NEGLIGIBLE)
    integral.kernels.added(integral.world, guides, rollouts.x0, np.uint64(rollouts.seed), chosen, weight[chosen], total)
    middle, steps = 0.5 * (guides.times[1:] + guides.times[:-1]), np.diff(guides.times)
    smooth = np.exp(-0.5 * ((middle[:, None] - middle) / SMOOTH) ** 2) * steps
    smooth /= smooth.sum(axis=1, keepdims=True)
    return np.asarray(trust[:, None, None] * np.einsum("ij,hjm->him", smooth, total))


def _seed(seed: int, r: int) -> int:
    """Seed of a round; that of the first is the plan's own."""
    return seed if r == 0 else int(np.random.SeedSequence([seed, r]).generate_state(1, np.uint64)[0] >> np.uint64(1))
