"""Keep the path driven so far, and the class that it makes of what is still to come."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array
from pirrht.topology.homology import Homology, integers
from pirrht.topology.in_time import TimedHomology


class Driven:
    """A run that started at x (n,), whose turns (M,) are kept as it goes on."""

    def __init__(self, homology: Homology, x: Array) -> None:
        self._homology = homology
        self._start = homology.straight(x[None, :2])[0]
        self._turns = np.zeros(homology.M)
        self._last = np.array(x[:2], dtype=float)
        self._sure: tuple[Array, Array] | None = None  # turns and position before what is only expected

    def observe(self, states: Array, until: float = 0.0) -> None:
        """Add the states (k, n), the first two [m], just driven through; they replace what was expected.

        `until`, the time of the last one [s], has no effect on static markers.
        """
        if self._sure is not None:
            (self._turns, self._last), self._sure = self._sure, None
        self._turns = self._turns + self._homology.turns(np.vstack([self._last, states[:, :2]]))
        self._last = np.array(states[-1, :2])

    def expect(self, states: Array, until: float = 0.0) -> None:
        """Suppose that the robot drives through the states (k, n) next, positions [m]; replaces what was expected."""
        known = (self._turns, self._last) if self._sure is None else self._sure
        self.observe(states)
        self._sure = known

    @property
    def here(self) -> Array:
        """Position of the robot, as far as is known or expected, (2,) [m]."""
        return self._last

    def enter(self, homology: Homology) -> None:
        """Continue among other markers, to the same goal; turns about those that are new count from here on."""
        old = self._homology
        sure, last = (self._turns, self._last) if self._sure is None else self._sure
        M = min(old.M, homology.M)
        stay = np.flatnonzero(np.all(old.markers[:M] == homology.markers[:M], axis=1))
        start, known = homology.straight(last[None])[0], np.zeros(homology.M)
        turns = homology.turns(np.vstack([last, self._last]))
        start[stay], known[stay], turns[stay] = self._start[stay], sure[stay], self._turns[stay]
        if self._sure is not None:
            self._sure = known, last
        self._homology, self._start, self._turns = homology, start, turns

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the straight line to the goal point."""
        here = self._homology.straight(self._last[None, :])[0]
        return integers(self._turns + here - self._start)


class DrivenInTime:
    """A run among moving obstacles that left x (n,) at a time [s] of their clock.

    Args:
        offset: turns (M,) of its class before that.
    """

    def __init__(
        self, homology: TimedHomology, x: Array, time: float, offset: Sequence[int] | Array | None = None
    ) -> None:
        self._standing, self._moving = Driven(homology.standing, x), homology.moving
        self._offset = np.zeros(homology.M) if offset is None else np.asarray(offset)
        self._begun = np.array([x[0], x[1], time])
        self._known = np.zeros(self._moving.J), self._begun  # turns, place and time
        self._now = self._known

    def observe(self, states: Array, until: float) -> None:
        """Add the states (k, n), evenly spaced in time, the last of them now reached, at `until` [s]."""
        self._standing.observe(states)
        self._known = self._now = self._on(states, until)

    def expect(self, states: Array, until: float) -> None:
        """Suppose that the robot drives through the states (k, n) next, until a time [s]."""
        self._standing.expect(states)
        self._now = self._on(states, until)

    def _on(self, states: Array, until: float) -> tuple[Array, Array]:
        turns, last = self._known
        times = np.linspace(last[2], max(until, last[2]), len(states) + 1)[1:]
        path = np.vstack([last, np.column_stack([states[:, :2], times])])
        return turns + self._moving.turns(path), path[-1]

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the base from where it is now."""
        turns, last = self._now
        moving, begun = self._moving, self._begun
        until = max(moving.arrival(begun[:2], begun[2]), moving.arrival(last[:2], last[2]))
        whole = turns + moving.base(last[:2], last[2], until) - moving.base(begun[:2], begun[2], until)
        return integers(self._offset + np.array([*self._standing.winding(), *integers(whole)]))


def driven(homology: Homology | TimedHomology, x: Array, time: float) -> Driven | DrivenInTime:
    """Start to keep the class of a run that leaves x (n,) at a time [s]."""
    return DrivenInTime(homology, x, time) if isinstance(homology, TimedHomology) else Driven(homology, x)
