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
from dataclasses import dataclass, field, replace

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.control.proposals import kept
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.weights import normalised
from pirrht.problem import Problem
from pirrht.proposals.proposal import ProposalControl

MEMORY = 0.03  # samples of earlier plans fade with this time constant [s]; near walls u_c changes as fast
STALE = 0.05  # classes without samples for so long are forgotten [s]
BOUND = 2.0  # earlier plans count at most exp(BOUND) times as much as the last one
NEGLIGIBLE = 25.0  # classes that a linear model leaves so many nats behind add nothing to a control
FADED = -60.0  # classes whose desirability is below the largest by so many nats are forgotten

EVERY = slice(None)
WallDrift = Callable[[Array, float], Array]  # wall drift (m,) at a state (n,), s [s] after the plan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClassLaw:
    """Desirability and control of one class near the state of a plan."""

    log_psi: float  # up to a constant that all classes share [nats]
    rest: Array  # (m,) what samples found on top of the guide's share
    lead: ProposalControl | None  # None: samples of no class have none
    age: float = 0.0  # time between the plan that the guide belongs to and this one [s]
    unseen: float = 0.0  # time since samples were last of this class [s]
    trust: float = 1.0  # share of the guide that is followed, as `ProposalTables.trust`

    def control(self, x: Array, s: float) -> Array:
        """Return the control (m,) of this class at state x (n,), s [s] after the plan, without wall drift."""
        return self.rest + self.led(x, s)

    def led(self, x: Array, s: float) -> Array:
        """Return the lead's share of the control (m,) at state x (n,), s [s] after the plan."""
        return np.zeros(len(self.rest)) if self.lead is None else self.trust * self.lead(x, s + self.age)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClassMixture:
    """Control at any state near the plan's."""

    problem: Problem
    state: Array  # (n,) of the plan
    classes: Mapping[str, ClassLaw]
    push: WallDrift
    laws: tuple[ClassLaw, ...] = field(init=False, repr=False)  # (C,) of all classes; below: at the plan's state
    known: Array = field(init=False, repr=False)  # (C,) log psi of every class [nats]
    before: Array = field(init=False, repr=False)  # (C, m) controls
    free: Array = field(init=False, repr=False)  # (C, m) controls without wall drift
    stiff: Array = field(init=False, repr=False)  # R / lambda, (m, m)
    inverse: Array = field(init=False, repr=False)  # G_c^-1 or G^+, (m, rows)
    waiting: Array = field(init=False, repr=False)  # (C,) loss of log psi by waiting [nats/s]
    drift: Array = field(init=False, repr=False)  # f of the states that G has rows for, (rows,)

    def __post_init__(self) -> None:
        d, x = self.problem.dynamics, self.state
        object.__setattr__(self, "laws", tuple(self.classes.values()))
        free = self._free(x, 0.0)
        here = {
            "known": np.array([law.log_psi for law in self.laws]),
            "before": free + self.push(x, 0.0),
            "free": free,
            "stiff": self.problem.control_cost(x) / self.problem.temperature,
            "inverse": np.linalg.pinv(d.G_c(x)) if d.input_form else np.linalg.inv(d.G_c(x)),
            "drift": d.f(x)[d.n - d.rows :],
        }
        for name, value in here.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "waiting", self._loss(free) if self._loses else np.zeros(len(free)))

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        pull = self._pull(x, s)
        which = self._weighty(s, pull)
        if len(which) == 1:
            return np.asarray(self._free(x, s, which)[0] + self.push(x, s))
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

    def _weighty(self, s: float, pull: Array) -> IntArray:
        """Return the classes (k,) of some weight, by their controls at the plan's state."""
        log_psi = self.known + self.before @ pull - s * self.waiting
        return np.flatnonzero(log_psi >= log_psi.max() - NEGLIGIBLE)

    def _at(self, x: Array, s: float, pull: Array, which: IntArray | slice = EVERY) -> tuple[Array, Array]:
        """Return log psi (k,) and control (k, m) of some classes."""
        free = self._free(x, s, which)
        controls = free + self.push(x, s)
        log_psi = self.known[which] + 0.5 * (self.before[which] + controls) @ pull
        if self._loses:
            log_psi -= s * self._loss(0.5 * (self.free[which] + free))
        return log_psi, controls

    @property
    def _loses(self) -> bool:
        """Check whether log psi falls by waiting."""
        return self.problem.dynamics.drifting_away or bool(self.problem.scene.movers)

    def _loss(self, controls: Array) -> Array:
        """Return how fast log psi of classes with controls (k, m) falls by waiting, (k,) [nats/s]."""
        return np.asarray(0.5 * np.sum(controls @ self.stiff * controls, axis=1))

    def _pull(self, x: Array, s: float) -> Array:
        """Return the rise of log psi per control of a class by moving to x, less drift, (m,)."""
        d, carried = self.problem.dynamics, self.state.copy()
        carried[-d.rows :] += s * self.drift
        return np.asarray(self.stiff @ (self.inverse @ d.difference(x, carried)[-d.rows :]))

    def _free(self, x: Array, s: float, which: IntArray | slice = EVERY) -> Array:
        """Return the controls (k, m) of some classes without wall drift."""
        laws = self.laws[which] if isinstance(which, slice) else [self.laws[k] for k in which.tolist()]
        return np.array([law.control(x, s) for law in laws])


