"""Estimates by weighted samples: psi, the value, the control, the share of each class, and where to sample next.

The variance of psi is the sum over references of N_h var_h(w), so for a given total it is least with N_h proportional
to the deviation of a weight around h (Neyman 1934). Estimated is the root mean square, which is no smaller: a
reference whose samples hardly weigh anything gets few. Before anything is known, the predicted psi of a class replaces
it. Two proposals of one class reach each other's paths, so they share its samples by the weight that these carry. The
counts are fixed before the samples of a plan are drawn, so the estimate of psi stays unbiased.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array, IntArray
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.sampling import TUNING, EstimationTuning
from pirrht.estimation.weights import deviation, heavy, normalised, shrinkage, tail_shape
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, Proposal, ProposalControl
from pirrht.proposals.tuning import TUNING as PROPOSALS
from pirrht.rollouts.tables import Origin, Paths, ProposalTables, Setup
from pirrht.topology.signature import OTHER

if TYPE_CHECKING:
    from pirrht.proposals.wall_drift import NearWalls


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rollouts:
    """S sampled paths from one state; their states are simulated again where needed (`Replay`)."""

    setup: Setup
    tables: ProposalTables
    origin: Origin
    paths: Paths
    log_weight: Array  # (S,) log of each sample's contribution to psi [nats]; -inf for paths that ran out of time
    rise: Array  # (H, m) each proposal control now less its mean over the first step [control]
    laws: Array | None = None  # (H, m) that mean, to which the control shrinks [control]; None: it does not

    @property
    def size(self) -> int:
        """Number S of samples."""
        return len(self.log_weight)

    def __repr__(self) -> str:
        return f"Rollouts({self.size} samples of {len(self.rise)} proposals)"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """Estimate at one state by samples; `plan.estimate` of a `Plan`.

    Attributes:
        control: u* now, (m,) [control]. Where samples follow guides, their correction of these is used as far as it is
            known (`weights.shrinkage`).
        log_psi: logarithm of the desirability [nats].
        value: v = -lambda log psi [cost].
        value_error: standard error of v [cost]; its largest term counts several times (`weights.scatter`). Where noise
            does not act on the position, it includes the bias of whole steps.
        control_error: standard error of the control, (m,) [control], with the bias of its mean near walls.
        ess: effective sample size (sum w)^2 / sum w^2 of all samples.
        weight: normalised, (S,), of the samples in `rollouts`; with others in `parts` they sum to less than 1.
        class_weights: weight, from 0 to 1, by the class of each sample's own path, "other" for the rest.
        class_ess: effective sample size within each class.
        class_controls: mean of u* over the first step within each class, (m,) [control], without wall drift.
        proposal_weights: weight by the reference a sample was drawn around, (H,).
        survivors: number of samples that reached the goal.
        rollouts: the last samples that have any weight.
        parts: all samples, by round.
        walls: wall drift and its effect on `control`.
        classes: names of the classes in `class_weights` but "other", by the additive key of a sample's path.

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
    walls: "NearWalls"
    classes: Mapping[int, str] = field(default_factory=dict)

    @property
    def class_weight_errors(self) -> dict[str, float | None]:
        """Standard errors of `class_weights`; None of a class without any, which its samples do not tell."""
        paths, log_weight, first = all_samples(self.parts)
        weight, _ = normalised(log_weight)
        member = paths.key[:, None] == np.array([*self.classes], dtype=np.int64)
        member = np.column_stack([member, ~member.any(axis=1)])
        shares = np.array([*self.class_weights.values()])
        errors = deviation(weight[:, None] * (member - shares), first, self.parts[0].tables.mirrored)
        known = zip(self.class_weights.items(), errors.tolist(), strict=True)
        return {name: error if share > 0.0 else None for (name, share), error in known}

    @property
    def push(self) -> Array:
        """Wall drift, a part of `control`, (m,) [control]."""
        return self.walls.push

    def __repr__(self) -> str:
        drawn = sum(part.size for part in self.parts)
        heaviest = sorted(self.class_weights.items(), key=lambda one: -one[1])[:4]
        control = f"control {formatting.vector(self.control)} +- {formatting.vector(self.control_error)}"
        figures = f"v {self.value:.4g} +- {self.value_error:.2g}, {control}, ESS {self.ess:.0f} of {drawn}"
        classes = ", ".join(f"{formatting.turns(name)} {formatting.share(w)}" for name, w in heaviest if w >= 0.005)
        return f"Estimate({figures}{f'; {classes}' if classes else ''})"

    @property
    def doubtful(self) -> bool:
        """Check for too few effective samples for reliable errors."""
        return self.ess < TUNING.few

    def split(self, chosen: IntArray, weight: Array) -> Iterator[tuple[Rollouts, IntArray, Array]]:
        """Yield every round with its own numbers of chosen samples of all (c,), in order, and their weights (c,)."""
        begin = 0
        for part in self.parts:
            own = slice(*np.searchsorted(chosen, [begin, begin + part.size]))
            yield part, chosen[own] - begin, weight[own]
            begin += part.size

    @property
    def tail(self) -> float:
        """Shape k of the tail of the weights (`weights.tail_shape`); nan where too few have any."""
        return tail_shape(all_samples(self.parts)[1])

    @property
    def heavy_tailed(self) -> bool:
        """Check whether weights that were not drawn may outweigh all that were, so that errors are too small."""
        return heavy(self.tail, sum(part.size for part in self.parts))


