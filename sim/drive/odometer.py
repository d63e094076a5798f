"""What a drive has come to, period by period, and when its time is up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.freespace import FreeSpace
from pirrht.geometry.crowd import Crowd
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.steering.in_time import homology_of
from pirrht.topology.driven import Driven, driven
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from sim.drive.executor import Advance
from sim.drive.length import Length
from sim.drive.realtime_timing import Timing

GRACE = 1e-9  # by which sums of periods may miss the time [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One control period: where the robot was, what was planned there and what came of it."""

    step: int  # number of the period, from 0
    time: float  # simulated time at its start [s]
    plan: Plan
    advance: Advance
    outcome: Outcome | None  # how the drive ended in this period, TIMEOUT included; None while it goes on
    cost: float  # integral of q + u'Ru/2 up to the end of this period
    length: float  # driven up to there, without the path's noise [m] (`sim.drive.length`)
    noisy_length: float  # with it: grows with the number of physics steps [m]
    clearance: float  # at the start of the period, from what stands and what moves [m]
    driven_class: tuple[int, ...]  # class of the path up to the end of the period, completed straight to the goal
    plan_seconds: float  # wall time the plan took [s]
    vertices: int = 0  # of the tree that the plan was made with
    timing: Timing | None = None  # of real-time drives only

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


class Odometer:
    """Adds up time, cost, length and driven class of a drive from x (n,), and knows when its time is up.

    Args:
        max_time: of the drive [s].
        clearance: free distance among what stands at a state (n,) [m]; None: that of the space.
        homology: tells classes of drives apart; None: that of the problem.
        time: when it starts, on the clock of bodies that move [s].
    """

    def __init__(
        self,
        problem: Problem,
        space: FreeSpace,
        x: Array,
        max_time: float,
        clearance: Callable[[Array], float] | None = None,
        *,
        homology: Homology | TimedHomology | None = None,
        time: float = 0.0,
    ) -> None:
        self.step, self.time, self.cost = 0, time, 0.0
        homology = homology_of(problem, space) if homology is None else homology
        self.length = Length(problem, x)
        self._driven, self._max_time = driven(homology, x, time), max_time
        self._clearance = clearance or space.clearance
        scene = space.scene
        self._crowd = Crowd(scene.movers, scene.footprint) if scene.movers else None

    def enter(self, space: FreeSpace) -> None:
        """Continue among other static obstacles, to the same goal (`Controller.update`)."""
        if isinstance(self._driven, Driven):
            self._driven.enter(space.homology)
        self._clearance = space.clearance

    def frame(
        self, plan: Plan, advance: Advance, *, seconds: float, vertices: int = 0, timing: Timing | None = None
    ) -> Frame:
        """Take the next period into account, of which the plan took `seconds` [s] of wall time to make."""
        count = len(advance.states)
        self.cost += advance.cost
        self.length.add(advance.states, advance.time / max(1, count), advance.length)
        if count:
            self._driven.observe(advance.states, self.time + advance.time)
        frame = Frame(
            step=self.step,
            time=self.time,
            plan=plan,
            advance=advance,
            outcome=ending(advance, self.time, self._max_time),
            cost=self.cost,
            length=self.length.total,
            noisy_length=self.length.noisy,
            clearance=self._free(plan.state),
            driven_class=self._driven.winding(),
            plan_seconds=seconds,
            vertices=vertices,
            timing=timing,
        )
        self.step, self.time = self.step + 1, frame.end_time
        return frame

    def _free(self, x: Array) -> float:
        """Free distance at x (n,) now [m]."""
        standing = self._clearance(x)
        return standing if self._crowd is None else min(standing, self._crowd.clearance(x[:2], self.time))


def ending(advance: Advance, begun: float, max_time: float) -> Outcome | None:
    """How a drive ends in a period that began at `begun` [s], TIMEOUT once it has lasted `max_time` [s]; None: not."""
    late = advance.outcome is None and begun + advance.time >= max_time - GRACE
    return Outcome.TIMEOUT if late else advance.outcome