@dataclass(slots=True)
class ClassPool:
    """Pools the plans of a drive by class."""

    problem: Problem
    fade: float = MEMORY  # [s]; 0: only the last plan counts
    _last: ClassMixture | None = field(default=None)

    def forget(self) -> None:
        """Start anew."""
        self._last = None

    def inherit(self, before: ClassPool, names: Mapping[str, str]) -> None:
        """Take over earlier classes under their present `names`."""
        laws = {} if before._last is None else kept(before._last.classes, names)
        self._last = replace(before._last, classes=laws) if before._last is not None and laws else None

    def law(
        self, estimate: Estimate, leads: Mapping[str, ProposalControl | None], push: WallDrift, elapsed: float
    ) -> ClassMixture:
        """Pool one more plan, made `elapsed` [s] after the last one.

        Args:
            leads: what samples around each class followed, by name; None where that does not depend on the state.
        """
        x, trust = estimate.rollouts.x0, estimate.rollouts.leads.trust
        found: dict[str, ClassLaw] = {}
        if self._last is not None and self.fade > 0.0:
            kept = self._last.log_psi(x, elapsed)
            for name, old in self._last.classes.items():
                fresh = leads.get(name)
                age, unseen = old.age + elapsed, old.unseen + elapsed
                if unseen > STALE:  # its gradient is no longer known
                    continue
                carried = replace(old, log_psi=kept[name] - elapsed / self.fade, age=age, unseen=unseen)
                if fresh is not None:  # another reference than before must not change what is known
                    rest = carried.control(x, 0.0) - trust * fresh(x, 0.0)
                    carried = replace(carried, rest=rest, lead=fresh, age=0.0, trust=trust)
                found[name] = carried
        for name, weight in estimate.class_weights.items():
            if weight <= 0.0:
                continue
            lead, control, log_psi = leads.get(name), estimate.class_controls[name], estimate.log_psi + np.log(weight)
            before = found.get(name)
            if name not in leads and before is not None:  # its guide, if it has one, is of an earlier plan
                new = replace(before, log_psi=float(log_psi), rest=control - before.led(x, 0.0), unseen=0.0)
            else:
                rest = control if lead is None else control - trust * lead.held(x)
                new = ClassLaw(log_psi=float(log_psi), rest=rest, lead=lead, trust=trust)
            found[name] = new if before is None else _pooled(before, new)
        top = max(c.log_psi for c in found.values())
        found = {name: c for name, c in found.items() if c.log_psi > top + FADED}
        self._last = ClassMixture(problem=self.problem, state=x, classes=found, push=push)
        return self._last


def _pooled(old: ClassLaw, new: ClassLaw) -> ClassLaw:
    # A wrong gradient could make what is carried along grow without end; the new samples bound it.
    log_psi = float(np.logaddexp(min(old.log_psi, new.log_psi + BOUND), new.log_psi))
    share = float(np.exp(new.log_psi - log_psi))
    return replace(new, log_psi=log_psi, rest=(1.0 - share) * old.rest + share * new.rest)
