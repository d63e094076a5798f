"""Sums of a run, period by period: time, cost, driven class and length, and when the time is up.

The path of dx = u dt + b dw is infinitely long: the finer it is looked at, the longer it gets. It is therefore measured
by chords over a time tau of driving, and from the square of each chord (over t seconds) goes what noise alone adds to
it across its direction, b^2 t. Noise and control at its natural pace sqrt(2 q / R) carry equally far in lambda / (2 q)
seconds; tau is CHORD times lambda / q. So tau does not depend on physics step or control period, tau -> 0 and the
length becomes that of the path as b -> 0, and where noise does not act on the position (cars) nothing is smoothed.
Noise along the way alone (a rover's) adds nothing to a chord on average: only its own to and fro is smoothed away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.freespace import FreeSpace
from pirrht.geometry.collision import Collision
from pirrht.moving.collision import MovingObstacles
from pirrht.outcome import Outcome
from pirrht.problem import Problem
from pirrht.steering.in_time import homology_of
from pirrht.topology.homology import Driven, Homology
from sim.drive.clock import Timing
from sim.drive.plant import Advance

CHORD = 2.5  # times lambda / q: 0.05 s at the point's b = 0.1, 0.45 s at 0.3
GRACE = 1e-9  # by which sums of periods may miss the time [s]


class Length:
    """The length of a path that goes on, from its start at x (n,).

    Args:
        problem: tells noise and the time of a chord.
    """

    def __init__(self, problem: Problem, x: Array) -> None:
        self._spread, self._smooth = spread(problem, x), not problem.dynamics.noisy_position
        self._time = CHORD * problem.temperature / problem.least_rate
        self._first = self._last = self._begun = (float(x[0]), float(x[1]))  # of the path, so far, of the chord
        self._steps, self._step = 0, 0.0  # of the chord, and their length [s]
        self._chords = 0.0  # of those that are over [m]
        self.noisy = 0.0  # of the path with all its noise [m]

    def add(self, states: Array, step: float, noisy: float) -> None:
        """Go on through states (k, n), `step` seconds apart, over a path of `noisy` metres."""
        self.noisy += noisy
        if not len(states):
            return
        self._last, self._step = (float(states[-1, 0]), float(states[-1, 1])), step
        each, first = max(1, round(self._time / step)), self._steps
        for end in range(each - first, len(states) + 1, each):
            place = (float(states[end - 1, 0]), float(states[end - 1, 1]))
            self._chords += self._chord(place, each)
            self._begun = place
        self._steps = (first + len(states)) % each

    @property
    def total(self) -> float:
        """Of the path without its noise [m]; at least the distance between its ends, at most the noisy length."""
        if self._smooth:
            return self.noisy
        total = self._chords + self._chord(self._last, self._steps)
        return min(self.noisy, max(total, _distance(self._first, self._last)))

    def _chord(self, end: tuple[float, float], steps: int) -> float:
        square = _distance(self._begun, end) ** 2 - self._spread * steps * self._step
        return sqrt(max(0.0, square))


def spread(problem: Problem, x: Array) -> float:
    """Variance per second that noise adds to each coordinate of the position at x (n,) [m^2/s].

    In input form that in the direction in which it adds least, since robots drive in the other.
    """
    dynamics = problem.dynamics
    if not dynamics.noisy_position:
        return 0.0
    B = np.asarray(dynamics.B_c(x))[: 2 - dynamics.n + dynamics.rows]
    return max(0.0, float(np.linalg.eigvalsh(B @ B.T)[0])) if dynamics.input_form else float(np.sum(B**2)) / 2.0


def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    return hypot(b[0] - a[0], b[1] - a[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One control period: where the robot was, what was planned there and what came of it."""

    step: int  # number of the period, from 0
    time: float  # simulated time at its start [s]
    plan: Plan
    advance: Advance
    outcome: Outcome | None  # how the drive ended in this period, TIMEOUT included; None while it goes on
    cost: float  # integral of q + u'Ru/2 up to the end of this period
    length: float  # driven up to there, without the path's noise [m] (`sim.drive.odometer`)
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
        homology: tells classes of drives apart; None: that of the problem.
        time: when it starts, on the clock of bodies that move [s].
        busy: the space's FCL objects, which move when they are asked, are another thread's; it makes its own.
    """

    def __init__(
        self,
        problem: Problem,
        space: FreeSpace,
        x: Array,
        max_time: float,
        *,
        homology: Homology | None = None,
        time: float = 0.0,
        busy: bool = False,
    ) -> None:
        self.step, self.time, self.cost = 0, time, 0.0
        homology = homology_of(problem, space) if homology is None else homology
        self.length = Length(problem, x)
        self._driven, self._max_time = Driven(homology, x, time), max_time
        scene = space.scene
        collision = Collision(scene.world, scene.footprint) if busy else space.collision
        self._clearance: Callable[[Array], Array] = collision.clearance
        self._crowd = MovingObstacles(scene.movers, scene.footprint) if scene.movers else None

    def enter(self, space: FreeSpace) -> None:
        """Continue among other static obstacles, to the same goal (`Controller.update`)."""
        self._driven.enter(space.homology)
        self._clearance = space.collision.clearance

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
        standing = float(self._clearance(x[None, :2])[0])
        return standing if self._crowd is None else min(standing, self._crowd.clearance(x[:2], self.time))


def ending(advance: Advance, begun: float, max_time: float) -> Outcome | None:
    """Judge a period that began at `begun` [s]: TIMEOUT from `max_time` [s] on; None while the run goes on."""
    late = advance.outcome is None and begun + advance.time >= max_time - GRACE
    return Outcome.TIMEOUT if late else advance.outcome
