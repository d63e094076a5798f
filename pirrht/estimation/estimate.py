"""Estimates by weighted samples: psi, the value, the control, and the share of each class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.errors import NoSurvivingSample
from pirrht.estimation.tuning import TUNING
from pirrht.estimation.weights import centred, deviation, grouped, heavy, tail_shape
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.rollouts.tables import Origin, Paths, ProposalTables, Setup

if TYPE_CHECKING:
    from pirrht.proposals.wall_drift import NearWalls

OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rollouts:
    """S sampled paths from one state; their states are simulated again where needed (`Replay`)."""

    setup: Setup
    tables: ProposalTables
    origin: Origin
    paths: Paths
    log_weight: Array  # (S,) log of each sample's contribution to psi [nats]; -inf for paths that ran out of time
    rise: Array  # (H, m) each proposal control now less its mean over the first step [control]

    @property
    def x0(self) -> Array:
        """Initial state (n,)."""
        return self.origin.x

    @property
    def size(self) -> int:
        """Number S of samples."""
        return len(self.log_weight)

    def __repr__(self) -> str:
        return f"Rollouts({self.size} samples from {formatting.vector(self.x0)})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimate:
    """Estimate at one state by samples; `plan.estimate` of a `Plan`.

    Attributes:
        control: u* now, (m,) [control].
        log_psi: logarithm of the desirability [nats].
        value: v = -lambda log psi [cost].
        value_error: standard error of v [cost]; its largest term counts several times (`weights.scatter`).
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
        """Wall drift, a part of `control`, (m,) [control]."""
        return self.walls.push

    def __repr__(self) -> str:
        heaviest = sorted(self.class_weights.items(), key=lambda one: -one[1])[:4]
        classes = ", ".join(f"{formatting.turns(name)} {formatting.share(w)}" for name, w in heaviest if w >= 0.005)
        return f"Estimate({self._figures()}{f'; {classes}' if classes else ''})"

    def _repr_html_(self) -> str:
        rows = []
        for name, weight in sorted(self.class_weights.items(), key=lambda one: -one[1]):
            control = formatting.vector(self.class_controls[name] + self.push)
            rows.append([formatting.turns(name), formatting.share(weight), f"{self.class_ess[name]:.1f}", control])
        return formatting.table(self._figures(), ["class", "weight", "ESS", "control"], rows)

    def _figures(self) -> str:
        drawn = sum(part.size for part in self.parts)
        control = f"control {formatting.vector(self.control)} +- {formatting.vector(self.control_error)}"
        return f"v {self.value:.4g} +- {self.value_error:.2g}, {control}, ESS {self.ess:.0f} of {drawn}"

    @property
    def doubtful(self) -> bool:
        """Check for too few effective samples for reliable errors."""
        return self.ess < TUNING.few

    @property
    def tail(self) -> float:
        """Shape k of the tail of the weights (`weights.tail_shape`); nan where too few have any."""
        return tail_shape(np.concatenate([part.log_weight for part in self.parts]))

    @property
    def heavy_tailed(self) -> bool:
        """Check whether weights that were not drawn may outweigh all that were, so that errors are too small."""
        return heavy(self.tail, sum(part.size for part in self.parts))


def weigh(
    problem: Problem, parts: Sequence[Rollouts], walls: NearWalls, classes: Mapping[int, str] | None = None
) -> Estimate:
    """Weigh the samples: v and its error [cost], u (m,) and its error, and the share of every class in them.

    Args:
        walls: wall drift at the state.
        classes: additive class keys to the names of the references' classes.

    Each part is weighed by its own proposals. Where these were fixed before it was drawn, the mean over all samples is
    an unbiased estimate of psi, even if they depend on earlier parts.

    Raises:
        NoSurvivingSample: no sample has any weight.
    """
    paths = parts[0].paths
    if len(parts) > 1:
        paths = Paths(*map(np.concatenate, zip(*(part.paths for part in parts), strict=True)))
    log_weight = np.concatenate([part.log_weight for part in parts])
    first = np.cumsum(np.concatenate([[0], *(np.diff(part.tables.first) for part in parts)]))
    top = float(log_weight.max())
    if not np.isfinite(top):
        lost = [int(np.sum(paths.outcome == one)) for one in (Outcome.COLLISION, Outcome.TIMEOUT)]
        raise NoSurvivingSample(collisions=lost[0], timeouts=lost[1])
    relative = np.exp(log_weight - top)
    total = float(relative.sum())
    weight = relative / total
    log_psi = top + float(np.log(total)) - float(np.log(len(log_weight)))
    names = [*(classes or {}).values(), OTHER]
    groups = grouped(weight, paths.key, [*(classes or {})], paths.now, paths.span)
    span = max(float(groups.span.sum()), 1e-300)
    control = groups.control.sum(axis=0) / span
    errors = deviation(centred(weight, paths.now, paths.span, control), first, parts[0].tables.mirrored)
    # Not `@`: waiting for each other costs the threads of a BLAS far more than such a short sum does.
    free, unresolved = walls.corrected_control(control, np.einsum("s,sm->m", weight, paths.start_control))
    drawn_around = np.array([float(weight[a:b].sum()) for a, b in zip(first[:-1], first[1:], strict=True)])
    drawn_around = drawn_around.reshape(len(parts), -1).sum(axis=0)
    end = np.cumsum([part.size for part in parts])
    shown = max(i for i, part in enumerate(parts) if np.isfinite(part.log_weight.max()))
    ess = groups.weight**2 / np.maximum(groups.square, 1e-300)
    means = groups.control / np.maximum(groups.span, 1e-300)[:, None] + (free - control)
    return Estimate(
        control=free + drawn_around @ parts[0].rise + walls.push, log_psi=log_psi,
        value=-problem.temperature * log_psi, value_error=problem.temperature * float(errors[0]),
        control_error=np.hypot(errors[1:] / span, unresolved), ess=float(1.0 / np.sum(weight**2)),
        weight=weight[end[shown] - parts[shown].size : end[shown]],
        class_weights=dict(zip(names, groups.weight.tolist(), strict=True)),
        class_ess=dict(zip(names, ess.tolist(), strict=True)), class_controls=dict(zip(names, means, strict=True)),
        proposal_weights=drawn_around.tolist(), survivors=int(np.sum(paths.outcome == Outcome.GOAL)),
        rollouts=parts[shown], parts=tuple(parts), walls=walls,
    )  # fmt: skip
