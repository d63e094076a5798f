"""The receding-horizon loop as a generator of frames, and the tally that sums a drive up."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Policy
from pirrht.estimation.estimate import OTHER
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree
from pirrht.topology.signature import class_id
from sim.drawing.colors import title
from sim.drive.clock import Timing, figures
from sim.drive.odometer import Frame, Odometer
from sim.drive.plant import Plant
from sim.drive.result import DriveResult

__all__ = ["Frame", "Tally", "run", "size_of"]

BRAKING, GOING = "braking", "this robot cannot stop, and takes the longest free way"
MOST_VERTICES = 1_000_000  # of a tree that grows while it is driven: some GiB of memory
STRETCH = 1.0  # plans of few effective samples that are less apart than this are told of once [s]


def run(
    plant: Plant,
    controller: Policy,
    start: Array,
    rng: np.random.Generator,
    *,
    max_time: float,
    grow: int = 0,
) -> Generator[Frame]:
    """Drive from start until the goal, a collision or max_time [s] of simulated time (Algorithm 4).

    Args:
        grow: vertices that the controller's tree gains between two plans, until it has MOST_VERTICES.

    Raises:
        NoReference: already the start has no reference.
    """
    plant.reset(start)
    controller.begin(plant.state)
    odometer = Odometer(controller.problem, controller.space, plant.state, max_time, homology=controller.homology)
    outcome: Outcome | None = None
    space = controller.space
    while outcome is None:
        if controller.space is not space:
            space = controller.space
            odometer.enter(space)
        began = time.perf_counter()
        plan = controller.plan(plant.state)
        seconds = time.perf_counter() - began
        vertices = size_of(controller.tree)
        advance = plant.advance(plan.at, rng)
        controller.observe(advance.states, advance.time)
        frame = odometer.frame(plan, advance, seconds=seconds, vertices=vertices)
        outcome = frame.outcome
        yield frame
        if controller.tree is not None and outcome is None and grow:
            controller.tree.grow(min(vertices + grow, MOST_VERTICES))


def size_of(tree: HomologyTree | None) -> int:
    """Vertices of a tree; 0 if there is none."""
    return 0 if tree is None else tree.size


@dataclass(slots=True)
class Tally:
    """Sums a drive up as its frames pass by."""

    period: float  # [s]
    first: Plan | None = None
    last: Frame | None = None
    switches: int = 0
    reversals: int = 0
    fallbacks: int = 0
    blocked: list[tuple[float, float]] = field(default_factory=list)  # from when to when there was no way [s]
    doubtful: int = 0  # plans that rest on few effective samples
    weakest: tuple[float, float] | None = None  # least effective sample size, and the time of that plan [s]
    misses: int = 0
    min_clearance: float = np.inf
    favourite: str | None = None
    decided: str | None = None
    plan_seconds: list[float] = field(default_factory=list)
    timings: list[Timing] = field(default_factory=list)
    _doubted: float = -np.inf  # time of the last plan that rests on few effective samples [s]

    def add(self, frame: Frame) -> str | None:
        """Take a frame into account; a line for the log if something happened that a person wants to know."""
        news = self._news(frame)
        if self.first is None:
            self.first = frame.plan
        if frame.plan.fallback is not None:
            self.fallbacks += 1
            self._block(frame)
        elif self.favourite is not None and frame.plan.favourite != self.favourite:
            self.switches += 1
        if frame.plan.fallback is None:
            self.favourite = frame.plan.favourite
            self._decide(frame.plan.decided)
        self._weigh(frame)
        self.min_clearance = min(self.min_clearance, frame.clearance, frame.advance.clearance)
        self.plan_seconds.append(frame.plan_seconds)
        if frame.timing is None:
            self.misses += frame.plan_seconds > self.period
        else:
            self.misses += frame.timing.missed
            self.timings.append(frame.timing)
        self.last = frame
        return news

    def _block(self, frame: Frame) -> None:
        """Take note of a period without a way."""
        if self.last is None or self.last.plan.fallback is None:
            self.blocked.append((frame.time, frame.end_time))
        else:
            self.blocked[-1] = (self.blocked[-1][0], frame.end_time)

    def _decide(self, name: str | None) -> None:
        """Take note of a class that has nearly all the weight; None where none has."""
        if name is not None:
            self.reversals += self.decided not in (None, name)
            self.decided = name

    def _weigh(self, frame: Frame) -> None:
        """Take note of how many effective samples the plan rests on."""
        estimate = frame.plan.estimate
        if estimate is None:
            return
        if self.weakest is None or estimate.ess < self.weakest[0]:
            self.weakest = (estimate.ess, frame.time)
        if estimate.doubtful:
            self.doubtful += 1
            self._doubted = frame.time

    def _news(self, frame: Frame) -> str | None:
        news = []
        before = None if self.last is None else self.last.plan.fallback
        favourite, estimate = frame.plan.favourite, frame.plan.estimate
        if frame.plan.fallback is not None and before is None:
            news.append(
                f"blocked at {frame.time:.2f} s: {frame.plan.fallback}; {BRAKING if frame.plan.stops else GOING}"
            )
        elif frame.plan.fallback is None and before is not None:
            news.append(f"a way at {frame.time:.2f} s, after {frame.time - self.blocked[-1][0]:.2f} s: going on")
        if estimate is not None and estimate.doubtful and frame.time - self._doubted >= STRETCH:
            news.append(f"{estimate.ess:.1f} effective samples at {frame.time:.2f} s: the control is a guess")
        if frame.plan.fallback is None and self.favourite not in (None, favourite):
            news.append(f"class {title(self.favourite or OTHER)} -> {title(favourite or OTHER)} at {frame.time:.2f} s")
        if frame.outcome is not None:
            news.append(f"{frame.outcome.name.lower()} at {frame.end_time:.2f} s")
        return "; ".join(news) or None

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run; TIMEOUT if it has not ended."""
        return Outcome.TIMEOUT if self.last is None or self.last.outcome is None else self.last.outcome

    def drive(self) -> DriveResult:
        """The figures of the drive so far."""
        assert self.last is not None, "a drive has at least one frame"
        assert self.first is not None
        milliseconds = 1e3 * np.array(self.plan_seconds)
        estimate, (ess, when) = self.first.estimate, self.weakest or (None, None)
        return DriveResult(
            outcome=self.outcome.name.lower(),
            time=self.last.end_time,
            cost=self.last.cost,
            path_length=self.last.length,
            noisy_path_length=self.last.noisy_length,
            steps=self.last.step + 1,
            vertices=self.last.vertices,
            min_clearance=self.min_clearance,
            value_estimate=self.first.exact if estimate is None else estimate.value,
            executed_class=self._executed_class(),
            class_switches=self.switches,
            class_reversals=self.reversals,
            fallbacks=self.fallbacks,
            blocked_time=sum(end - begin for begin, end in self.blocked),
            blocked=self.blocked,
            doubtful_plans=self.doubtful,
            least_ess=ess,
            least_ess_time=when,
            step_ms={
                "median": float(np.median(milliseconds)),
                "p95": float(np.percentile(milliseconds, 95)),
                "max": float(milliseconds.max()),
            },
            deadline_misses=self.misses,
            real_time=figures(self.timings, self.period) if self.timings else None,
        )

    def _executed_class(self) -> str | None:
        """The name of the driven path's class; None unless the goal was reached."""
        if self.last is None or self.outcome is not Outcome.GOAL:
            return None
        space = self.last.plan.space
        return class_id(self.last.driven_class, None if space is None else space.homology.named)

    def result(self) -> dict[str, Any]:
        """The figures of the drive under the names of the public JSON (SI units)."""
        return self.drive().json()
