"""Decision of a controller at one state, and its feedback until the next: samples of each class estimate desirability.

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

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from pirrht import formatting
from pirrht.arrays import Array
from pirrht.control.settings import TUNING, ControlTuning
from pirrht.errors import OptionError
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import Replay
from pirrht.estimation.weights import normalised
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover
from pirrht.outcome import Outcome
from pirrht.planner.references import Reference
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch, ProposalControl
from pirrht.systems.dynamics import Dynamics
from pirrht.traits import Traits

Law = Callable[[Array, float], Array]  # control (m,) at a state (n,), a time since it was chosen [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Decision at one state, made by `Controller.plan`, `Mppi.plan` or `Optimal.plan`.

    Attributes:
        state: where it was made, (n,).
        times: ends of the control sequence's steps, from 0, (T+1,) [s].
        references: best known path of every class, cheapest first; empty for methods that have none.
        ids: class of each reference, relative to the start of the run.
        estimate: of psi, v and u by samples; None in a fallback, and for methods without samples.
        fallback: why the robot is blocked and brakes: "no reference" or "no survivor"; None if it is not.
        stops: whether the robot can; one that cannot takes the longest free path where it is blocked.
        replay: simulates samples again for the control sequence and for pictures.
        instead: controls of a fallback without noise, (T, m) [control].
        law: control (m,) [control] at a state (n,) and a time since the plan [s]; None: the control sequence is held.
        push: wall drift (m,) [control] of a held control, at a state (n,) and a time since the plan [s].
        shares: weight of every class under the law, from 0 to 1.
        followed: the one class that the control follows; None: all.
        classes: names of the references' classes by additive key.
        time: of the run, at which the plan starts [s].
        exact: v at the state [cost], where it is known without samples.
        space: the free space, for pictures.
        dynamics: the system, for pictures.
        movers: moving obstacles as predicted, on the run's clock.

    Examples:
        The control now is `plan.control` (m,), a little later it is `plan.at(x, s)`:

        >>> plan = controller.plan(x)  # doctest: +SKIP
        >>> plan  # doctest: +SKIP
        Plan(at (0.5, 2.5): control (0.94, -0.0617), v 10.93 +- 0.015, 3 classes, most weight 0,0 (66 %))
    """

    state: Array
    times: Array
    references: tuple[Reference, ...]
    ids: tuple[str, ...]
    estimate: Estimate | None
    fallback: str | None
    stops: bool = True
    replay: Replay | None = None
    instead: Array | None = None
    law: Law | None = None
    push: Law | None = None
    shares: dict[str, float] | None = None
    followed: str | None = None
    classes: Mapping[int, str] = field(default_factory=dict)
    time: float = 0.0
    exact: float | None = None
    space: FreeSpace | None = None
    dynamics: Dynamics | None = None
    movers: tuple[Mover, ...] = ()

    def __repr__(self) -> str:
        value = f"blocked, {self.fallback}" if self.fallback else f"v {self.exact or np.nan:.4g}"
        if self.estimate is not None:
            value = f"v {self.estimate.value:.4g} +- {self.estimate.value_error:.2g}"
        which = f"{len(self.ids)} classes" if len(self.ids) != 1 else "1 class"
        weight = self.weights().get(favourite := self.favourite or "")
        most = f", most weight {formatting.turns(favourite)} ({formatting.share(weight)})" if weight is not None else ""
        at = formatting.vector(self.state)
        control = formatting.vector(self.control)

        return f"Plan(at {at}: control {control}, {value}, {which}{most})"

    def weights(self) -> dict[str, float]:
        """Return the weight of every class under the law, else in the estimate; empty without either."""
        return {**({} if self.estimate is None else self.estimate.class_weights), **(self.shares or {})}

    def plot(self, *, samples: int = 60, axes: Any = None) -> Any:
        """Draw the state, the reference of every class, samples and where the control moves to on a map of the scene.

        Args:
            samples: number of the heaviest that arrived, and of those that died, in a lighter grey.
            axes: of matplotlib, which are returned; None: those of a new figure, which in space has a view from the
                south as well. OptionError: it is not installed.
        """
        from pirrht.plotting import maps
        from pirrht.plotting.colors import ClassColors
        from pirrht.plotting.tuning import TUNING as PLOTTING

        if self.space is None or self.dynamics is None:
            raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
        views = maps.of(self.space, self.time, axes, "plan.plot")
        drawn = [*self.heaviest(samples)]
        by = self.weights()
        colors = ClassColors(self.ids)
        shown = dict(zip(self.ids, self.references, strict=False))
        body = self.space.scene.body
        paths = [one.trajectory for one in shown.values()]
        labels = [f"{formatting.turns(id)}: {formatting.share(by[id]) if id in by else '-'}" for id in shown]
        hues = [colors[id] for id in shown]
        d, moved = self.dynamics, self.state
        for _ in range(PLOTTING.arrow_steps):
            moved = d.step(moved, self.control, np.zeros(d.m), PLOTTING.arrow / PLOTTING.arrow_steps)
        here, there = d.place(self.state), d.place(moved)
        for view, seen in views:
            pick = list(seen)
            maps.predicted(view, self.movers, self.time, seen=seen)
            for some, share in drawn:
                faded = PLOTTING.faint + (PLOTTING.strong - PLOTTING.faint) * share
                lines = [d.place(path)[:, pick] for path in some]
                maps.lines(view, lines, maps.SAMPLE, width=0.7, zorder=2, opacity=faded)
            maps.classes(view, body, paths, labels, hues, seen, title="class: weight")
            maps.robots(view, body, self.state[None, list(d.reads(True))], maps.INK)
            maps.position(view, here[pick], there[pick])
        axes = views[0][0]
        axes.set_title(f"{maps.literal(self.space.scene.name)} at {self.time:.2f} s", fontsize=10)
        return axes

    def heaviest(self, count: int) -> Iterator[tuple[list[Array], Array]]:
        """Yield states (k, n) of so many samples that died, then of the heaviest, each with shares of the most."""
        if self.estimate is None or self.replay is None or count < 1:
            return
        rollouts, weight = self.estimate.rollouts, self.estimate.weight
        arrived = np.flatnonzero(rollouts.paths.outcome == Outcome.GOAL)
        died = np.flatnonzero(rollouts.paths.outcome == Outcome.COLLISION)[:count]
        best = arrived[np.argsort(-weight[arrived], kind="stable")[:count]]
        share = weight[best] / max(float(weight[best].max(initial=0.0)), 1e-300)
        for chosen, strength in ((died, np.zeros(len(died))), (best, share)):
            if len(chosen):
                states, steps = self.replay.trace(rollouts, chosen)
                yield [path[: int(end) + 1] for path, end in zip(states, steps, strict=True)], strength

    @cached_property
    def tape(self) -> Array:
        """Open-loop controls, one per rollout step, (T, m) (paper, end of IV-C)."""
        if self.instead is not None:
            return self.instead
        assert self.estimate is not None
        assert self.replay is not None
        return self.replay.tape(self.estimate.parts)

    @property
    def control(self) -> Array:
        """The control now, (m,)."""
        if self.law is not None:
            return self.law(self.state, 0.0)
        return self.tape[0] if self.estimate is None else self.estimate.control

    def at(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan; a held one still has the wall drift at x."""
        if self.law is not None:
            return self.law(x, s)
        if s + 1e-9 < self.times[1]:
            return self.control + (0.0 if self.push is None else self.push(x, s) - self.push(self.state, 0.0))
        i = int(np.searchsorted(self.times, s + 1e-9, side="right")) - 1
        return self.tape[i] if i < len(self.tape) else np.zeros(self.tape.shape[1])

    @property
    def favourite(self) -> str | None:
        """Class of greatest weight, or that of the one reference that is followed."""
        if self.estimate is None:
            return self.ids[0] if self.ids else None
        weights = self.shares or self.estimate.class_weights
        return self.followed or max(weights, key=lambda name: weights[name], default=None)

    @property
    def decided(self) -> str | None:
        """The favourite, if it has at least `ControlTuning.decided` of the weight or is followed alone; else None."""
        favourite = self.favourite
        if self.estimate is None or self.followed is not None or favourite is None:
            return favourite
        return favourite if (self.shares or self.estimate.class_weights)[favourite] >= TUNING.decided else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClassLaw:
    """Desirability and control of one class near the state of a plan, without wall drift."""

    log_psi: float  # up to a constant that all classes share [nats]
    rest: Array  # (m,) what samples found on top of the proposal control
    lead: ProposalControl | None  # None: samples of no class have none
    age: float = 0.0  # time between the plan that the guide belongs to and this one [s]
    unseen: float = 0.0  # time since samples were last of this class [s]
    law_weight: float = 1.0  # linear-law weight: share of the guide that is followed, as `ProposalTables.law_weight`

    def control(self, x: Array, s: float) -> Array:
        """Return the control (m,) of this class at state x (n,), s [s] after the plan."""
        return self.rest + self.guided(x, s)

    def guided(self, x: Array, s: float) -> Array:
        """Return the share (m,) of the proposal control at state x (n,), s [s] after the plan."""
        return np.zeros(len(self.rest)) if self.lead is None else self.law_weight * self.lead(x, s + self.age)


class ClassMixture:
    """Control at any state near a plan's, u(x) = sum_c w_c(x) u_c(x), by laws of C classes and wall drift."""

    def __init__(self, *, problem: Problem, state: Array, classes: Mapping[str, ClassLaw], push: Law) -> None:
        self.problem = problem
        self.state = state
        self.classes = classes
        self.push = push

        d = problem.dynamics
        traits = Traits.of(problem)
        self._known = np.array([law.log_psi for law in classes.values()])
        self._free = self._controls(state, 0.0)  # at the state of the plan
        self._before = self._free + push(state, 0.0)
        self._stiff = problem.control_cost(state) / problem.temperature
        self._inverse = np.linalg.pinv(d.G_c(state)) if traits.input_form else np.linalg.inv(d.G_c(state))
        self._drift = d.f(state)[d.n - d.rows :]
        self._loses = traits.drifting_away or bool(problem.scene.movers)  # whether log psi falls by waiting

    def __call__(self, x: Array, s: float) -> Array:
        """Return the control (m,) at state x (n,), s [s] after the plan."""
        log_psi, controls = self._at(x, s)
        return np.asarray(normalised(log_psi)[0] @ controls)

    def weights(self, x: Array, s: float) -> dict[str, float]:
        """Return the weight of every class at state x (n,), s [s] after the plan."""
        return dict(zip(self.classes, normalised(self._at(x, s)[0])[0].tolist(), strict=True))

    def log_psi(self, x: Array, s: float) -> dict[str, float]:
        """Return log psi of every class there [nats], up to a common constant."""
        return dict(zip(self.classes, self._at(x, s)[0].tolist(), strict=True))

    def _at(self, x: Array, s: float) -> tuple[Array, Array]:
        """Return log psi (C,) and control (C, m) of the classes."""
        d = self.problem.dynamics
        carried = self.state.copy()
        free = self._controls(x, s)

        carried[-d.rows :] += s * self._drift
        controls = free + self.push(x, s)
        # The rise of log psi per control of a class by moving to x, less drift, (m,).
        log_psi = self._known + 0.5 * (self._before + controls) @ (
            self._stiff @ (self._inverse @ d.difference(x, carried)[-d.rows :])
        )
        if self._loses:
            usual = 0.5 * (self._free + free)
            log_psi -= 0.5 * s * np.sum(usual @ self._stiff * usual, axis=1)
        return log_psi, controls

    def _controls(self, x: Array, s: float) -> Array:
        """Return the controls (C, m) of the classes without wall drift."""
        return np.array([law.control(x, s) for law in self.classes.values()])


def pooled(
    problem: Problem, before: ClassMixture | None, estimate: Estimate, leads: Mapping[str, ProposalControl | None],
    push: Law, elapsed: float, tuning: ControlTuning = TUNING,
) -> ClassMixture:  # fmt: skip
    """Return the mixture of a plan's estimate, by what its samples followed, and of that `elapsed` [s] `before`."""
    x, law_weight = estimate.rollouts.origin.x, estimate.rollouts.tables.law_weight
    laws = {} if before is None or tuning.memory <= 0.0 else _carried(before, x, leads, elapsed, law_weight, tuning)
    for name, weight in estimate.class_weights.items():
        if weight <= 0.0:
            continue

        lead = leads.get(name)
        control = estimate.class_controls[name]
        log_psi = estimate.log_psi + np.log(weight)

        old = laws.get(name)
        if name not in leads and old is not None:  # its guide, if it has one, is of an earlier plan
            new = replace(old, log_psi=float(log_psi), rest=control - old.guided(x, 0.0), unseen=0.0)
        else:
            new = ClassLaw(
                log_psi=float(log_psi), rest=control if lead is None else control - law_weight * lead.held(x),
                lead=lead, law_weight=law_weight,
            )  # fmt: skip
        laws[name] = new if old is None else _joined(old, new, tuning.bound)
    top = max(law.log_psi for law in laws.values())
    laws = {name: law for name, law in laws.items() if law.log_psi > top - tuning.faded}
    return ClassMixture(problem=problem, state=x, classes=laws, push=push)


def controls_followed(batch: Batch, estimate: Estimate) -> dict[str, ProposalControl | None]:
    """Return the controls that samples of each class followed, by name; of several laws the one of most weight."""
    pairs = sorted(zip(estimate.proposal_weights, batch.proposals, strict=True), key=lambda pair: pair[0])
    rows = [one for _, one in pairs if one.key is not None]
    return {one.name: None for one in rows} | {one.name: one.lead for one in rows if one.lead.follows}


def _carried(
    before: ClassMixture, x: Array, leads: Mapping[str, ProposalControl | None], elapsed: float, law_weight: float,
    tuning: ControlTuning,
) -> dict[str, ClassLaw]:  # fmt: skip
    """Return the laws of an earlier mixture at x (n,), less those whose gradient is no longer known."""
    laws = dict[str, ClassLaw]()
    log_psi = before.log_psi(x, elapsed)

    for name, old in before.classes.items():
        lead = leads.get(name)
        unseen = old.unseen + elapsed

        if unseen > tuning.stale:
            continue
        law = replace(old, log_psi=log_psi[name] - elapsed / tuning.memory, age=old.age + elapsed, unseen=unseen)
        if lead is not None:  # another reference than before must not change what is known
            law = replace(
                law, rest=law.control(x, 0.0) - law_weight * lead(x, 0.0), lead=lead, age=0.0, law_weight=law_weight
            )
        laws[name] = law
    return laws


def _joined(old: ClassLaw, new: ClassLaw, bound: float) -> ClassLaw:
    # A wrong gradient could make what is carried along grow without end; the new samples bound it.
    log_psi = float(np.logaddexp(min(old.log_psi, new.log_psi + bound), new.log_psi))
    share = float(np.exp(new.log_psi - log_psi))
    return replace(new, log_psi=log_psi, rest=(1.0 - share) * old.rest + share * new.rest)