def all_samples(parts: Sequence[Rollouts]) -> tuple[Paths, Array, IntArray]:
    """Return the paths of several rounds as one, their log weights (S,) and the first sample of each reference."""
    paths = parts[0].paths
    if len(parts) > 1:
        paths = Paths(*map(np.concatenate, zip(*(part.paths for part in parts), strict=True)))
    first = np.cumsum(np.concatenate([[0], *(np.diff(part.tables.first) for part in parts)]))
    return paths, np.concatenate([part.log_weight for part in parts]), first


def weigh(
    problem: Problem, parts: Sequence[Rollouts], walls: "NearWalls", classes: Mapping[int, str] | None = None
) -> Estimate:
    """Weigh the samples: v and its error [cost], u (m,) and its error, and the share of every class in them.

    `walls` is the wall drift at the state, `classes` are names of the references' classes by additive key. Each part is
    weighed by its own proposals. Where these were fixed before it was drawn, the mean over all samples is an unbiased
    estimate of psi, even if they depend on earlier parts. NoSurvivingSample: no sample has any weight.
    """
    paths, log_weight, first = all_samples(parts)
    top = float(log_weight.max())
    H = len(parts[0].tables.first) - 1

    if not np.isfinite(top):
        lost = [int(np.sum(paths.outcome == one)) for one in (Outcome.COLLISION, Outcome.TIMEOUT)]
        raise NoSurvivingSample(collisions=lost[0], timeouts=lost[1])
    relative = np.exp(log_weight - top)
    total = float(relative.sum())
    weight = relative / total
    log_psi = top + float(np.log(total)) - float(np.log(len(log_weight)))
    keys = [*(classes or {})]
    names = [*(classes or {}).values(), OTHER]
    group = np.full(len(weight), len(keys))  # class of each sample
    for g, key in enumerate(keys):
        group[paths.key == key] = g
    times_weight = (np.ones(()), weight, paths.span, *paths.now.T)
    shares, squares, spans, *sums = (np.bincount(group, weight * one, len(names)) for one in times_weight)
    ess = shares**2 / np.maximum(squares, 1e-300)
    controls = np.stack(sums, axis=1)
    span = max(float(spans.sum()), 1e-300)
    control = controls.sum(axis=0) / span
    # Terms of psi and, to first order (delta method), of the control.
    terms = np.column_stack([weight, weight[:, None] * (paths.now - paths.span[:, None] * control)])
    errors = deviation(terms, first, parts[0].tables.mirrored)
    total_ess = float(1.0 / np.sum(weight**2))
    control_error = errors[1:] / span
    # Paths without noise on the position bend within a whole step, by which v is off (`TUNING.step_bias`).
    whole = 0.0 if problem.dynamics.noisy_position else float(np.diff(parts[0].tables.times[-2:])[0])
    steps = TUNING.step_bias * problem.least_rate * whole
    # Not `@`: waiting for each other costs the threads of a BLAS far more than such a short sum does.
    free, unresolved = walls.corrected_control(control, np.einsum("s,sm->m", weight, paths.start_control))
    means = controls / np.maximum(spans, 1e-300)[:, None] + (free - control)
    if parts[0].laws is not None:
        laws = np.tile(parts[0].laws, (len(parts), 1))
        excess, single = _excess(paths, weight, group, np.repeat(laws, np.diff(first), axis=0), (first, ess, parts))
        means -= excess
        free = free - np.einsum("g,gm->m", spans, excess) / span
        control_error = np.maximum(control_error, single / math.sqrt(total_ess))
    pieces = [float(weight[a:b].sum()) for a, b in itertools.pairwise(first)]
    drawn_around = np.reshape(pieces, (len(parts), H)).sum(axis=0)
    shown = max(i for i, part in enumerate(parts) if np.isfinite(part.log_weight.max()))
    begin = sum(part.size for part in parts[:shown])
    return Estimate(
        control=free + drawn_around @ parts[0].rise + walls.push, log_psi=log_psi,
        value=-problem.temperature * log_psi, value_error=math.hypot(problem.temperature * float(errors[0]), steps),
        control_error=np.hypot(control_error, unresolved), ess=total_ess,
        weight=weight[begin : begin + parts[shown].size],
        class_weights=dict(zip(names, shares.tolist(), strict=True)),
        class_ess=dict(zip(names, ess.tolist(), strict=True)), class_controls=dict(zip(names, means, strict=True)),
        proposal_weights=drawn_around.tolist(), survivors=int(np.sum(paths.outcome == Outcome.GOAL)),
        rollouts=parts[shown], parts=tuple(parts), walls=walls, classes=dict(classes or {}),
    )  # fmt: skip


