"""Real-time runs: the plant runs against the clock on one thread, plans are made ahead on another.

While period k is driven, the plan for period k+1 is made: at the state where the present law will have taken the robot
by then, without noise. What noise does meanwhile the law itself answers, queried at every physics step at the true
state. A plan takes over when its period begins, or as soon as it is ready if that is later: until then the old law goes
on.

    period         k                   k+1
    plant     steps under plan k   | steps under plan k+1
    planner   plan k+1  | growth   | plan k+2  | growth
"""

from __future__ import annotations

import gc
import math
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from queue import SimpleQueue

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy, RunState
from pirrht.geometry.field import clearance
from sim.drive.clock import URGENT, Clock, Timing
from sim.drive.metrics import Period, ending
from sim.drive.plant import Plant

SWITCH = 2e-5  # a thread gives the interpreter to one that waits for it after this time [s]
SHARE = 0.7  # of a period, at most, is for references and samples; then they are weighed, and the tree grows
LEAST_SHARE = 0.3  # of it is, however long weighing takes
RESERVE = 1.25  # times as long as weighing and the like takes is kept for it,
RECENT, RARE = 40, 2  # which is the second longest of so many: one that was disturbed is no rule
QUICKLY, SLOWLY = 0.3, 0.03  # shares by which a duration is learned when it is more, or less, than the last ones
FULLER = 8  # times as many vertices as it begins with a tree has at most: there is space for so many
PIECES, MOST_PIECES = 10, 20  # integration steps in which a period is predicted, and any time if a plant is late
BEHIND = 0.2  # of a period that the plant is late by: then the tree does not grow


class Stopped(Exception):
    """The run is over."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedPlan:
    """A plan, and when it is meant to take over."""

    plan: Plan
    begin: float  # time of the run for which it was made [s]
    seconds: float  # that planning took
    slack: float  # from the end of planning to `begin` [s]; negative if it is late
    vertices: int  # of the tree
    run: RunState  # of the policy


class SharedPlan:
    """Fields that plant and planner share; each has one writer."""

    def __init__(self, first: TimedPlan) -> None:
        self.first = first  # the plan that the run begins with
        self.arrived = deque[TimedPlan]()  # planner to plant: plans, in the order of their beginnings
        self.driven = deque[Array]()  # plant to planner: states of the periods that are over
        self.seen = 0.0, first.plan.state  # plant to planner: time [s] and state of the last physics step
        self.stopped = False


def periods(
    plant: Plant, policy: Policy, rng: np.random.Generator, clock: Clock, *, grow: int | None, max_time: float
) -> Generator[Period]:
    """Drive on from where the plant is, in real time, until max_time [s] or whoever listens has enough.

    Args:
        grow: vertices that the tree gains per period at most; None: as many as there is time for.

    Raises:
        NoReference: already the start has no reference.
    """
    planner, start = Planner(policy, clock, plant.period, grow), plant.state
    plant.advance(planner.first(start).plan.at, np.random.default_rng(0))  # compile and load everything before
    plant.reset(start)
    planner.reserve()
    share, news = SharedPlan(planner.first(start)), SimpleQueue[Period | BaseException]()

    def thread(name: str, work: Callable[[], None]) -> threading.Thread:
        """Start a thread; its end is the other's, and its error goes to whoever waits for news."""

        def guarded() -> None:
            try:
                with suppress(Stopped):
                    work()
            except BaseException as error:
                news.put(error)
            finally:
                share.stopped = True

        started = threading.Thread(target=guarded, name=name, daemon=True)
        started.start()
        return started

    def drive() -> None:
        for period, begin in _drive(plant, share, clock, origin, rng):
            news.put(period)
            if ending(period.advance, begin, max_time) is not None:
                return

    with _undisturbed():
        origin = clock.now()
        threads = [thread("plant", drive), thread("planner", lambda: planner.work(share, origin))]
        try:
            while True:
                period = news.get()
                if isinstance(period, BaseException):
                    raise period
                yield period
        finally:
            share.stopped = True
            for one in threads:
                one.join()


def _drive(
    plant: Plant, share: SharedPlan, clock: Clock, origin: float, rng: np.random.Generator
) -> Iterator[tuple[Period, float]]:
    """Drive period by period as the clock goes: each, and when it began [s]."""
    law = share.first
    for step in count():
        begin, start, late = step * plant.period, plant.state, list[float]()
        met = law

        def control(x: Array, s: float, begin: float = begin, late: list[float] = late) -> Array:
            nonlocal law, met
            t, arrived = begin + s, share.arrived
            share.seen = (t, x)
            clock.wait(origin + t)
            if share.stopped:
                raise Stopped
            late.append(max(0.0, clock.now() - origin - t))
            while arrived and arrived[0].begin <= t + 1e-9:
                law = arrived.popleft()
            if len(late) == 1:
                met = law
            return law.plan.at(x, t - law.begin)

        advance = plant.advance(control, rng)
        share.driven.append(advance.states)
        missed, estimate = met.begin < begin - 1e-9, met.plan.estimate
        samples = 0 if estimate is None else sum(part.size for part in estimate.parts)
        fresh = (None, None) if missed or step == 0 else (samples, met.slack)
        timing = Timing(missed=missed, samples=fresh[0], slack=fresh[1], late=np.array(late))
        period = Period(
            plan=replace(met.plan, state=start), advance=advance, plan_seconds=met.seconds, vertices=met.vertices,
            run=met.run, timing=timing,
        )  # fmt: skip
        yield period, begin


