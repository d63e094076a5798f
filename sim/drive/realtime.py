"""Real-time drives: the plant runs against the clock on one thread, plans are made ahead on another.

While period k is driven, the plan for period k+1 is made: at the state where the present law will have taken the robot
by then, without noise. What noise does meanwhile the law itself answers, asked at every physics step at the true state.
A plan takes over when its period begins, or as soon as it is ready if that is later: until then the old law goes on.

    period         k                   k+1
    plant     steps under plan k   | steps under plan k+1
    planner   plan k+1  | growth   | plan k+2  | growth
"""

from __future__ import annotations

import gc
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from queue import SimpleQueue

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import Policy
from sim.drive.clock import URGENT, Clock, Timing, WallClock
from sim.drive.odometer import Frame, Odometer, ending
from sim.drive.plant import Advance, Plant
from sim.drive.realtime_planner import Handover, Planner, Ready, Stopped

SWITCH = 2e-5  # a thread gives the interpreter to one that waits for it after this time [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """Result of the plant in one period."""

    step: int
    start: Array  # (n,) where it began
    met: Ready  # the plan in force then
    advance: Advance
    late: Array  # (k,) how late each physics step began [s]


News = SimpleQueue[Moved | BaseException]


def run(
    plant: Plant,
    controller: Policy,
    start: Array,
    rng: np.random.Generator,
    *,
    period: float,
    max_time: float,
    grow: int | None = None,
    clock: Clock | None = None,
) -> Generator[Frame]:
    """Drive in real time from start until the goal, a collision or max_time [s].

    Args:
        period: that of the plant [s].
        grow: vertices that the tree gains per period at most; None: as many as there is time for.

    Raises:
        NoReference: already the start has no reference.
    """
    clock = clock or WallClock()
    planner = Planner(controller, clock, period, grow)
    _warm_up(plant, planner, start)
    planner.make_room()
    share = Handover(planner.first(plant.state), plant.state)
    news, problem, space = News(), controller.problem, controller.space
    odometer = Odometer(problem, space, plant.state, max_time, homology=controller.homology, busy=True)
    with _undisturbed(), URGENT.drive():
        origin = clock.now()
        pacer = _Pacer(share, clock, origin)
        threads = [
            _thread("plant", lambda: _drive(plant, pacer, rng, period, max_time, news), share, news),
            _thread("planner", lambda: planner.work(share, origin), share, news),
        ]
        try:
            outcome = None
            while outcome is None:
                moved = news.get()
                if isinstance(moved, BaseException):
                    raise moved
                frame = _frame(odometer, moved, period)
                outcome = frame.outcome
                yield frame
        finally:
            share.stopped = True
            for thread in threads:
                thread.join()


def _drive(plant: Plant, pacer: _Pacer, rng: np.random.Generator, period: float, max_time: float, news: News) -> None:
    """The plant's thread."""
    for step in count():
        now, start = step * period, plant.state
        advance = plant.advance(pacer.beginning(now), rng)
        pacer.share.driven.append(advance.states)
        late = np.array(pacer.late)
        news.put(Moved(step=step, start=start, met=pacer.met, advance=advance, late=late))
        if ending(advance, now, max_time) is not None:
            return


class _Pacer:
    """The control that the plant asks for at every physics step: it is told when its time has come."""

    def __init__(self, share: Handover, clock: Clock, origin: float) -> None:
        self.share, self._clock, self._origin = share, clock, origin
        self._now = share.first
        self.met = share.first  # the plan in force when the period began
        self.late: list[float] = []

    def beginning(self, begin: float) -> Callable[[Array, float], Array]:
        """The control during the period that begins at `begin` [s]."""
        self.late = []

        def at(x: Array, s: float) -> Array:
            t = begin + s
            self.share.seen = (t, x)
            self._clock.wait(self._origin + t)
            if self.share.stopped:
                raise Stopped
            self.late.append(max(0.0, self._clock.now() - self._origin - t))
            self._take_over(t)
            if len(self.late) == 1:
                self.met = self._now
            return self._now.plan.at(x, t - self._now.begin)

        return at

    def _take_over(self, t: float) -> None:
        arrived = self.share.arrived
        while arrived and arrived[0].begin <= t + 1e-9:
            self._now = arrived.popleft()


def _frame(odometer: Odometer, moved: Moved, period: float) -> Frame:
    """Make the frame of one period."""
    met = moved.met
    missed = met.begin < moved.step * period - 1e-9
    fresh = not missed and moved.step > 0
    timing = Timing(
        missed=missed, samples=met.samples if fresh else None, slack=met.slack if fresh else None, late=moved.late
    )
    plan = replace(met.plan, state=moved.start)
    return odometer.frame(plan, moved.advance, seconds=met.seconds, vertices=met.vertices, timing=timing)


def _thread(name: str, work: Callable[[], None], share: Handover, news: News) -> threading.Thread:
    """Start a thread; its end is the other's, and what goes wrong is told to the one that waits for news."""

    def guarded() -> None:
        try:
            with suppress(Stopped):
                work()
        except BaseException as error:
            news.put(error)
        finally:
            share.stopped = True

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread


def _warm_up(plant: Plant, planner: Planner, start: Array) -> None:
    """Do everything once before the clock starts: compile it and load it."""
    plant.reset(start)
    plan = planner.first(plant.state).plan
    plant.advance(plan.at, np.random.default_rng(0))
    plant.reset(start)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """No long pauses: only new garbage is collected, and between plans; threads take turns quickly."""
    before, collecting = sys.getswitchinterval(), gc.isenabled()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if collecting:
            gc.enable()
        sys.setswitchinterval(before)
