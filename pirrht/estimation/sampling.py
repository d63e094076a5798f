"""Settings of samples, and their allocation to classes and the local optima of each, by what earlier ones contributed.

The variance of psi is the sum over references of N_h var_h(w), so for a given total it is least with N_h proportional
to the deviation of a weight around h (Neyman 1934). Estimated is the root mean square, which is no smaller: a
reference whose samples hardly weigh anything gets few. Before anything is known, the predicted psi of a class replaces
it. Two proposals of one class reach each other's paths, so they share its samples by the weight that these carry. The
counts are fixed before the samples of a plan are drawn, so the estimate of psi stays unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.estimation.estimate import Estimate
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl
from pirrht.proposals.tuning import TUNING as PROPOSALS

EXITS = ("bridge", "endpoint")
WEIGHTS = ("balance", "average", "biased")
GUIDES = ("feedback", "open-loop")
ALLOCATIONS = ("contribution", "equal")
DRAWS = ("antithetic", "independent")
STEPS = ("fitted", "uniform")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sampling:
    """Settings of drawing and weighing paths.

    Attributes:
        dt: rollout step [s].
        steps: with exit along the step, steps of dt are "fitted" to the place, split near walls and goal (without noise
            on the position they are whole, and it moves as in continuous time), or "uniform" (paper).
        first: with exit along the step, the first dt is split into steps of this length [s].
        samples: N, around each reference.
        exit: first exit judged along the step ("bridge") or at its end ("endpoint", the paper's).
        weights: "balance" heuristic, plain "average" (the paper's), or "biased": no likelihood ratio (Biased-MPPI).
        guide: "feedback": samples of a point climb psi of their class, those of other systems follow a guide; or they
            follow the controls of their reference "open-loop" (paper).
        window: under feedback the control now is averaged over so long [s] where walls and goal are far.
        draws: "antithetic" pairs of samples with opposite noise, or "independent" ones (the paper's).
        target: sample on until the control's standard error is no larger [control]: consistent, not unbiased.
        least: effective samples of the first plan of a run, with 64 N samples at most.
        budget: with a target, samples around each reference at most; None: 16 N.
        allocation: of samples: by "contribution" of references in earlier plans, or "equal" (paper).
        threads: None for all cores this process may use; results do not depend on it.

    Raises:
        OptionError: a number is out of range, or a choice is unknown.

    Examples:
        >>> from pirrht import Sampling
        >>> Sampling()
        Sampling(defaults)
        >>> Sampling(samples=1000, dt=0.05)
        Sampling(dt=0.05, samples=1000)
    """

    dt: float = 0.1
    steps: str = "fitted"
    first: float | None = None
    samples: int = 200
    exit: str = "bridge"
    weights: str = "balance"
    guide: str = "feedback"
    window: float = 0.4
    draws: str = "antithetic"
    target: float | None = None
    least: float = 0.0
    budget: int | None = None
    allocation: str = "contribution"
    threads: int | None = None

    def __repr__(self) -> str:
        other = [f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Sampling({', '.join(other) or 'defaults'})"

    def __post_init__(self) -> None:
        enough = self.budget is None or (self.target is not None and self.budget >= self.samples)
        for name, valid, rule in (
            ("dt", 0 < self.dt < np.inf, "it must be a positive number of seconds"),
            ("first", self.first is None or self.first > 0, "it must be a positive number of seconds"),
            ("window", 0 <= self.window < np.inf, "it must be a number of seconds"),
            ("target", self.target is None or self.target > 0, "it must be a positive standard error of the control"),
            ("budget", enough, f"it needs a target and at least the {self.samples} samples"),
            ("samples", self.samples >= 1, "at least 1 is needed"),
        ):
            if not valid:
                value = getattr(self, name)
                raise OptionError(f"{name} is {value if isinstance(value, int) else format(value, 'g')}; {rule}")
        choices = {"exit": EXITS, "steps": STEPS, "weights": WEIGHTS, "guide": GUIDES}
        for name, known in (choices | {"allocation": ALLOCATIONS, "draws": DRAWS}).items():
            if getattr(self, name) not in known:
                raise OptionError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(known)}")

    @property
    def first_dt(self) -> float:
        """Length of the steps that the first dt is split into [s]; dt with exits at ends of steps."""
        return self.dt if self.first is None or self.exit == "endpoint" else self.first

    @property
    def fitted(self) -> bool:
        """Check whether steps are split near walls and goal, or turn; not with exits at their ends."""
        return self.exit == "bridge" and self.steps == "fitted"

    @property
    def most(self) -> int:
        """Samples around each reference at most, under a target."""
        return 16 * self.samples if self.budget is None else self.budget


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
