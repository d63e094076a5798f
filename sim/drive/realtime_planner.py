"""Planning ahead of a plant that does not wait: the planner's thread of a real-time drive."""

from __future__ import annotations

import gc
import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.geometry.field import clearance
from sim.drive.clock import URGENT, Clock
from sim.drive.episode import size_of

SHARE = 0.7  # of a period, at most, is for references and samples; then they are weighed, and the tree grows
LEAST = 0.3  # of it is, however long weighing takes
RESERVE = 1.25  # times as long as weighing and the like takes is kept for it,
RECENT, RARE = 40, 2  # which is the second longest of so many: one that was disturbed is no rule
QUICKLY, SLOWLY = 0.3, 0.03  # with these shares what something takes is learned when it is more, or less, than thought
FULLER = 8  # times as many vertices as it begins with a tree has at most: there is room for so many
PIECES, MOST = 10, 20  # integration steps in which a period is foreseen, and in which any time is, if a plant is late
BEHIND = 0.2  # of a period that the plant is late by: then the tree does not grow


class Stopped(Exception):
    """The drive is over."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ready:
    """A plan that has been made, and when it is meant to take over."""

    plan: Plan
    begin: float  # time of the drive for which it was made [s]
    seconds: float  # that planning took
    slack: float  # from the end of planning to `begin` [s]; negative if it is late
    samples: int
    vertices: int  # of the tree


@dataclass(slots=True)
class Handover:
    """Shared fields of the plant's thread and the planner's; each has one writer."""

    first: Ready  # the plan that the drive begins with
    start: Array  # (n,) and where
    arrived: deque[Ready] = field(default_factory=deque)  # planner to plant, in the order of their beginnings
    driven: deque[Array] = field(default_factory=deque)  # plant to planner: states of the periods that are over
    seen: tuple[float, Array] = field(init=False)  # plant to planner: time [s] and state of the last physics step
    stopped: bool = False

    def __post_init__(self) -> None:
        self.seen = (0.0, self.start)


class Planner:
    """Makes the plan of the next period while one is driven, and lets the tree grow in what time is left.

    Args:
        grow: vertices per period at most; None: as many as there is time for.
    """

    def __init__(self, controller: Policy, clock: Clock, period: float, grow: int | None) -> None:
        self.controller, self.clock, self.period, self.grow = controller, clock, period, grow
        self._most = math.inf  # vertices
        self._vertex = 1e-3  # what a vertex takes [s]
        self._after: deque[float] = deque(maxlen=RECENT)  # what plans took once their samples were drawn [s]

    def first(self, x: Array) -> Ready:
        """A plan at x (n,) for the beginning of a drive, made in a period from what one without a clock has found.

        Guides go on from those of the last plan, and the first ones are what takes long: the drive waits for them.
        """
        self.controller.begin(x)
        self.controller.plan(x)
        return self._made(x, begin=0.0, now=-self.period)

    def make_room(self) -> None:
        """Let the tree have the room now that it may need: to make it takes longer than a period."""
        tree = self.controller.tree
        if tree is not None:
            self._most = FULLER * tree.size
            tree.reserve(FULLER * tree.size)

    def work(self, share: Handover, origin: float) -> None:
        """Plan until the drive is over; it began when the clock said `origin` [s]."""
        period, step, last = self.period, 0, share.first
        while True:
            self.clock.wait(origin + step * period)
            if share.stopped:
                return
            step = max(step, int((self.clock.now() - origin) / period + 1e-9))
            with URGENT.work():
                last = self._ahead(share, last, begin=(step + 1) * period, now=step * period, origin=origin)
            share.arrived.append(last)
            gc.collect(1)  # now, when nothing waits for it, and not in the middle of a plan
            self._grow(share, origin, origin + last.begin)
            step += 1

    def _ahead(self, share: Handover, last: Ready, *, begin: float, now: float, origin: float) -> Ready:
        """The plan for the period that begins at `begin`, made during the one that began at `now`."""
        driven = [share.driven.popleft() for _ in range(len(share.driven))]
        time, x = share.seen
        if driven:
            self.controller.observe(np.vstack(driven), 0.0, time)
        states = foreseen(self.controller, last, time, x, begin, self.period / PIECES)
        self.controller.expect(states, begin - last.begin)
        return self._made(states[-1], begin=begin, now=now, origin=origin)

    def _made(self, x: Array, *, begin: float, now: float, origin: float | None = None) -> Ready:
        """A plan at x (n,); without an origin the drive has not begun, and its time is now."""
        clock = self.clock
        began = clock.now()
        zero = began - now if origin is None else origin
        after = sorted(self._after)[-RARE] if len(self._after) >= RARE else max(self._after, default=0.0)
        share = np.clip(1.0 - RESERVE * after / self.period, LEAST, SHARE)
        until = zero + now + float(share) * self.period
        plan = self.controller.plan(x, lambda: until - clock.now())
        ended = clock.now()
        if began < until:
            self._after.append(max(0.0, ended - until))
        return Ready(
            plan=plan,
            begin=begin,
            seconds=ended - began,
            slack=zero + begin - ended,
            samples=0 if plan.estimate is None else sum(part.size for part in plan.estimate.parts),
            vertices=size_of(self.controller.tree),
        )

    def _grow(self, share: Handover, origin: float, until: float) -> None:
        tree, clock = self.controller.tree, self.clock
        if tree is None:
            return
        added = 0
        while not share.stopped and (self.grow is None or added < self.grow):
            before = clock.now()
            behind = before - origin - share.seen[0] > BEHIND * self.period
            if behind or before + 2.0 * self._vertex > until or tree.size >= self._most:
                return
            tree.grow(tree.size + 1, enough=lambda _: clock.now() > until)
            self._vertex = _learned(self._vertex, clock.now() - before)
            added += 1


def foreseen(controller: Policy, ready: Ready, time: float, x: Array, until: float, step: float) -> Array:
    """States (k, n) from x (n,) at `time` to `until` [s] under a plan's law without noise; x itself is the first.

    They end before they enter the goal or a wall, where nothing can be planned.
    """
    space, dynamics = controller.space, controller.problem.dynamics
    count = min(max(0, int(np.ceil((until - time) / step - 1e-9))), MOST)
    h, states = (until - time) / max(1, count), [x]
    for i in range(count):
        u = ready.plan.at(x, max(0.0, time + i * h - ready.begin))
        x = dynamics.step(x, u, np.zeros(dynamics.m), h)
        if space.scene.goal.contains(x[:2]) or clearance(space.field, x[0], x[1]) <= 0.0:
            break
        states.append(x)
    return np.array(states)


def _learned(before: float, found: float) -> float:
    """Update a duration, rather above its average [s]."""
    return before + (QUICKLY if found > before else SLOWLY) * (found - before)
