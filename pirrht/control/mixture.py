"""Feedback between plans: the samples of each class estimate its desirability, and plans are pooled over time.

Per class c the samples of a plan give log psi_c and u_c = lambda R^-1 G' grad log psi_c at one state. Both are carried
along with the robot: u_c as the control of the class's guide plus what samples found on top of it, and log psi_c along
its gradient, d log psi_c = (R u_c / lambda) G^-1 dx_c (Stratonovich). In input form that is
(R u_c / lambda)' G^+ (dx - f dt), G^+ being the pseudoinverse. Where the state drifts, so that some of its gradient is
unknown, or where obstacles move and psi changes with time, it is less by u_c'R u_c dt / 2 lambda, the loss by waiting.
That is the equation of log psi without its second derivatives, the wall drift (they cancel) and q, which classes share.
The control at any state between plans is then

    u(x) = sum_c w_c(x) u_c(x),    w(x) = softmax(log psi_c(x)).

Its slope holds the spread of the u_c times R/lambda, as the exact law's does; the gain that Thijssen & Kappen (2015)
read off the samples' covariance is the linear part of it, and noisier. Since psi_c and psi_c u_c are sums over
samples, those of earlier plans add to those of the last one once carried along, at a weight that fades.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.control.settings import TUNING, ControlTuning
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.weights import normalised
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, ProposalControl

EVERY = slice(None)
WallDrift = Callable[[Array, float], Array]  # wall drift (m,) at a state (n,), s [s] after the plan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClassLaw:
    """Desirability and control of one class near the state of a plan."""

    log_psi: float  # up to a constant that all classes share [nats]
    rest: Array  # (m,) what samples found on top of the proposal control
    lead: ProposalControl | None  # None: samples of no class have none
    age: float = 0.0  # time between the plan that the guide belongs to and this one [s]
    unseen: float = 0.0  # time since samples were last of this class [s]
    law_weight: float = 1.0  # linear-law weight: share of the guide that is followed, as `ProposalTables.law_weight`

    def control(self, x: Array, s: float) -> Array:
        """Return the control (m,) of this class at state x (n,), s [s] after the plan, without wall drift."""
        return self.rest + self.guided(x, s)

    def guided(self, x: Array, s: float) -> Array:
        """Return the share (m,) of the proposal control at state x (n,), s [s] after the plan."""
        return np.zeros(len(self.rest)) if self.lead is None else self.law_weight * self.lead(x, s + self.age)


class ClassMixture:
    """Control at any state near that of a plan, u(x) = sum_c w_c(x) u_c(x).

    Args:
        state: of the plan, (n,).
        classes: laws of C classes by name.
        push: wall drift.
        negligible: classes that a linear model leaves so far behind are not evaluated [nats].
    """

    __slots__ = (
        "_before", "_drift", "_free", "_inverse", "_known", "_laws", "_loses", "_negligible", "_stiff", "_waiting",
        "classes", "problem", "push", "state",
    )  # fmt: skip

    def __init__(
        self, *, problem: Problem, state: Array, classes: Mapping[str, ClassLaw], push: WallDrift,
        negligible: float = TUNING.negligible,
    ) -> None:  # fmt: skip
        self.problem, self.state, self.classes, self.push = problem, state, classes, push
        d, self._negligible, self._laws = problem.dynamics, negligible, tuple(classes.values())
        self._known = np.array([law.log_psi for law in self._laws])
        self._free = self._controls(state, 0.0)  # (C, m) at the state of the plan, without wall drift
        self._before = self._free + push(state, 0.0)
        self._stiff = problem.control_cost(state) / problem.temperature
        self._inverse = np.linalg.pinv(d.G_c(state)) if d.input_form else np.linalg.inv(d.G_c(state))
        self._drift = d.f(state)[d.n - d.rows :]
        self._loses = d.drifting_away or bool(problem.scene.movers)  # whether log psi falls by waiting
        self._waiting = self._loss(self._free) if self._loses else np.zeros(len(self._free))

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        pull = self._pull(x, s)
        which = self._weighty(s, pull)
        if len(which) == 1:
            return np.asarray(self._controls(x, s, which)[0] + self.push(x, s))
        log_psi, controls = self._at(x, s, pull, which)
        weight: Array = np.exp(log_psi - log_psi.max())
        control: Array = weight @ controls / weight.sum()
        return control

    def weights(self, x: Array, s: float) -> dict[str, float]:
        """Return the weight of every class at state x (n,), s [s] after the plan."""
        weight, _ = normalised(self._at(x, s, self._pull(x, s))[0])
        return dict(zip(self.classes, weight.tolist(), strict=True))

    def log_psi(self, x: Array, s: float) -> dict[str, float]:
        """Return log psi of every class at state x (n,), s [s] after the plan [nats], up to a common constant."""
        return dict(zip(self.classes, self._at(x, s, self._pull(x, s))[0].tolist(), strict=True))

    def with_classes(self, classes: Mapping[str, ClassLaw]) -> ClassMixture | None:
        """Return the mixture of other classes; None without any."""
        if not classes:
            return None
        return ClassMixture(
            problem=self.problem, state=self.state, classes=classes, push=self.push, negligible=self._negligible
        )

    def _weighty(self, s: float, pull: Array) -> IntArray:
        """Return the classes (k,) of some weight, by their controls at the plan's state."""
        log_psi = self._known + self._before @ pull - s * self._waiting
        return np.flatnonzero(log_psi >= log_psi.max() - self._negligible)

    def _at(self, x: Array, s: float, pull: Array, which: IntArray | slice = EVERY) -> tuple[Array, Array]:
        """Return log psi (k,) and control (k, m) of some classes."""
        free = self._controls(x, s, which)
        controls = free + self.push(x, s)
        log_psi = self._known[which] + 0.5 * (self._before[which] + controls) @ pull
        if self._loses:
            log_psi -= s * self._loss(0.5 * (self._free[which] + free))
        return log_psi, controls

    def _loss(self, controls: Array) -> Array:
        """Return how fast log psi of classes with controls (k, m) falls by waiting, (k,) [nats/s]."""
        return np.asarray(0.5 * np.sum(controls @ self._stiff * controls, axis=1))

    def _pull(self, x: Array, s: float) -> Array:
        """Return the rise of log psi per control of a class by moving to x, less drift, (m,)."""
        d, carried = self.problem.dynamics, self.state.copy()
        carried[-d.rows :] += s * self._drift
        return np.asarray(self._stiff @ (self._inverse @ d.difference(x, carried)[-d.rows :]))

    def _controls(self, x: Array, s: float, which: IntArray | slice = EVERY) -> Array:
        """Return the controls (k, m) of some classes without wall drift."""
        laws = self._laws[which] if isinstance(which, slice) else [self._laws[k] for k in which.tolist()]
        return np.array([law.control(x, s) for law in laws])


