"""The path driven so far, and which class it makes of what is still to come."""

from __future__ import annotations

import numpy as np

from pirrht.arrays import Array
from pirrht.topology.homology import Homology, integers


class Driven:
    """A drive that started at x (n,), whose turns (M,) are kept as it goes on."""

    def __init__(self, homology: Homology, x: Array) -> None:
        self._homology = homology
        self._start = homology.straight(x[None, :2])[0]
        self._turns = np.zeros(homology.M)
        self._last = np.array(x[:2], dtype=float)
        self._sure: tuple[Array, Array] | None = None  # turns and position before what is only expected

    def observe(self, states: Array) -> None:
        """Take note of the states (k, n), the first two [m], just driven through; they replace what was expected."""
        if self._sure is not None:
            (self._turns, self._last), self._sure = self._sure, None
        self._turns = self._turns + self._homology.turns(np.vstack([self._last, states[:, :2]]))
        self._last = np.array(states[-1, :2])

    def expect(self, states: Array) -> None:
        """Suppose that the robot drives through the states (k, n) next, positions [m]; replaces what was expected."""
        known = (self._turns, self._last) if self._sure is None else self._sure
        self.observe(states)
        self._sure = known

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the straight line to the goal point."""
        here = self._homology.straight(self._last[None, :])[0]
        return integers(self._turns + here - self._start)
