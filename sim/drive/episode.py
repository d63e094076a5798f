"""The receding-horizon loop: plan, drive for a period, observe; in simulated time, or by a clock (Algorithm 4).

By a clock the plant runs on one thread, and plans are made ahead on another. While period k is driven, the plan for
period k+1 is made: at the state where the present law will have taken the robot by then, without noise. What noise does
meanwhile the law itself answers, queried at every physics step at the true state. A plan takes over when its period
begins, or as soon as it is ready if that is later: until then the old law goes on.

    period         k                   k+1
    plant     steps under plan k   | steps under plan k+1
    planner   plan k+1  | growth   | plan k+2  | growth
"""

from __future__ import annotations

import gc
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from itertools import count
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import Policy
from pirrht.exact.desirability import Desirability
from pirrht.geometry.space import at_states
from sim.drive.executor import Advance, Plant
from sim.drive.metrics import EpisodeMetrics, Frame, Risk, TimedPlan, ending

MOST_VERTICES = 1_000_000  # of a tree that grows during a run: some GiB of memory
SWITCH = 2e-5  # a thread gives the interpreter to one that waits for it after this time [s]
SHARE = 0.7  # of a period, at most, is for references and samples; then they are weighed, and the tree grows
LEAST_SHARE = 0.3  # of it is, however long weighing takes
RESERVE = 1.25  # times as long as weighing and the like takes is kept for it,
RECENT, RARE = 40, 2  # which is the second longest of so many: one that was disturbed is no rule
FULLER = 8  # times as many vertices as it begins with a tree has at most: there is space for so many
PIECES, MOST_PIECES = 10, 20  # integration steps in which a period is predicted, and any time if a plant is late
BEHIND = 0.2  # of a period that the plant is late by: then the tree does not grow
LONGEST_WAIT = 0.1  # after which work that gives way continues in any case [s]

Period = tuple[TimedPlan, Advance, Array]  # how late each of its physics steps began, (k,) [s]

CLOCKED = Event()  # set while a run goes by the clock, after which there will be more time
IDLE = Event()  # cleared while a plan is made by the clock: other work waits for it, LONGEST_WAIT at most
IDLE.set()


class Clock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Time since some moment [s]."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""
        time.sleep(max(0.0, until - self.now()))


class Stopped(Exception):
    """The run is over."""


def run(
    plant: Plant, policy: Policy, start: Array, rng: np.random.Generator, *, max_time: float, grow: int | None = None,
    clock: Clock | None = None, grid: Desirability | None = None, risk: Risk | None = None,
) -> Generator[Frame]:  # fmt: skip
    """Drive from start until the goal, a collision or max_time [s]; NoReference if already the start has none.

    Args:
        grow: vertices that the policy's tree gains per period, until it has MOST_VERTICES; None: none, by a clock as
            many as there is time for.
        clock: goes on while plans are made; None: the plant waits for them.
        grid: the exact solution, with which every control is compared.
        risk: predicts the probability of a collision from a plan on.
    """
    plant.reset(start)
    metrics = EpisodeMetrics(policy, plant.state, period=plant.period, max_time=max_time, grid=grid)
    metrics.risk = risk or metrics.risk
    if clock is None:
        periods: Generator[Any] = _in_turn(plant, policy, rng, grow or 0)
    else:
        periods = _by_clock(plant, policy, rng, clock, grow=grow, max_time=max_time)
    with closing(periods):
        for period in periods:
            frame = metrics.frame(*period)
            yield frame
            if frame.outcome is not None:
                return


def _in_turn(plant: Plant, policy: Policy, rng: np.random.Generator, grow: int) -> Generator[tuple[TimedPlan, Advance]]:
    """Plan and drive by turns."""
    policy.begin(plant.state)
    while True:
        made = TimedPlan.of(policy, plant.state)
        advance = plant.advance(made.plan.at, rng)
        policy.observe(advance.states, advance.time)
        yield made, advance
        if policy.tree is not None and grow:
            policy.tree.grow(min(made.vertices + grow, MOST_VERTICES))


