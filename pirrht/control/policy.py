"""Interface of all policies, the record of their drive, and the time budget of a plan."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.prediction import Prediction, Predictor
from pirrht.errors import OptionError
from pirrht.freespace import FreeSpace
from pirrht.geometry.motion import Mover
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.topology.driven import Driven
from pirrht.topology.homology import Homology

PRESSED = 0.3  # share of the time for sampling that is left when time is short
GROWN, FEW = 0.6, 100  # share left when a tree that had to be regrown is kept if it has so many vertices
SPENT = 0.6  # share for what classes take before they are sampled
EACH = 0.5  # share of a plan's time until then that is proportional to the number of its classes
ALONE = 0.5  # share of the time that is counted on when only the first plan is known: nothing ran next to it
RECENT = 5  # plans that the number of classes is predicted by

Left = Callable[[], float]  # time left for sampling [s]


def pressed_of(left: Left | None) -> Callable[[], bool]:
    """Return whether time is short, measured by the time left now."""
    if left is None:
        return lambda: False
    least = PRESSED * left()
    return lambda: left() < least


def enough_of(left: Left | None) -> Callable[[int], bool] | None:
    """Return whether a tree of so many vertices is kept as it is; None: it never is."""
    if left is None:
        return None
    whole = left()
    return lambda vertices: left() < whole * (GROWN if vertices >= FEW else PRESSED)


class TimeBudget:
    """Predicts the number of classes that a plan against a clock has time for, by how long the last ones took."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, float]] = deque(maxlen=RECENT)  # classes, and time until they were sampled [s]

    def most(self, left: Left | None) -> int | None:
        """Return the number of classes, cheapest first, that a plan has time for; None: all."""
        if left is None or not self._recent:
            return None
        time = SPENT * left() * (ALONE if len(self._recent) == 1 else 1.0)
        return max(1, int(min(classes * (1.0 + (time / taken - 1.0) / EACH) for classes, taken in self._recent)))

    def note(self, classes: int, taken: float) -> None:
        """Record how long a plan of so many classes took until samples were drawn [s]."""
        self._recent.append((max(classes, 1), max(taken, 1e-6)))


class Drive:
    """A drive so far, from x (n,) at a time [s]: its path, which gives classes their names, and times of plans."""

    def __init__(self, homology: Homology, x: Array, time: float = 0.0) -> None:
        self.path = Driven(homology, x, time)
        self.since_plan = 0.0  # [s]
        self.since_estimate = 0.0  # since the last plan that samples told anything [s]
        self.time = time  # of the drive and of moving obstacles [s]
        self.begun = time  # when it started [s]
        self.asked: Array | None = None  # the state of a plan since which no time has passed, (n,)
        self.known = time  # until when it is not only expected [s]

    def ask(self, x: Array) -> None:
        """Record a plan at x (n,); warn if the robot has moved since the last one and nothing was observed.

        Raises:
            OptionError: x has entries that are no finite numbers.
        """
        if not np.all(np.isfinite(x)):
            raise OptionError(f"the state is {x.tolist()}; all of it must be finite numbers")
        if self.asked is not None and not np.array_equal(x, self.asked):
            warnings.warn(
                f"a plan at ({x[0]:.4g}, {x[1]:.4g}) after one at ({self.asked[0]:.4g}, {self.asked[1]:.4g}), and "
                "nothing was observed in between: call step(x, dt) for each control, or observe(states, dt) after it; "
                "begin(x) if this is another drive",
                RuntimeWarning, stacklevel=3,
            )  # fmt: skip
        self.asked = x

    def passed(self, duration: float) -> None:
        """Let time [s] pass."""
        self.asked = None
        self.since_plan += duration
        self.since_estimate += duration
        self.time += duration


class Policy(ABC):
    """A feedback law that replans as it drives: `Controller`, `Mppi` or `Optimal`."""

    problem: Problem
    space: FreeSpace  # the scene, with its moving obstacles
    homology: Homology  # of references and drives
    tree: HomologyTree | None = None  # None: it needs none
    predict: Predictor | None = None  # None: motions are known
    drive: Drive
    movers: tuple[Mover, ...]  # moving obstacles as the next plan predicts them, on the drive's clock
    _foreseen: Prediction | None = None
    _held: float | None = None  # how long the control of the last step is held [s]

    @abstractmethod
    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); `left` returns the time left for sampling [s], where that is limited."""

    def step(self, x: Array, dt: float) -> Array:
        """Observe the last step, plan at x (n,) and return the control (m,) for the next dt [s].

        Args:
            dt: how long the control will be held, until the next step [s].

        Raises:
            OptionError: dt is not positive.
            NoReference: no class reaches the goal from where the drive begins.

        Examples:
            A loop of your own; `begin(x)` starts another drive:

            >>> while not arrived:  # doctest: +SKIP
            ...     u = controller.step(robot.state, 0.02)
            ...     robot.drive(u, 0.02)
        """
        if not (np.isfinite(dt) and dt > 0):
            raise OptionError(f"dt is {dt:g}; a control is held for a positive number of seconds")
        x = np.asarray(x, dtype=float)
        if self._held is not None:
            self.observe(x[None], self._held)
        plan = self.plan(x)
        self._held = dt
        return plan.control

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the drive so far; a new one starts at x (n,), at a time of the moving obstacles' clock [s]."""
        self.drive = Drive(self.homology, x, time)
        self._foreseen, self.movers, self._held = None, self.space.scene.movers, None
        if self.predict is not None:
            self.predict.begin()

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        """Record the states (k, n) just driven through and the time it took [s].

        Args:
            until: when the last of them was reached [s], if that is over; None: now.
        """
        self.drive.passed(duration)
        self.drive.known = self.drive.time if until is None else until
        self.drive.path.observe(states, self.drive.known - self.since)

    def expect(self, states: Array, duration: float) -> None:
        """Plan for the end of states (k, n) to be driven through next, `duration` [s] after the last plan.

        Observations, of no duration, replace them.
        """
        self.drive.passed(duration)
        self.drive.path.expect(states, self.drive.time - self.since)

    def driven_class(self) -> tuple[int, ...]:
        """Return the class (M,) of the driven path, completed by a straight line to the goal point [turns]."""
        return self.drive.path.winding()

    @property
    def since(self) -> float:
        """Start of the prediction's clock [s]."""
        return 0.0 if self._foreseen is None else self._foreseen.since

    @property
    def now(self) -> float:
        """Time on the prediction's clock [s]."""
        return self.drive.time - self.since

    def _look(self, x: Array, rest: Array | None, enough: Callable[[int], bool] | None = None) -> Prediction | None:
        """Return the prediction at x (n,), if it has changed; the class of a path keeps its name.

        Args:
            rest: the path ahead of x, (k, 3) [m, m, s] on the drive's clock, of a drive under way.
            enough: whether time is too short for a tree of more vertices; None: it never is.
        """
        if self.predict is None:
            return None
        before, after = self._foreseen, self.predict.at(x, self.drive.known, enough)
        if after is before:
            return None
        offset = np.zeros(0)
        if before is not None:
            path = np.array([[*x[:2], self.drive.time]]) if rest is None else rest
            shown = [one.homology.winding(path - [0.0, 0.0, one.since]) for one in (before, after)]
            offset = np.array(self.driven_class()) + shown[0] - shown[1]
        self._foreseen = after
        foretold = after.space.scene.movers
        self.movers = tuple(replace(m, motion=m.motion.after(-after.since)) for m in foretold)
        self.drive.path = Driven(after.homology, x, self.now, offset)
        return after
