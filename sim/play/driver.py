"""A policy whose world may change under way: what was built for the new one takes over at the next plan."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.control.policy import Drive, Policy
from pirrht.errors import NoReference, PirrhtError
from pirrht.freespace import FreeSpace
from pirrht.problem import Problem
from pirrht.topology.homology import Homology
from pirrht.topology.in_time import TimedHomology
from pirrht.tree.homology_tree import HomologyTree
from sim.play.builder import Builder, Built


class Live(Policy):
    """Whoever decides now; everything but `plan` is theirs.

    Args:
        built: who decides at first.
        builder: of those that come later.
        tell: takes a line on what could not be planned.
    """

    def __init__(self, built: Built, builder: Builder, tell: Callable[[str], object]) -> None:
        self.built, self.builder, self._tell = built, builder, tell

    @property
    def problem(self) -> Problem:  # type: ignore[override]
        """That of whoever decides."""
        return self.built.driver.problem

    @property
    def space(self) -> FreeSpace:  # type: ignore[override]
        """Theirs."""
        return self.built.driver.space

    @property
    def tree(self) -> HomologyTree | None:  # type: ignore[override]
        """Theirs."""
        return self.built.tree

    @property
    def drive(self) -> Drive:  # type: ignore[override]
        """What they remember."""
        return self.built.driver.drive

    @property
    def path_integral(self) -> Any:
        """Theirs."""
        return self.built.driver.path_integral

    @property
    def homology(self) -> Homology | TimedHomology:  # type: ignore[override]
        """Theirs."""
        return self.built.driver.homology

    def begin(self, x: Array, time: float = 0.0) -> None:
        """Forget the drive so far; a new one starts at x (n,), at a time of the bodies' clock [s]."""
        self.built.driver.begin(x, time)

    def observe(self, states: Array, duration: float, until: float | None = None) -> None:
        """Take note of the states (k, n) just driven through and the time it took [s]; see `Policy.observe`."""
        self.built.driver.observe(states, duration, until)

    def expect(self, states: Array, duration: float) -> None:
        """Suppose that the robot will drive through the states (k, n) next; see `Policy.expect`."""
        self.built.driver.expect(states, duration)

    def driven_class(self) -> tuple[int, ...]:
        """Class (M,) of the path driven since the world last changed [turns]."""
        return self.built.driver.driven_class()

    def plan(self, x: Array, left: Callable[[], float] | None = None) -> Plan:
        """Decide at state x (n,), in a new world if one is ready."""
        ready = self.builder.ready(self.drive.time)
        if isinstance(ready, PirrhtError):
            self._tell(f"{ready}; the drive goes on as planned before")
        elif ready is not None and (plan := self._first(ready, x, left)) is not None:
            self.built = ready
            return plan
        return self.built.driver.plan(x, left)

    def catch_up(self) -> None:
        """Wait for what is being built, and take it.

        Raises:
            SceneError, OptionError: nothing can be planned there.
        """
        ready = self.builder.ready(inf)
        if isinstance(ready, PirrhtError):
            raise ready
        self.built = ready or self.built

    def _first(self, ready: Built, x: Array, left: Callable[[], float] | None) -> Plan | None:
        """The first plan in a new world; None if it has no way to the goal from here."""
        now = self.drive.time
        ready.driver.begin(x, now)
        try:
            return ready.driver.plan(x, left)
        except NoReference as error:
            self._tell(f"{error}; the drive goes on as planned before")
            return None
