"""Keep the path driven so far as the class that it makes of the rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.topology.homology import Homology


class Driven:
    """Class of a run that left x (n,) at a time [s] of the moving obstacles' clock.

    Args:
        offset: turns (M,) of its class before that.
    """

    def __init__(self, homology: Homology, x: Array, time: float = 0.0, offset: Sequence[int] | Array = ()) -> None:
        self._homology = homology
        whole = np.array(offset, dtype=np.int64) if len(offset) else np.zeros(homology.M, dtype=np.int64)
        self._known = whole, np.array([x[0], x[1], time])  # class, place and time
        self._now = self._known

    def observe(self, states: Array, until: float = 0.0) -> None:
        """Add the states (k, n), evenly spaced in time, the last of them now reached, at `until` [s].

        The first two numbers of a state are its place [m]. They replace expected ones.
        """
        self._known = self._now = self._on(states, until)

    def expect(self, states: Array, until: float = 0.0) -> None:
        """Suppose that the robot drives through the states (k, n) next, until a time [s]."""
        self._now = self._on(states, until)

    def _on(self, states: Array, until: float) -> tuple[IntArray, Array]:
        whole, last = self._known
        times = np.linspace(last[2], max(until, last[2]), len(states) + 1)[1:]
        path = np.vstack([last, np.column_stack([states[:, :2], times])])
        return whole + self._homology.along(path), path[-1]

    @property
    def here(self) -> Array:
        """Place of the robot, as far as is known or expected, (2,) [m]."""
        return self._now[1][:2]

    def enter(self, homology: Homology) -> None:
        """Continue among other static markers, to the same goal; turns about new ones count from here on."""
        old, (known, last), (now, here) = self._homology, self._known, self._now
        M = min(old.M, homology.M)
        stay = np.flatnonzero(np.all(old.markers[:M] == homology.markers[:M], axis=1))
        since, whole = np.zeros(homology.M, dtype=np.int64), homology.along(np.array([last, here]))
        since[stay], whole[stay] = known[stay], now[stay]
        self._homology, self._known, self._now = homology, (since, last), (whole, here)

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the base from its end."""
        return tuple(self._now[0].tolist())