class Planner:
    """Makes the plan of the next period while one is driven, and lets the tree grow in what time is left.

    Args:
        grow: vertices per period at most; None: as many as there is time for.
    """

    def __init__(self, policy: Policy, clock: Clock, period: float, grow: int | None) -> None:
        self.policy, self.clock, self.period, self.grow = policy, clock, period, grow
        self._most = math.inf  # vertices
        self._vertex = 1e-3  # time that a vertex takes [s]
        self._after: deque[float] = deque(maxlen=RECENT)  # time that plans took once their samples were drawn [s]

    def first(self, x: Array) -> TimedPlan:
        """Return a plan at x (n,) for the beginning of a run, made in a period from that of one without a clock.

        Guides go on from those of the last plan, and the first ones are what takes long: the run waits for them.
        """
        self.policy.begin(x)
        self.policy.plan(x)
        return self._made(x, begin=0.0, zero=self.clock.now() + self.period)

    def reserve(self) -> None:
        """Reserve the tree's memory before the run: that takes longer than a period."""
        tree = self.policy.tree
        if tree is not None:
            self._most = FULLER * tree.size
            tree.reserve(FULLER * tree.size)

    def work(self, share: SharedPlan, origin: float) -> None:
        """Plan until the run is over; it began when the clock said `origin` [s]."""
        period, step, last = self.period, 0, share.first
        while True:
            self.clock.wait(origin + step * period)
            if share.stopped:
                return
            step = max(step, int((self.clock.now() - origin) / period + 1e-9))
            with URGENT.work():
                last = self._ahead(share, last, (step + 1) * period, origin)
            share.arrived.append(last)
            gc.collect(1)  # now, when nothing waits for it, and not in the middle of a plan
            self.extend(share, origin, origin + last.begin)
            step += 1

    def _ahead(self, share: SharedPlan, last: TimedPlan, begin: float, origin: float) -> TimedPlan:
        """Return the plan for the period that begins at `begin` [s]."""
        driven = [share.driven.popleft() for _ in range(len(share.driven))]
        seen = share.seen
        if driven:
            self.policy.observe(np.vstack(driven), 0.0, seen[0])
        states = self.predicted(last, seen, begin)
        self.policy.expect(states, begin - last.begin)
        return self._made(states[-1], begin=begin, zero=origin)

    def predicted(self, last: TimedPlan, seen: tuple[float, Array], until: float) -> Array:
        """Return states (k, n) from a time and state that was seen until a time [s], under a plan's law without noise.

        They end before they enter the goal or a wall, where nothing can be planned.
        """
        (time, x), space, dynamics = seen, self.policy.space, self.policy.problem.dynamics
        pieces = min(max(0, math.ceil((until - time) / self.period * PIECES - 1e-9)), MOST_PIECES)
        h, states = (until - time) / max(1, pieces), [x]
        for i in range(pieces):
            u = last.plan.at(x, max(0.0, time + i * h - last.begin))
            x = dynamics.step(x, u, np.zeros(dynamics.m), h)
            if space.scene.goal.contains(x[:2]) or clearance(space.field, x[0], x[1]) <= 0.0:
                break
            states.append(x)
        return np.array(states)

    def _made(self, x: Array, *, begin: float, zero: float) -> TimedPlan:
        """Return a plan at x (n,), made in the period before `begin`; `zero` is the run's start on the clock [s]."""
        began = self.clock.now()
        after = sorted(self._after)[-RARE] if len(self._after) >= RARE else max(self._after, default=0.0)
        share = float(np.clip(1.0 - RESERVE * after / self.period, LEAST_SHARE, SHARE))
        until = zero + begin + (share - 1.0) * self.period
        plan = self.policy.plan(x, lambda: until - self.clock.now())
        ended, tree = self.clock.now(), self.policy.tree
        if began < until:
            self._after.append(max(0.0, ended - until))
        return TimedPlan(
            plan=plan, begin=begin, seconds=ended - began, slack=zero + begin - ended,
            vertices=0 if tree is None else tree.size, run=self.policy.run,
        )  # fmt: skip

    def extend(self, share: SharedPlan, origin: float, until: float) -> None:
        """Let the tree grow, vertex by vertex, until a time of the clock [s]; not while the plant is late."""
        tree, clock, added = self.policy.tree, self.clock, 0
        while tree is not None and not share.stopped and (self.grow is None or added < self.grow):
            before = clock.now()
            behind = before - origin - share.seen[0] > BEHIND * self.period
            if behind or before + 2.0 * self._vertex > until or tree.size >= self._most:
                return
            tree.grow(tree.size + 1, enough=lambda _: clock.now() > until)
            more = clock.now() - before - self._vertex
            self._vertex += (QUICKLY if more > 0.0 else SLOWLY) * more
            added += 1


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Avoid long pauses: collect only new garbage, between plans; let threads take turns quickly."""
    before, collecting = sys.getswitchinterval(), gc.isenabled()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    URGENT.clocked = True
    try:
        yield
    finally:
        URGENT.clocked = False
        gc.unfreeze()
        if collecting:
            gc.enable()
        sys.setswitchinterval(before)
