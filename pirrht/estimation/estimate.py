"""What weighted samples say: psi, the value, the control, and how much of it each class accounts for.

Weights stay logarithms throughout: phi/lambda can exceed a million.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pirrht import shown
from pirrht.arrays import Array
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.weights import centred, grouped, heavy, scatter, tail_shape
from pirrht.guidance.near_walls import NearWalls
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollouts.records import Leads, MovingSetup, Origin, Paths, Setup

OTHER = "other"
SHOWN, LEAST = 4, 0.005  # so many classes are told in a line, and none of less weight
FEW = 10.0  # effective samples that are too few for standard errors to mean much


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rollouts:
    """S sampled paths from one state; full states are simulated again for those that are shown."""

    origin: Origin
    leads: Leads
    paths: Paths
    log_weight: Array  # (S,) log of each sample's contribution to psi [nats]; -inf for paths that ran out of time
    setup: Setup | MovingSetup | None = None  # what they met; None: what a replay knows
    rise: Array | None = None  # (H, m) what each lead is now above its mean over the first step [control]

    @property
    def x0(self) -> Array:
        """State that they start from, (n,)."""
        return self.origin.x

    @property
    def size(self) -> int:
        """Number S of samples."""
        return len(self.log_weight)

    def __repr__(self) -> str:
        return f"Rollouts({self.size} samples from {shown.vector(self.x0)})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """What the samples say about one state; `plan.estimate` of a `Plan`.

    Attributes:
        control: u* now, (m,) [control].
        log_psi: logarithm of the desirability [nats].
        value: v = -lambda log psi [cost].
        value_error: standard error of v [cost]; its largest term counts several times (`sums.scatter`).
        control_error: standard error of the control, (m,) [control], with what its mean over leading steps may miss at
            walls.
        ess: effective sample size (sum w)^2 / sum w^2 of all samples.
        weight: normalised, (S,), of the samples in `rollouts`; with others in `parts` they sum to less than 1.
        class_weights: weight, from 0 to 1, by the class of each sample's own path, "other" for the rest.
        class_ess: effective sample size within each class.
        class_controls: mean of u* over the first step within each class, (m,) [control], without what the nearest wall
            adds.
        proposal_weights: weight by the reference a sample was drawn around, (H,).
        survivors: number of samples that reached the goal.
        rollouts: the last samples that have any weight.
        parts: all samples, in the rounds in which they were drawn.
        walls: what the nearest ones do to `control`.

    Examples:
        >>> estimate = controller.plan(x).estimate  # doctest: +SKIP
        >>> estimate  # doctest: +SKIP
        Estimate(v 10.93 +- 0.015, control (0.94, -0.0617) +- (0.025, 0.02), ESS 404 of 600; 0,0 66 %, 0,1 34 %)
    """

    control: Array
    log_psi: float
    value: float
    value_error: float
    control_error: Array
    ess: float
    weight: Array
    class_weights: dict[str, float]
    class_ess: dict[str, float]
    class_controls: dict[str, Array]
    proposal_weights: list[float]
    survivors: int
    rollouts: Rollouts
    parts: tuple[Rollouts, ...]
    walls: NearWalls

    @property
    def push(self) -> Array:
        """The part of `control` that the nearest walls account for, (m,) [control]."""
        return self.walls.push

    def __repr__(self) -> str:
        leading = sorted(self.class_weights.items(), key=lambda one: -one[1])[:SHOWN]
        classes = ", ".join(f"{shown.turns(name)} {shown.share(w)}" for name, w in leading if w >= LEAST)
        return f"Estimate({self._figures()}{f'; {classes}' if classes else ''})"

    def _repr_html_(self) -> str:
        rows = [
            [shown.turns(name), shown.share(weight), f"{self.class_ess[name]:.1f}", shown.vector(self._led_by(name))]
            for name, weight in sorted(self.class_weights.items(), key=lambda one: -one[1])
        ]
        return shown.table(self._figures(), ["class", "weight", "ESS", "control"], rows)

    def _figures(self) -> str:
        drawn = sum(part.size for part in self.parts)
        control = f"control {shown.vector(self.control)} +- {shown.vector(self.control_error)}"
        return f"v {self.value:.4g} +- {self.value_error:.2g}, {control}, ESS {self.ess:.0f} of {drawn}"

    def _led_by(self, name: str) -> Array:
        return self.class_controls[name] + self.push

    @property
    def doubtful(self) -> bool:
        """Whether it rests on so few effective samples that its errors say little."""
        return self.ess < FEW

    @property
    def tail(self) -> float:
        """Shape k of the tail of the weights (`tails.tail_shape`); nan where too few have any."""
        return tail_shape(self._log_weight())

    @property
    def heavy_tailed(self) -> bool:
        """Whether weights that were not drawn may outweigh all that were, so that its errors are too small."""
        log_weight = self._log_weight()
        return heavy(tail_shape(log_weight), len(log_weight))

    def _log_weight(self) -> Array:
        return np.concatenate([part.log_weight for part in self.parts])


def log_weights(
    problem: Problem, rule: str, paths: Paths, first: NDArray[np.int64], part: tuple[int, int] | None = None
) -> Array:
    """Logarithm of the contribution to psi of each sample, (S,) [nats], or of those from part[0] to part[1].

    Args:
        rule: one of WEIGHTS; "average" is the paper's (sections III-B and IV-C). Under "biased" samples weigh by their
            cost alone, whatever drew them (Trevisan and Alonso-Mora, IEEE RA-L 2024): no estimate of psi.
        first: (H+1,) first sample of each reference; the last entry is S.
    """
    number = np.diff(first)
    H, S = len(number), int(first[-1])
    chosen = slice(0, S) if part is None else slice(*part)
    outcome = paths.outcome[chosen]
    log_weight = paths.lasting[chosen] - paths.work[chosen] / problem.temperature
    log_weight[outcome == Outcome.COLLISION] -= problem.phi / problem.temperature
    if rule == "average":
        samples = np.arange(S)[chosen]
        own = np.searchsorted(first, samples, side="right") - 1
        # The paper averages H estimators; with unequal counts each sample stands for S / (H N_h) of them.
        log_weight += np.log(S / (H * number[own])) - paths.log_ratio[samples, own]
    elif rule != "biased":
        log_weight -= _log_mean(paths.log_ratio[chosen], number / S)
    log_weight[outcome == Outcome.TIMEOUT] = -np.inf
    return log_weight


def weigh(
    problem: Problem, parts: Sequence[Rollouts], walls: NearWalls, classes: Mapping[int, str] | None = None
) -> Estimate:
    """Weigh the samples: v and its error [cost], u (m,) and its error, and the share of every class in them.

    Args:
        walls: what the nearest ones do to the control at the state.
        classes: additive class keys to the names of the references' classes.

    Each part is weighed by its own proposals. Where these were fixed before it was drawn, the mean over all samples is
    an unbiased estimate of psi, even if they were chosen by what earlier parts found.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    paths, log_weight, first = joined(parts)
    top = float(log_weight.max())
    if not np.isfinite(top):
        raise NoSurvivingSample(
            collisions=int(np.sum(paths.outcome == Outcome.COLLISION)),
            timeouts=int(np.sum(paths.outcome == Outcome.TIMEOUT)),
        )
    relative = np.exp(log_weight - top)
    total = float(relative.sum())
    weight = relative / total
    log_psi = top + float(np.log(total)) - float(np.log(len(log_weight)))
    names = [*(classes or {}).values(), OTHER]
    groups = grouped(weight, paths.key, np.array([*(classes or {})], dtype=np.int64), paths.now, paths.span)
    span = max(float(groups.span.sum()), 1e-300)
    control = groups.control.sum(axis=0) / span
    errors = deviation(centred(weight, paths.now, paths.span, control), first, parts[0].leads.mirrored)
    # Not `@`: waiting for each other costs the threads of a BLAS far more than such a short sum does.
    free, unresolved = walls.told(control, np.einsum("s,sm->m", weight, paths.led))
    drawn_around = np.array([float(weight[a:b].sum()) for a, b in zip(first[:-1], first[1:], strict=True)])
    drawn_around = drawn_around.reshape(len(parts), -1).sum(axis=0)
    rise = np.zeros(len(free)) if parts[0].rise is None else drawn_around @ parts[0].rise
    ends = np.cumsum([part.size for part in parts])
    shown = max(i for i, part in enumerate(parts) if np.isfinite(part.log_weight.max()))
    rollouts = parts[shown]
    return Estimate(
        control=free + rise + walls.push,
        log_psi=log_psi,
        value=-problem.temperature * log_psi,
        value_error=problem.temperature * float(errors[0]),
        control_error=np.hypot(errors[1:] / span, unresolved),
        ess=float(1.0 / np.sum(weight**2)),
        weight=weight[ends[shown] - rollouts.size : ends[shown]],
        class_weights=dict(zip(names, groups.weight.tolist(), strict=True)),
        class_ess=dict(zip(names, (groups.weight**2 / np.maximum(groups.square, 1e-300)).tolist(), strict=True)),
        class_controls={
            name: total / max(under_way, 1e-300) + (free - control)
            for name, total, under_way in zip(names, groups.control, groups.span.tolist(), strict=True)
        },
        proposal_weights=drawn_around.tolist(),
        survivors=int(np.sum(paths.outcome == Outcome.GOAL)),
        rollouts=rollouts,
        parts=tuple(parts),
        walls=walls,
    )


