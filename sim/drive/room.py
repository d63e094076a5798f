"""How much room there was, and whether a step went through something: asked of a clearance as rarely as can be.

Clearance is 1-Lipschitz: around a place that has some there is a disc that is free. FCL is asked only where the last
disc does not tell enough.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, inf

from pirrht.arrays import Array
from pirrht.geometry.crowd import Crowd

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


class RoomAmong:
    """The same where bodies move as well.

    Args:
        standing: among all that stands.
        crowd: what moves.
        now: the time of the drive at the end of the step that is judged [s].
        step: its length [s].
    """

    def __init__(self, standing: Room, crowd: Crowd, now: Callable[[], float], step: float) -> None:
        self._standing, self._crowd, self._now, self._step = standing, crowd, now, step
        self._least = inf

    @property
    def least(self) -> float:
        """The least free distance since `begin` [m]."""
        return min(self._standing.least, self._least)

    def begin(self) -> None:
        """Forget the least distance."""
        self._standing.begin()
        self._least = inf

    def at(self, x: Array) -> float:
        """The free distance at a state x (n,), now [m]."""
        free = self._crowd.clearance(x[:2], self._now())
        self._least = min(self._least, free)
        return min(free, self._standing.at(x))

    def note(self, x: Array) -> None:
        """Take a state x (n,) into account, now."""
        self._standing.note(x)
        if self._crowd.surely(x, self._now()) < self._least:
            self._least = min(self._least, self._crowd.clearance(x[:2], self._now()))

    def blocked(self, before: Array, x: Array) -> bool:
        """Whether something is in the way from a free state to another, 2 x (n,), or comes there in the step."""
        return self._standing.blocked(before, x) or self.met(before, x)

    def met(self, before: Array, x: Array) -> bool:
        """Whether what moves touches a footprint that goes straight from a state to another in the step, 2 x (n,)."""
        now = self._now()
        return self._crowd.meets(before[:2], now - self._step, x[:2], now)

    def way(self, begin: float, end: float) -> float:
        """How far any body moves between two times [s] at most [m]."""
        return self._crowd.way(begin, end)
