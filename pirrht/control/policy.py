"""Who decides during a drive, and what every policy remembers of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.topology.driven import Driven
from pirrht.tree.homology_tree import HomologyTree


class Drive:
    """A drive so far: its path, which gives classes their names, and the time since plans were made."""

    def __init__(self, space: FreeSpace, x: Array) -> None:
        self.path = Driven(space.homology, x)
        self.since_plan = 0.0  # [s]
        self.since_estimate = 0.0  # since the last plan that samples told anything [s]
        self.time = 0.0  # of the drive, which is that of bodies that move [s]

    def passed(self, duration: float) -> None:
        """Let time [s] pass."""
        self.since_plan += duration
        self.since_estimate += duration
        self.time += duration


class Policy(ABC):
    """A feedback law that plans anew as it drives: `Controller`, `Mppi` or `Optimal`."""

    problem: Problem
    space: FreeSpace
    tree: HomologyTree | None = None  # None: it needs none
    drive: Drive

    @abstractmethod
    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,); `left` tells the time left for sampling [s], where that is limited."""

    def begin(self, x: Array) -> None:
        """Forget the drive so far; a new one starts at x (n,)."""
        self.drive = Drive(self.space, x)

    def observe(self, states: Array, duration: float) -> None:
        """Take note of the states (k, n) just driven through and the time it took [s]."""
        self.drive.path.observe(states)
        self.drive.passed(duration)

    def expect(self, states: Array, duration: float) -> None:
        """Suppose that the robot will drive through the states (k, n) next; `duration` [s] since the last plan's start.

        The next plan is made for the end of them. What is observed afterwards takes their place, at no duration.
        """
        self.drive.path.expect(states)
        self.drive.passed(duration)

    def driven_class(self) -> tuple[int, ...]:
        """Class (M,) of the driven path, completed by the straight line to the goal point [turns]."""
        return self.drive.path.winding()