def _by_clock(
    plant: Plant, policy: Policy, rng: np.random.Generator, clock: Clock, *, grow: int | None, max_time: float
) -> Generator[Period]:
    """Drive in real time, until max_time [s] or whoever listens has enough."""
    planner, start = Planner(policy, clock, plant.period, grow), plant.state
    plant.advance(planner.first(start).plan.at, np.random.default_rng(0))  # compile and load everything before
    plant.reset(start)
    if policy.tree is not None:  # that takes longer than a period
        policy.tree.reserve(planner.most)
    first = planner.first(start)
    news = SimpleQueue[Period | BaseException]()

    def drive() -> None:
        for period in _drive(plant, planner, first, rng, max_time):
            news.put(period)

    def guarded(work: Callable[[], None]) -> None:
        """Work on a thread; its end is the other's, and its error goes to whoever waits for news."""
        try:
            work()
        except BaseException as error:
            news.put(error)
        finally:
            planner.stopped = True

    works = {"plant": drive, "planner": partial(planner.work, first)}
    threads = [Thread(target=guarded, args=(work,), name=name, daemon=True) for name, work in works.items()]
    with undisturbed():
        planner.origin = clock.now()
        for thread in threads:
            thread.start()
        try:
            while not isinstance(period := news.get(), BaseException):
                yield period
            raise period  # `Stopped` comes after what has stopped the run
        finally:
            planner.stopped = True
            for thread in threads:
                thread.join()


def _drive(plant: Plant, planner: Planner, law: TimedPlan, rng: np.random.Generator, until: float) -> Iterator[Period]:
    """Drive period by period as the clock goes, until the run ends."""
    clock, origin, arrived = planner.clock, planner.origin, planner.arrived
    for step in count():
        begin = step * plant.period
        start = plant.state
        late = list[float]()
        met = law

        def control(x: Array, s: float, begin: float = begin, late: list[float] = late) -> Array:
            nonlocal law, met
            t = begin + s
            planner.seen = t, x
            clock.wait(origin + t)
            if planner.stopped:
                raise Stopped
            late.append(max(0.0, clock.now() - origin - t))
            while arrived and arrived[0].begin <= t + 1e-9:
                law = arrived.popleft()
            if len(late) == 1:
                met = law
            return law.plan.at(x, t - law.begin)

        advance = plant.advance(control, rng)
        planner.driven.append(advance.states)
        yield replace(met, plan=replace(met.plan, state=start)), advance, np.array(late)
        if ending(advance, begin, until) is not None:
            return