def normalised(log_weight: Array) -> tuple[Array, float]:
    """Weights (S,) that sum to 1, from logarithms [nats], and their effective size; zeros and 0 where none has any."""
    top = float(log_weight.max(initial=-np.inf))
    if not np.isfinite(top):
        return np.zeros(len(log_weight)), 0.0
    relative = np.exp(log_weight - top)
    weight: Array = relative / relative.sum()
    return weight, float(1.0 / np.sum(weight**2))


def joined(parts: Sequence[Rollouts]) -> tuple[Paths, Array, NDArray[np.int64]]:
    """All paths, their log weights (S,) [nats], and where those around each reference of a part begin, S at last."""
    paths = (
        parts[0].paths if len(parts) == 1 else Paths(*map(np.concatenate, zip(*(p.paths for p in parts), strict=True)))
    )
    number = np.concatenate([np.diff(part.leads.first) for part in parts])
    return paths, np.concatenate([part.log_weight for part in parts]), np.concatenate([[0], np.cumsum(number)])


def _log_mean(log_ratio: Array, share: Array) -> Array:
    """log sum_g share_g exp(log_ratio_g), row by row."""
    top = log_ratio[:, 0].copy()
    for column in log_ratio.T[1:]:  # few and long: several times as fast as a maximum along the rows
        np.maximum(top, column, out=top)
    mean: Array = top + np.log(np.einsum("sh,h->s", np.exp(log_ratio - top[:, None]), share))
    return mean


def deviation(terms: Array, first: NDArray[np.int64], paired: bool) -> Array:
    """Standard deviations (k,) of sums of terms (S, k), those around one reference being distributed alike.

    Terms are independent, or those of antithetic pairs are only so together; `first` is as `joined` gives it.
    """
    spread: Array = scatter(np.ascontiguousarray(terms), first, 2 if paired else 1)
    return spread