def pooled(
    problem: Problem, before: ClassMixture | None, estimate: Estimate, leads: Mapping[str, ProposalControl | None],
    push: WallDrift, elapsed: float, tuning: ControlTuning = TUNING,
) -> ClassMixture:  # fmt: skip
    """Return the mixture of a plan's estimate and, carried along, that of the plan `elapsed` [s] before.

    Args:
        before: mixture of that plan; None: there is none.
        leads: what samples around each class followed, by name; None where that does not depend on the state.
        push: wall drift near the samples.
    """
    x, law_weight = estimate.rollouts.x0, estimate.rollouts.tables.law_weight
    laws = {} if before is None or tuning.memory <= 0.0 else _carried(before, x, leads, elapsed, law_weight, tuning)
    for name, weight in estimate.class_weights.items():
        if weight <= 0.0:
            continue
        lead, control, log_psi = leads.get(name), estimate.class_controls[name], estimate.log_psi + np.log(weight)
        old = laws.get(name)
        if name not in leads and old is not None:  # its guide, if it has one, is of an earlier plan
            new = replace(old, log_psi=float(log_psi), rest=control - old.guided(x, 0.0), unseen=0.0)
        else:
            rest = control if lead is None else control - law_weight * lead.held(x)
            new = ClassLaw(log_psi=float(log_psi), rest=rest, lead=lead, law_weight=law_weight)
        laws[name] = new if old is None else _joined(old, new, tuning.bound)
    top = max(law.log_psi for law in laws.values())
    laws = {name: law for name, law in laws.items() if law.log_psi > top - tuning.faded}
    return ClassMixture(problem=problem, state=x, classes=laws, push=push, negligible=tuning.negligible)


def controls_followed(batch: Batch, estimate: Estimate) -> dict[str, ProposalControl | None]:
    """Return what samples around each class followed, by name: of several feedback laws that of most weight."""
    rows = sorted(zip(batch.proposals, estimate.proposal_weights, strict=True), key=lambda row: row[1])
    followed: dict[str, ProposalControl | None] = {one.name: None for one, _ in rows if one.key is not None}
    return followed | {one.name: one.lead for one, _ in rows if one.key is not None and one.lead.follows}


def _carried(
    before: ClassMixture, x: Array, leads: Mapping[str, ProposalControl | None], elapsed: float, law_weight: float,
    tuning: ControlTuning,
) -> dict[str, ClassLaw]:  # fmt: skip
    """Return the laws of an earlier mixture at x (n,), less those whose gradient is no longer known."""
    laws: dict[str, ClassLaw] = {}
    log_psi = before.log_psi(x, elapsed)
    for name, old in before.classes.items():
        lead, unseen = leads.get(name), old.unseen + elapsed
        if unseen > tuning.stale:
            continue
        law = replace(old, log_psi=log_psi[name] - elapsed / tuning.memory, age=old.age + elapsed, unseen=unseen)
        if lead is not None:  # another reference than before must not change what is known
            rest = law.control(x, 0.0) - law_weight * lead(x, 0.0)
            law = replace(law, rest=rest, lead=lead, age=0.0, law_weight=law_weight)
        laws[name] = law
    return laws


def _joined(old: ClassLaw, new: ClassLaw, bound: float) -> ClassLaw:
    # A wrong gradient could make what is carried along grow without end; the new samples bound it.
    log_psi = float(np.logaddexp(min(old.log_psi, new.log_psi + bound), new.log_psi))
    share = float(np.exp(new.log_psi - log_psi))
    return replace(new, log_psi=log_psi, rest=(1.0 - share) * old.rest + share * new.rest)