class Planner:
    """Makes the plan of the next period while one is driven, and lets the tree grow in what time is left.

    Planner and plant share four fields, of one writer each: plans in the order of their beginnings that have `arrived`
    for the plant; states of periods that were `driven` and the last one `seen`, with its time, for the planner.
    """

    def __init__(self, policy: Policy, clock: Clock, period: float, grow: int | None) -> None:
        self.policy = policy
        self.clock = clock
        self.period = period
        self.grow = grow

        self.origin, self.stopped = 0.0, False  # start of the run on the clock [s]
        self.arrived = deque[TimedPlan]()
        self.driven = deque[Array]()
        self.seen: tuple[float, Array] = (0.0, np.empty(0))
        self.most = 0 if policy.tree is None else FULLER * policy.tree.size  # vertices
        self._longest = 0.0  # time that a few draws take, half of it since the last period [s]
        self._after: deque[float] = deque(maxlen=RECENT)  # time that plans took once their samples were drawn [s]

    def first(self, x: Array) -> TimedPlan:
        """Return a plan at x (n,) for a run's beginning; guides, which take long, go on from a plan without a clock."""
        self.policy.begin(x)
        self.policy.plan(x)
        self.seen = (0.0, x)
        self.origin = self.clock.now() + self.period

        return self._made(x, 0.0)

    def work(self, last: TimedPlan) -> None:
        """Plan until the run is over, from its first plan on."""
        period, step = self.period, 0
        while True:
            self.clock.wait(self.origin + step * period)
            if self.stopped:
                return
            step = max(step, int((self.clock.now() - self.origin) / period + 1e-9))
            begin = (step + 1) * period
            IDLE.clear()
            try:
                driven, (time, x) = [self.driven.popleft() for _ in range(len(self.driven))], self.seen
                if driven:
                    self.policy.observe(np.vstack(driven), 0.0, time)
                states = self.predicted(last, time, x, begin)
                self.policy.expect(states, begin - last.begin)
                last = self._made(states[-1], begin)
            finally:
                IDLE.set()
            self.arrived.append(last)
            gc.collect(1)  # now, when nothing waits for it, and not in the middle of a plan
            self.extend(self.origin + begin)
            step += 1

    def predicted(self, last: TimedPlan, time: float, x: Array, until: float) -> Array:
        """Return states (k, n) from x (n,) at a time until another one [s], under a plan's law without noise.

        They end before they enter the goal or a wall, where nothing can be planned.
        """
        space, dynamics, states = self.policy.space, self.policy.problem.dynamics, [x]
        pieces = min(max(0, math.ceil((until - time) / self.period * PIECES - 1e-9)), MOST_PIECES)
        h = (until - time) / max(1, pieces)
        kernels = space.static.kernels
        clear = at_states(kernels, dynamics.reads(kernels.turns)).clearance
        for i in range(pieces):
            u = last.plan.at(x, max(0.0, time + i * h - last.begin))
            x = dynamics.step(x, u, np.zeros(dynamics.m), h)
            if space.scene.goal.contains(dynamics.place(x)) or clear(space.static, x) <= 0.0:
                break
            states.append(x)
        return np.array(states)

    def _made(self, x: Array, begin: float) -> TimedPlan:
        """Return a plan at x (n,), made in the period before `begin` [s]."""
        began = self.clock.now()
        due = self.origin + begin
        after = sorted(self._after)[-RARE:] or [0.0]
        share = float(np.clip(1.0 - RESERVE * after[0] / self.period, LEAST_SHARE, SHARE))
        until = due + (share - 1.0) * self.period
        made = TimedPlan.of(self.policy, x, lambda: until - self.clock.now())
        ended = self.clock.now()
        if began < until and ended < until + self.period:  # else guides took longer, while the robot stood
            self._after.append(max(0.0, ended - until))
        return replace(made, plan_seconds=ended - began, begin=begin, slack=due - ended)

    def extend(self, until: float) -> None:
        """Let the tree grow, a few draws at a time, until a time of the clock [s]; not while the plant is late."""
        tree, last = self.policy.tree, self.clock.now()
        self._longest *= 0.5

        def enough(_: int) -> bool:
            nonlocal last
            now = self.clock.now()
            last, self._longest = now, max(self._longest, now - last)
            behind = now - self.origin - self.seen[0] > BEHIND * self.period
            return self.stopped or behind or now + self._longest > until

        if tree is not None:
            tree.grow(self.most if self.grow is None else min(tree.size + self.grow, self.most), enough=enough)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Avoid long pauses: collect only new garbage, between plans; let threads take turns quickly."""
    before = sys.getswitchinterval()
    collecting = gc.isenabled()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    CLOCKED.set()
    try:
        yield
    finally:
        CLOCKED.clear()
        gc.unfreeze()
        if collecting:
            gc.enable()
        sys.setswitchinterval(before)


def summary(figures: Mapping[str, Any]) -> str:
    """Sum up the figures of a real-time run in a line for a person."""
    samples, slack, late = (figures[name] for name in ("samples_per_period", "slack_ms", "late_ms"))
    shown = ["none" if v is None else f"{v:.0f}" for v in (*samples.values(), *slack.values())]
    return (
        f"real time: {figures['deadline_misses']} of {figures['periods']} plans late; samples per period {shown[0]} "
        f"(least {shown[1]}), slack {shown[2]} ms (least {shown[3]}); physics steps late by {late['median']:.2g} ms, "
        f"p99 {late['p99']:.2g}, max {late['max']:.2g}"
    )
