"""The one bookkeeper of a run: its frames, period by period, and its figures.

The path of dx = u dt + b dw is infinitely long: the finer its steps, the longer it gets. It is therefore measured by
chords over a time tau of driving, and from the square of each chord (over t seconds) goes what noise alone adds to it
across its direction, b^2 t. Noise and control at its natural speed sqrt(2 q / R) carry equally far in lambda / (2 q)
seconds; tau is CHORD times lambda / q. So tau does not depend on physics step or control period, tau -> 0 and the
length becomes that of the path as b -> 0, and where noise does not act on the position (cars) nothing is smoothed.
Noise along the path alone (a rover's) adds nothing to a chord on average: only its own to and fro is smoothed away.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist, sqrt
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import RunState
from pirrht.estimation.estimate import OTHER
from pirrht.freespace import FreeSpace
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.topology.homology import Driven
from pirrht.topology.signature import class_id
from sim.drawing.colors import title
from sim.drive.clock import Timing, figures
from sim.drive.plant import Advance, ClearanceChecker
from sim.drive.result import DriveResult

CHORD = 2.5  # times lambda / q: 0.05 s at the point's b = 0.1, 0.45 s at 0.3
GRACE = 1e-9  # by which sums of periods may miss the time [s]
STRETCH = 1.0  # weak plans that are less apart than this are reported once [s]


class Length:
    """The length of a path that goes on, from its start at x (n,)."""

    def __init__(self, problem: Problem, x: Array) -> None:
        self._spread, self._smooth = spread(problem, x), not problem.dynamics.noisy_position
        self._time = CHORD * problem.temperature / problem.least_rate
        self._first = self._last = self._begun = (float(x[0]), float(x[1]))  # of the path, so far, of the chord
        self._steps, self._step = 0, 0.0  # of the chord, and their length [s]
        self._chords = 0.0  # complete ones [m]
        self.noisy = 0.0  # length of the path with all its noise [m]

    def add(self, states: Array, step: float, noisy: float) -> None:
        """Go on through states (k, n), `step` seconds apart, over a path of `noisy` metres."""
        self.noisy += noisy
        if not len(states):
            return
        places = [(float(x), float(y)) for x, y in states[:, :2]]
        self._last, self._step = places[-1], step
        each, first = max(1, round(self._time / step)), self._steps
        for end in range(each - first, len(places) + 1, each):
            self._chords += self._chord(places[end - 1], each)
            self._begun = places[end - 1]
        self._steps = (first + len(places)) % each

    @property
    def total(self) -> float:
        """Length of the path without its noise [m]; at least the distance of its ends, at most the noisy length."""
        if self._smooth:
            return self.noisy
        total = self._chords + self._chord(self._last, self._steps)
        return min(self.noisy, max(total, dist(self._first, self._last)))

    def _chord(self, end: tuple[float, float], steps: int) -> float:
        return sqrt(max(0.0, dist(self._begun, end) ** 2 - self._spread * steps * self._step))


def spread(problem: Problem, x: Array) -> float:
    """Variance per second that noise adds to each coordinate of the position at x (n,) [m^2/s].

    In input form that in the direction in which it adds least, since robots drive in the other.
    """
    dynamics = problem.dynamics
    if not dynamics.noisy_position:
        return 0.0
    B = np.asarray(dynamics.B_c(x))[: 2 - dynamics.n + dynamics.rows]
    return max(0.0, float(np.linalg.eigvalsh(B @ B.T)[0])) if dynamics.input_form else float(np.sum(B**2)) / 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Period:
    """One control period as plant and planner know it."""

    plan: Plan
    advance: Advance
    plan_seconds: float  # wall time the plan took [s]
    vertices: int = 0  # of the tree that the plan was made with
    run: RunState | None = None  # of the policy: another one names classes anew
    timing: Timing | None = None  # of real-time runs only


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame(Period):
    """One control period: where the robot was, what was planned there and what came of it."""

    step: int  # number of the period, from 0
    time: float  # simulated time at its start [s]
    outcome: Outcome | None  # how the run ended in this period, TIMEOUT included; None while it goes on
    cost: float  # integral of q + u'Ru/2 up to the end of this period
    length: float  # driven up to there, without the path's noise [m]
    noisy_length: float  # with it: grows with the number of physics steps [m]
    clearance: float  # at the start of the period, from static and moving obstacles [m]
    driven_class: tuple[int, ...]  # class of the path up to the end of the period, completed straight to the goal
    news: str | None  # a line for a person, if something happened
    metrics: EpisodeMetrics  # of the whole run so far, which goes on

    def __repr__(self) -> str:
        end = "" if self.outcome is None else f", {self.outcome.name.lower()}"
        return f"Frame(step {self.step}, {self.time:.4g} to {self.end_time:.4g} s, cost {self.cost:.4g}{end})"

    @property
    def end_time(self) -> float:
        """Simulated time at the end of the period [s]."""
        return self.time + self.advance.time

    @property
    def state(self) -> Array:
        """State at the end of the period, (n,)."""
        return self.advance.states[-1] if len(self.advance.states) else self.plan.state


class EpisodeMetrics:
    """Metrics of a run from x (n,), period by period.

    Args:
        task: a policy or scenario, with `problem`, `space` and `homology`.
        period: control period [s].
        max_time: of the run [s].
    """

    def __init__(self, task: Any, x: Array, *, period: float, max_time: float) -> None:
        self._task, self._period, self._max_time = task, period, max_time
        self._step, self._time, self._cost = 0, 0.0, 0.0
        self._passed = np.zeros(2)  # lengths [m] before the present world, without noise and with it
        self._enter(task.space, x)
        self._first: Plan | None = None
        self.last: Frame | None = None
        self.favourite: str | None = None  # class of greatest weight of the last plan that was not blocked
        self._decided: str | None = None
        self._doubted = -np.inf  # time of the last weak plan [s]
        self.min_clearance, self._weakest = np.inf, (None, None)  # type: float, tuple[Any, Any]
        self._switches = self._reversals = self._fallbacks = self._doubtful = self._misses = 0
        self._blocked: list[tuple[float, float]] = []
        self._seconds: list[float] = []
        self._timings: list[Timing] = []

    def _enter(self, space: FreeSpace, x: Array) -> None:
        """Start classes and lengths anew in a world."""
        self._space, self._checker = space, ClearanceChecker(space.scene)
        self._length = Length(self._task.problem, x)
        self._driven = Driven(self._task.homology, x, self._time)

    def frame(self, period: Period) -> Frame:
        """Take the next period into account."""
        plan, advance, begin, last = period.plan, period.advance, self._time, self.last
        if plan.space is not None and plan.space is not self._space:
            if last is not None and period.run is last.run:  # among other obstacles, to the same goal
                self._driven.enter(plan.space.homology)
                self._space, self._checker = plan.space, ClearanceChecker(plan.space.scene)
            else:
                self._passed += self._length.total, self._length.noisy
                self._enter(plan.space, plan.state)
        clearance = self._checker.at(plan.state, begin)
        self._time, self._cost = begin + advance.time, self._cost + advance.cost
        self._length.add(advance.states, advance.time / max(1, len(advance.states)), advance.length)
        if len(advance.states):
            self._driven.observe(advance.states, self._time)
        outcome = ending(advance, begin, self._max_time)
        ended = [] if outcome is None else [f"{outcome.name.lower()} at {self._time:.2f} s"]
        news = [*self._news(plan, begin), *ended]
        self._count(period, begin)
        self.min_clearance = min(self.min_clearance, clearance, advance.clearance)
        length, noisy = np.add(self._passed, (self._length.total, self._length.noisy)).tolist()
        self.last = Frame(
            **vars(period), step=self._step, time=begin, outcome=outcome, cost=self._cost, length=length,
            noisy_length=noisy, clearance=clearance, driven_class=self._driven.winding(),
            news="; ".join(news) or None, metrics=self,
        )  # fmt: skip
        self._step += 1
        return self.last

    def _news(self, plan: Plan, now: float) -> list[str]:
        """Return lines on a plan, before it is counted."""
        news, blocked = [], self.last is not None and self.last.plan.fallback is not None
        if plan.fallback is not None and not blocked:
            does = "braking" if plan.stops else "this robot cannot stop, and takes the longest free way"
            news.append(f"blocked at {now:.2f} s: {plan.fallback}; {does}")
        elif plan.fallback is None and blocked:
            news.append(f"a way at {now:.2f} s, after {now - self._blocked[-1][0]:.2f} s: going on")
        if plan.estimate is not None and plan.estimate.doubtful and now - self._doubted >= STRETCH:
            news.append(f"{plan.estimate.ess:.1f} effective samples at {now:.2f} s: the control is a guess")
        if plan.fallback is None and self.favourite not in (None, plan.favourite):
            to = title(plan.favourite or OTHER)
            news.append(f"class {title(self.favourite or OTHER)} -> {to} at {now:.2f} s")
        return news

    def _count(self, period: Period, begin: float) -> None:
        """Count a period that began at a time [s]."""
        plan, estimate, late = period.plan, period.plan.estimate, period.plan_seconds > self._period
        self._first = self._first or plan
        if plan.fallback is not None:
            self._fallbacks += 1
            goes_on = bool(self._blocked) and self._blocked[-1][1] == begin
            self._blocked.append((self._blocked.pop()[0] if goes_on else begin, self._time))
        else:
            self._switches += self.favourite not in (None, plan.favourite)
            self.favourite = plan.favourite
            if plan.decided is not None:
                self._reversals += self._decided not in (None, plan.decided)
                self._decided = plan.decided
        if estimate is not None:
            if self._weakest[0] is None or estimate.ess < self._weakest[0]:
                self._weakest = estimate.ess, begin
            if estimate.doubtful:
                self._doubtful, self._doubted = self._doubtful + 1, begin
        self._seconds.append(period.plan_seconds)
        if period.timing is not None:
            late = period.timing.missed
            self._timings.append(period.timing)
        self._misses += late

    def result(self) -> DriveResult:
        """Return the figures of the run so far, which has at least one frame."""
        last, first, milliseconds = self.last, self._first, 1e3 * np.array(self._seconds)
        assert last is not None
        assert first is not None
        named = None if last.plan.space is None else last.plan.space.homology.named
        return DriveResult(
            outcome=(last.outcome or Outcome.TIMEOUT).name.lower(),
            time=last.end_time,
            cost=last.cost,
            path_length=last.length,
            noisy_path_length=last.noisy_length,
            steps=last.step + 1,
            vertices=last.vertices,
            min_clearance=self.min_clearance,
            value_estimate=first.exact if first.estimate is None else first.estimate.value,
            executed_class=class_id(last.driven_class, named) if last.outcome is Outcome.GOAL else None,
            class_switches=self._switches,
            class_reversals=self._reversals,
            fallbacks=self._fallbacks,
            blocked_time=sum(end - begin for begin, end in self._blocked),
            blocked=self._blocked,
            doubtful_plans=self._doubtful,
            least_ess=self._weakest[0],
            least_ess_time=self._weakest[1],
            step_ms=dict(
                zip(("median", "p95", "max"), np.percentile(milliseconds, (50, 95, 100)).tolist(), strict=True)
            ),
            deadline_misses=self._misses,
            real_time=figures(self._timings, self._period) if self._timings else None,
        )


def ending(advance: Advance, begun: float, max_time: float) -> Outcome | None:
    """Judge a period that began at `begun` [s]: TIMEOUT from `max_time` [s] on; None while the run goes on."""
    late = advance.outcome is None and begun + advance.time >= max_time - GRACE
    return Outcome.TIMEOUT if late else advance.outcome
