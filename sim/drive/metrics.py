"""Book of a run: its frames, period by period, and its figures.

The path of dx = u dt + b dw is infinitely long: the finer its steps, the longer it gets. It is therefore measured by
chords over a time tau of driving, and from the square of each chord (over t seconds) goes what noise alone adds to it
across its direction, b^2 t. Noise and control at its natural speed sqrt(2 q / R) carry equally far in lambda / (2 q)
seconds; tau is CHORD times lambda / q. So tau does not depend on physics step or control period, tau -> 0 and the
length becomes that of the path as b -> 0, and where noise does not act on the position (cars) nothing is smoothed.
Noise along the path alone (a rover's) adds nothing to a chord on average: only its own to and fro is smoothed away.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import dist, inf, sqrt
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.control.run_state import RunState
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.risk import CollisionProbability
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.mapping.believed import Believed
from pirrht.mapping.scan import Scan
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.topology.driven import Driven
from pirrht.topology.signature import OTHER, class_id
from pirrht.traits import Traits
from sim.drawing.colors import title
from sim.drive.executor import Advance, ClearanceChecker
from sim.drive.result import FIGURES
from sim.states import adapter_of

CHORD = 2.5  # times lambda / q: 0.05 s at the point's b = 0.1, 0.45 s at 0.3
GRACE = 1e-9  # by which sums of periods may miss the time [s]
STRETCH = 1.0  # weak plans that are less apart than this are reported once [s]

REASONS = {"no reference": "no path was found", "no survivor": "no sample survived"}  # of `Plan.fallback`, in words

Risk = Callable[[Plan], CollisionProbability | None]


class Length:
    """The length of a path that goes on, from its start at a position [m]."""

    def __init__(self, place: Array) -> None:
        self._first = self._begun = place.tolist()  # of the path, and of the chord
        self._problem: Problem | None = None  # whose noise the last states had
        self._steps, self._chords = 0, 0.0  # of the chord that has begun, and length of complete ones [m]
        self.noisy = self.total = 0.0  # with its noise, and without: between the distance of its ends and that [m]

    def add(self, problem: Problem, states: Array, step: float, noisy: float) -> None:
        """Go on through states (k, n) of a problem, `step` seconds apart, over a path of `noisy` metres."""
        self.noisy += noisy
        if problem is not self._problem:
            self._problem, self._spread = problem, spread(problem, states[0])
        each, chord = max(1, round(CHORD * problem.temperature / problem.least_rate / step)), 0.0
        for place in states[:, adapter_of(problem.dynamics.states).position].tolist():
            self._steps += 1
            chord = sqrt(max(0.0, dist(self._begun, place) ** 2 - self._spread * self._steps * step))
            if self._steps >= each:
                self._chords = self._chords + chord
                self._begun = place
                self._steps = 0
                chord = 0.0
        smooth = max(self._chords + chord, dist(self._first, place))
        self.total = min(self.noisy, smooth) if Traits.of(problem).noisy_position else self.noisy


def spread(problem: Problem, x: Array) -> float:
    """Variance per second that noise adds to each coordinate of the position at x (n,) [m^2/s].

    In input form that in the direction in which it adds least, since robots drive in the other.
    """
    traits = Traits.of(problem)
    if not traits.noisy_position:
        return 0.0
    B = problem.dynamics.position_noise(x)
    return max(0.0, float(np.linalg.eigvalsh(B @ B.T)[0])) if traits.input_form else float(np.sum(B**2)) / 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truth:
    """Exact solution at one state."""

    value: float  # v
    control: Array  # u*, (m,)
    shares: Mapping[str, float] = field(default_factory=dict)  # of psi by class, if they were drawn
    samples: int = 0  # paths by which

    @property
    def share_errors(self) -> dict[str, float]:
        """Standard errors of the shares."""
        n = max(self.samples, 1)
        return {name: sqrt(max(share * (1.0 - share), 1.0 / n) / n) for name, share in self.shares.items()}

    @classmethod
    def at(cls, grid: Desirability, x: Array, time: float = 0.0) -> Truth:
        """Return value and control at state x (n,), and a time [s] that counts among moving obstacles."""
        return cls(value=float(grid.value(x, time)), control=grid.control(x, time))

    def errors(self, e: Estimate) -> tuple[float, float]:
        """Subtract the exact value, and compute |u - u*|, for an estimate."""
        return e.value - self.value, float(np.linalg.norm(e.control - self.control))


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedPlan:
    """A plan, and when it was made."""

    plan: Plan
    plan_seconds: float  # wall time the plan took [s]
    vertices: int = 0  # of the tree that it was made with
    run: RunState | None = None  # of the policy: another one names classes anew
    path_integral: PathIntegral | None = None  # what drew its samples; among other obstacles another one does
    believed: Believed | None = None  # what the robot knew; None: the scene
    begin: float = 0.0  # time of the run for which it was made [s]; runs by a clock alone
    slack: float = 0.0  # from the end of planning to `begin` [s], negative if it is late; by a clock alone

    @classmethod
    def of(cls, policy: Policy, x: Array, left: Callable[[], float] | None = None) -> TimedPlan:
        """Let a policy plan at x (n,), in the time that is `left` [s]."""
        began = time.perf_counter()
        plan = policy.plan(x, left)
        seconds, tree = time.perf_counter() - began, policy.tree
        return cls(
            plan=plan, plan_seconds=seconds, vertices=0 if tree is None else tree.size, run=policy.run,
            path_integral=policy.path_integral, believed=policy.believed,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame(TimedPlan):
    """One control period: where the robot was, what was planned there and what came of it."""

    advance: Advance
    step: int  # number of the period, from 0
    time: float  # simulated time at its start [s]
    outcome: Outcome | None  # how the run ended in this period, TIMEOUT included; None while it goes on
    cost: float  # integral of q + u'Ru/2 up to the end of this period
    length: float  # driven up to there, without the path's noise [m]
    noisy_length: float  # with it: grows with the number of physics steps [m]
    clearance: float  # around the robot at the start of the period, from static and moving obstacles [m]
    driven_class: tuple[int, ...]  # class of the path up to the end of the period, completed straight to the goal
    truth: Truth | None  # exact solution where the plan was made, if a grid was solved
    news: str | None  # a line for a person, if something happened
    metrics: EpisodeMetrics  # of the whole run so far, which goes on

    def __repr__(self) -> str:
        end = "" if self.outcome is None else f", {self.outcome.name.lower()}"
        return f"Frame(step {self.step}, {self.time:.4g} to {self.end_time:.4g} s, cost {self.cost:.4g}{end})"

    @property
    def end_time(self) -> float:
        """Simulated time at the end of the period [s]."""
        return self.time + self.advance.time

    @cached_property
    def collision(self) -> CollisionProbability | None:
        """Predicted probability of a collision from its start on, if one is predicted."""
        return self.metrics.risk(self.plan)

    @property
    def state(self) -> Array:
        """State at the end of the period, (n,)."""
        return np.asarray(self.advance.states[-1])


class EpisodeMetrics:
    """Figures of a run from x (n,) so far, in SI units: those of the JSON of `run`; `FIGURES` describes them.

    The task is a policy or scenario, with `problem`, `space` and `homology`; the grid is the exact solution, and `risk`
    predicts the probability of a collision from a plan on.
    """

    def __init__(
        self, task: Any, x: Array, *, period: float, max_time: float, grid: Desirability | None = None
    ) -> None:  # fmt: skip
        self._task = task
        self._period = period
        self._max_time = max_time
        self._grid = grid

        self.risk: Risk = lambda _: None

        self.outcome = "timeout"
        self.time = 0.0
        self.cost = 0.0
        self.steps = 0
        self.vertices = 0

        self.path_length = self.noisy_path_length = self.blocked_time = 0.0
        self._doubted = -inf  # time of the last weak plan [s]
        self.value_estimate = self.least_ess = self.least_ess_time = None  # type: float | None
        self.executed_class = self.favourite = self._decided = None  # type: str | None
        self.class_switches = self.class_reversals = self.doubtful_plans = 0
        self.reasons = Counter[str]()  # of fallbacks
        self.deadline_misses = 0  # plans that took longer than the period, by a clock those that were late
        self.blocked: list[tuple[float, float]] = []  # from when to when the robot was [s]
        self.last: Frame | None = None
        self.first_plan: Plan | None = None
        self.plan_seconds: list[float] = []  # wall time of each [s]
        self.map_seconds: list[float] = []  # of it for new maps, of plans that had one [s]
        self._scan: Scan | None = None  # the last one
        self._late: list[Array] = []  # how late physics steps began [s]
        self._ready: list[tuple[int, float]] = []  # samples and slack [s] of plans that were ready in time
        self._off: list[Array] = []  # states less those of the equation alone, after periods
        self._truths: list[tuple[float, float]] = []  # exact values, and |u - u*|
        self._adapter = adapter_of(task.problem.dynamics.states)
        self._length = Length(x[self._adapter.position])
        self._driven = Driven(task.homology, x)
        self._space, self._checker = task.space, ClearanceChecker(task.space.scene, self._adapter)
        self.min_clearance = self._checker.least(x[None], np.zeros(1))

    def frame(self, made: TimedPlan, advance: Advance, late: Array | None = None) -> Frame:
        """Take the next period into account; by a clock, how late each physics step began, (k,) [s]."""
        plan = made.plan
        begin = self.time
        task = self._task
        seen = plan.space is not None and plan.space.grain is not None  # a map, of which the plant knows more
        self._enter(made, begin, seen)
        clearance = advance.clearance if seen else self._checker.least(plan.state[None], np.array([begin]))

        self._off.extend(advance.off)
        self.time = begin + advance.time
        self.cost = self.cost + advance.cost
        self.vertices = made.vertices

        self._length.add(task.problem, advance.states, advance.time / len(advance.states), advance.length)
        self._driven.observe(advance.states, self.time)
        self.path_length, self.noisy_path_length = self._length.total, self._length.noisy
        self.min_clearance = min(self.min_clearance, clearance, advance.clearance)
        outcome = ending(advance, begin, self._max_time)
        driven = self._driven.winding()
        news = self._count(plan, begin)
        self._time(made, begin, late)
        if outcome is not None:
            self.outcome = outcome.name.lower()
            news.append(f"{self.outcome} at {self.time:.2f} s")
        if outcome is Outcome.GOAL:
            self.executed_class = class_id(driven, None if plan.space is None else plan.space.homology.named)
        truth = None if self._grid is None else Truth.at(self._grid, plan.state, plan.time)
        if truth is not None:
            self._truths.append((truth.value, float(np.linalg.norm(plan.control - truth.control))))
        self.last = Frame(
            **vars(made), advance=advance, step=self.steps, time=begin, outcome=outcome, cost=self.cost,
            length=self.path_length, noisy_length=self.noisy_path_length, clearance=clearance, driven_class=driven,
            truth=truth, news="; ".join(news) or None, metrics=self,
        )  # fmt: skip
        self.steps += 1
        return self.last

    def _enter(self, made: TimedPlan, begin: float, seen: bool) -> None:
        """Continue among the obstacles of a plan, if they are others than before."""
        plan = made.plan
        if plan.space is None or plan.space is self._space:
            return
        if self.last is not None and made.run is self.last.run:  # among other obstacles, to the same goal
            self._driven.enter(plan.space.homology)
        else:
            self._driven = Driven(self._task.homology, plan.state, begin)
        self._space = plan.space
        self._checker = self._checker if seen else ClearanceChecker(plan.space.scene, self._adapter)

    def _time(self, made: TimedPlan, begin: float, late: Array | None) -> None:
        """Note how long a plan and its map took, and by a clock how late it and its physics steps (k,) were [s]."""
        missed = made.plan_seconds > self._period
        if late is not None:
            self._late.append(late)
            missed = made.begin < begin - GRACE
            if not missed and self.last is not None:
                parts = () if made.plan.estimate is None else made.plan.estimate.parts
                self._ready.append((sum(part.size for part in parts), made.slack))
        self.plan_seconds.append(made.plan_seconds)
        if (known := made.believed) is not None and known.scan is not self._scan:
            self._scan = known.scan
            self.map_seconds.append(known.seconds)
        self.deadline_misses += missed

    def _count(self, plan: Plan, begin: float) -> list[str]:
        """Count a plan of a time [s]; return lines for a person on what is new."""
        estimate = plan.estimate
        if self.last is None:
            self.first_plan = plan
            self.value_estimate = plan.exact if estimate is None else estimate.value
        news = self._count_blocked(plan, begin)
        if estimate is not None:
            news += self._count_doubtful(estimate, begin)
        if plan.fallback is None:
            news += self._count_class(plan, begin)
        return news

    def _count_blocked(self, plan: Plan, begin: float) -> list[str]:
        """Add a period to the time that the robot is blocked, or end this."""
        was_blocked = self.last is not None and self.last.plan.fallback is not None
        if plan.fallback is None:
            since = f"going on at {begin:.2f} s, after {begin - self.blocked[-1][0]:.2f} s" if was_blocked else ""
            return [since] if since else []
        if not was_blocked:
            self.blocked.append((begin, begin))
        self.blocked[-1] = self.blocked[-1][0], self.time
        self.blocked_time = sum(end - start for start, end in self.blocked)
        self.reasons[plan.fallback] += 1
        return [] if was_blocked else [f"blocked at {begin:.2f} s: {why_blocked(plan)}"]

    def _count_doubtful(self, estimate: Estimate, begin: float) -> list[str]:
        """Note the least effective samples, and plans that have too few of them."""
        if self.least_ess is None or estimate.ess < self.least_ess:
            self.least_ess, self.least_ess_time = estimate.ess, begin
        if not estimate.doubtful:
            return []
        again = begin - self._doubted < STRETCH
        self._doubted = begin
        self.doubtful_plans += 1
        return [] if again else [f"{estimate.ess:.1f} effective samples at {begin:.2f} s: the control is a guess"]

    def _count_class(self, plan: Plan, begin: float) -> list[str]:
        """Count changes of the class of greatest weight, and decisions that are reversed."""
        before, self.favourite = self.favourite, plan.favourite
        if plan.decided is not None:
            self.class_reversals += self._decided not in (None, plan.decided)
            self._decided = plan.decided
        if before in (None, self.favourite):
            return []
        self.class_switches += 1
        return [f"class {title(before or OTHER)} -> {title(self.favourite or OTHER)} at {begin:.2f} s"]

    @property
    def fallbacks(self) -> int:
        """Number of plans without a reference or a surviving sample."""
        return self.reasons.total()

    @property
    def step_ms(self) -> dict[str, Any]:
        """Wall time of a plan [ms]."""
        return _percentiles(1e3 * np.array(self.plan_seconds), median=50, p95=95, max=100)

    @property
    def map_ms(self) -> dict[str, Any] | None:
        """Wall time that new scans and their map took before a plan [ms]; None of a scene that is known."""
        return _percentiles(1e3 * np.array(self.map_seconds), median=50, p99=99, max=100) if self.map_seconds else None

    @property
    def real_time(self) -> dict[str, Any] | None:
        """How a run by a clock kept its times; None without one."""
        if not self._late:
            return None
        return {
            "period": self._period,
            "periods": self.steps,
            "deadline_misses": self.deadline_misses,
            "samples_per_period": _percentiles([samples for samples, _ in self._ready], median=50, min=0),
            "slack_ms": _percentiles([1e3 * slack for _, slack in self._ready], median=50, min=0),
            "late_ms": _percentiles(1e3 * np.concatenate(self._late), median=50, p99=99, max=100),
        }

    @property
    def plant_mismatch(self) -> dict[str, float] | None:
        """By how much a state is off the equation after a period, root mean square; None where it is exact."""
        if not self._off:
            return None
        return dict(zip(self._adapter.states, np.sqrt(np.mean(np.square(self._off), axis=0)).tolist(), strict=True))

    @property
    def truth(self) -> dict[str, float] | None:
        """The exact value at the start, and |u - u*| over the control steps; None without a grid."""
        if not self._truths:
            return None
        (value, *_), errors = zip(*self._truths, strict=True)
        return {"value": value, "mean_control_error": float(np.mean(errors)), "max_control_error": max(errors)}

    def json(self) -> dict[str, Any]:
        """Return the figures of a run of at least one frame under the names of the public JSON."""
        names = (*(f.name for f in FIGURES), "step_ms", "deadline_misses", "blocked")
        more = {name: getattr(self, name) for name in ("map_ms", "plant_mismatch", "real_time", "truth")}
        return {name: getattr(self, name) for name in names} | {k: v for k, v in more.items() if v is not None}


def _percentiles(values: Sequence[float] | Array, **shares: float) -> dict[str, float | None]:
    found = np.percentile(values, [*shares.values()]).tolist() if len(values) else [None] * len(shares)
    return dict(zip(shares, found, strict=True))


def why_blocked(plan: Plan) -> str:
    """Report why there is a fallback, and what the robot does."""
    does = "braking" if plan.stops else "this robot cannot stop and takes the path that stays free longest"
    if plan.law is None:
        does = "the last controls go on"
    return f"{REASONS[plan.fallback or 'no reference']}; {does}"


def ending(advance: Advance, begun: float, max_time: float) -> Outcome | None:
    """Judge a period that began at `begun` [s]: TIMEOUT from `max_time` [s] on; None while the run goes on."""
    late = advance.outcome is None and begun + advance.time >= max_time - GRACE
    return Outcome.TIMEOUT if late else advance.outcome
