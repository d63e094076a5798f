"""Follow the class of the path that a run has driven, and is expected to drive."""

import math
from collections.abc import Sequence

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.topology.signature import Signature


class Driven:
    """Class of a run that left x (n,) at a time [s] of the moving obstacles' clock, `offset` (M,) turns before that."""

    def __init__(self, homology: Signature, x: Array, time: float = 0.0, offset: Sequence[int] | Array = ()) -> None:
        whole = np.array(offset, dtype=np.int64) if len(offset) else np.zeros(homology.M, dtype=np.int64)
        self._homology = homology
        self._known = (whole, homology.at(x, time))  # class, and point
        self._now = self._known

    def observe(self, states: Array, until: float = 0.0) -> None:
        """Add the states (k, n), evenly spaced in time until now, `until` [s]; they replace expected ones."""
        self._known = self._now = self._on(states, until)

    def expect(self, states: Array, until: float = 0.0) -> None:
        """Suppose that the robot drives through the states (k, n) next, until a time [s]."""
        self._now = self._on(states, until)

    def _on(self, states: Array, until: float) -> tuple[IntArray, Array]:
        whole, last = self._known
        path = np.vstack(
            [last, self._homology.at(states, np.linspace(last[-1], max(until, last[-1]), len(states) + 1)[1:])]
        )
        return whole + self._homology.along(path), path[-1]

    @property
    def here(self) -> Array:
        """Place of the robot, as far as is known or expected, (2,) in the plane [m]."""
        return self._now[1][:-1]

    def enter(self, homology: Signature) -> None:
        """Continue among other static markers, to the same goal; turns about new ones count from here on.

        Those about a marker that has moved within its obstacle change so that paths about all of it keep their class.
        """
        old = self._homology
        known, last = self._known
        now, here = self._now

        M = min(old.M, homology.M)
        stay = np.flatnonzero(np.all(old.markers[:M] == homology.markers[:M], axis=1))
        since = np.zeros(homology.M, dtype=np.int64)
        whole = homology.along(np.array([last, here]))
        since[stay] = known[stay]
        whole[stay] = now[stay]
        for number in homology.moved:
            one, other = old.markers[number], homology.markers[number]
            since[number] = known[number] - shift(one, other, last, homology.goal)
            whole[number] = now[number] - shift(one, other, here, homology.goal)

        self._homology = homology
        self._known = (since, last)
        self._now = (whole, here)

    def winding(self) -> tuple[int, ...]:
        """Class of the driven path, M whole [turns], completed by the base from its end."""
        return tuple(self._now[0].tolist())


def shift(one: Array, other: Array, x: Array, goal: Array) -> int:
    """Return by how many whole turns paths from x to the goal (2,) [m] turn more about another marker than about one.

    They do not pass between both, (2,) [m]: as one moves to the other along a line, the turn of such a path changes by
    that of the directions in which its ends lie.
    """

    def between(a: Array, b: Array) -> float:
        return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]) / (2.0 * math.pi)

    place = x[:2]
    base_change = between(place - one, goal - one) - between(place - other, goal - other)
    return round(base_change + between(goal - one, goal - other) - between(place - one, place - other))
