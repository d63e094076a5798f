"""How much room there was, and whether a step went through something: asked of a clearance as rarely as can be.

Clearance is 1-Lipschitz: around a place that has some there is a disc that is free. FCL is asked only where the last
disc does not tell enough.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, inf

from pirrht.arrays import Array

SHORTEST = 1e-4  # an obstacle of which a step cuts off less than this is only grazed [m]


class Room:
    """The free distances along a drive.

    Args:
        clearance: maps centres (k, 2) to the free distance (k,) [m] of the robot, 0 or less in a collision.
    """

    def __init__(self, clearance: Callable[[Array], Array]) -> None:
        self._clearance = clearance
        self._x = self._y = 0.0
        self._known = -inf  # free distance at (x, y) [m]
        self.least = inf  # since `begin` [m]

    def begin(self) -> None:
        """Forget the least distance."""
        self.least = inf

    def at(self, x: Array) -> float:
        """The free distance at a state x (n,) [m]."""
        self._x, self._y = float(x[0]), float(x[1])
        self._known = float(self._clearance(x[None, :2])[0])
        self.least = min(self.least, self._known)
        return self._known

    def note(self, x: Array) -> None:
        """Take a state x (n,) into account."""
        if self._surely(x) < self.least:
            self.at(x)

    def blocked(self, before: Array, x: Array) -> bool:
        """Whether something is in the way from a free state to another, 2 x (n,), along a straight line."""
        if min(self._surely(before), self._surely(x)) > 0.0:
            return False
        length, end = hypot(x[0] - before[0], x[1] - before[1]), self.at(x)
        if end > length:
            return False
        return end <= 0.0 or self._between(before, self.at(before), x, end, length)

    def _surely(self, x: Array) -> float:
        """What the last disc tells of the free distance at x, a lower bound [m]."""
        return self._known - hypot(x[0] - self._x, x[1] - self._y)

    def _between(self, a: Array, free_a: float, b: Array, free_b: float, length: float) -> bool:
        if free_a + free_b > length or length < SHORTEST:
            return False
        middle = 0.5 * (a + b)
        free = self.at(middle)
        if free <= 0.0:
            return True
        half = 0.5 * length
        return self._between(a, free_a, middle, free, half) or self._between(middle, free, b, free_b, half)
