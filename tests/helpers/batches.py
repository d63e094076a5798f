"""Batches put together by hand: tapes, corners and guides of one's own instead of those of a tree."""

from collections.abc import Mapping, Sequence

import numpy as np

from pirrht.estimation.estimate import Rollouts
from pirrht.estimation.sampler import PathIntegral
from pirrht.proposals.guide import DDPGuide, LinearFeedback
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl, Tape


def led(
    integral: PathIntegral,
    x: np.ndarray,
    times: np.ndarray,
    *leads: ProposalControl,
    count: int,
    seed: int,
    time: float = 0.0,
) -> Rollouts:
    """`count` samples around each of some proposals."""
    proposals = tuple(Proposal(lead=lead, count=count) for lead in leads)
    return integral.rollout(Batch(state=x, times=times, proposals=proposals, time=time), seed)


def still(times: np.ndarray, m: int = 2) -> Tape:
    """Control sequence of nothing."""
    return Tape(times, np.zeros((len(times) - 1, m)))


def batch_of(
    integral: PathIntegral, x: np.ndarray, times: np.ndarray, tapes: np.ndarray, *, counts: Sequence[int] | None = None,
    corners: Sequence[np.ndarray] | None = None, guides: Sequence[DDPGuide | None] | None = None,
    classes: Mapping[int, str] | None = None,
) -> Batch:  # fmt: skip
    """Samples from x (n,) around guides if there are any, else on ways over corners (k, 2), else along tapes (T, m)."""

    def lead(h: int) -> ProposalControl:
        if guides is not None and (guide := guides[h]) is not None:
            return LinearFeedback(guide)
        if corners is not None and integral.proposals.climbs and len(corners[h]):
            return integral.proposals.climbing(x, np.asarray(corners[h]))
        return Tape(times, np.asarray(tapes[h], dtype=float))

    H = len(tapes)
    number = [integral.sampling.samples] * H if counts is None else counts
    names = [*(classes or {}).items(), *[(None, "")] * H]
    proposals = [Proposal(lead=lead(h), count=int(number[h]), key=names[h][0], name=names[h][1]) for h in range(H)]
    return Batch(state=np.asarray(x, dtype=float), times=times, proposals=tuple(proposals))