def _excess(
    paths: Paths, weight: Array, group: IntArray, laws: Array, known: tuple[IntArray, Array, Sequence[Rollouts]]
) -> tuple[Array, Array]:
    """Return what chance may have added to each class's control (G, m), and the deviation of one sample (m,).

    Samples correct the mean control of their laws (S, m) by their noise, which is used as far as it is known
    (`shrinkage`). A few heavy samples agree by chance: an error is at least the deviation of one around its law over
    the root of the effective number. Classes of samples that follow no law (nan) are left alone.
    """
    first, ess, parts = known
    m = laws.shape[1]
    no_law = np.isnan(laws[:, 0])

    noise = np.where(no_law[:, None], 0.0, paths.now - paths.span[:, None] * laws)
    squares = max(float(np.sum(paths.span[~no_law] ** 2)), 1e-300)
    single = np.sqrt(np.sum(noise**2, axis=0) / squares)
    member = weight[:, None] * (group[:, None] == np.arange(len(ess)))
    times = np.maximum(np.einsum("sg,s->g", member, paths.span), 1e-300)[:, None]
    mean = np.einsum("sg,sm->gm", member, noise) / times
    terms = member[:, :, None] * (noise[:, None] - paths.span[:, None, None] * mean)
    errors = deviation(terms.reshape(len(weight), -1), first, parts[0].tables.mirrored).reshape(-1, m) / times
    errors = np.maximum(errors, single / np.sqrt(np.maximum(ess, 1e-300))[:, None])
    follows = ~np.any(member[no_law] > 0.0, axis=0)
    return follows[:, None] * (1.0 - shrinkage(mean, errors)) * mean, single


@dataclass(slots=True)
class Allocation:
    """Distributes the samples of a plan, and learns from their weights."""

    contribution: dict[str, float] = field(default_factory=dict)  # root mean square weight of samples by class
    shares: dict[str, Array] = field(default_factory=dict)  # of a class's samples around each of its proposals
    tuning: EstimationTuning = TUNING

    def counts(
        self, names: Sequence[str], predicted: Sequence[float], worth: Sequence[bool], samples: int
    ) -> list[int]:
        """Return the samples around each reference, (H,), so many on average over those that are worth it.

        Args: names of the classes, (H,), of which a new one counts as an average one; predicted log psi of each, (H,)
            [nats]; whether each is worth more than the fewest samples, (H,).
        """
        t, chosen = self.tuning, [k for k in range(len(names)) if worth[k] or not any(worth)]
        fewest = min(samples, t.fewest)
        least = min(samples, max(t.fewest, math.ceil(t.least_share * samples)))
        known = [self.contribution[names[k]] for k in chosen if names[k] in self.contribution]
        usual = np.mean(known) if known else 0.0
        promise = np.asarray(predicted)[chosen]
        raw = np.ones(len(chosen))
        if usual > 0.0:
            raw = np.array([self.contribution.get(names[k], usual) for k in chosen])
        elif np.isfinite(promise).all():
            raw = np.exp(promise - promise.max())
        exact = least + (samples - least) * len(chosen) * raw / raw.sum()
        number = np.floor(exact)
        counts = np.full(len(names), fewest)
        number[np.argsort(number - exact, kind="stable")[: samples * len(chosen) - int(number.sum())]] += 1
        counts[chosen] = number
        return [int(n) for n in counts]

    def split(self, proposals: Sequence[Proposal], others: Callable[[int], list[ProposalControl]]) -> list[Proposal]:
        """Divide the samples of the k-th class between its proposal and `others(k)`."""
        first = []
        more = []
        few = min(PROPOSALS.few, max((one.count for one in proposals), default=0) - 1)
        for k, one in enumerate(proposals):
            added = others(k) if one.count > few else []  # so few samples can hardly carry weight
            shares = self.shares.get(one.name, np.empty(0))
            if len(shares) != len(added) + 1:
                shares = np.full(len(added) + 1, 1.0 / (len(added) + 1))
            counts = []
            left = one.count - 1

            for share in shares[1:]:
                counts.append(min(round(share * one.count), left))
                left -= counts[-1]
            first.append(replace(one, count=left + 1))
            more += [replace(one, lead=lead, count=count) for lead, count in zip(added, counts, strict=True) if count]
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
        least = self.tuning.least_share
        for name, of_class in weights.items():
            if len(of_class) > 1 and sum(of_class) > 0.0:
                shares = np.clip(np.array(of_class) / sum(of_class), least / (len(of_class) - 1), 1.0 - least)
                self.shares[name] = shares / shares.sum()
