"""How much of a plan is left out when time is short; where there is no limit, nothing ever is."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

PRESSED = 0.3  # of the time for sampling is left when time is short
GROWN = 0.6  # of it is left when a tree that had to be grown anew stays as it is ...
FEW = 100  # ... if it has so many vertices; else when time is short
SPENT = 0.6  # of it is for what classes take before they are sampled
EACH = 0.5  # of what a plan takes until then is in proportion to the number of its classes
ALONE = 0.5  # of the time is reckoned with when one plan is known, the first: nothing ran beside it
RECENT = 5  # plans by which one knows how many there is time for

Left = Callable[[], float]  # time left for sampling [s]


def pressed_of(left: Left | None) -> Callable[[], bool]:
    """What tells whether time is short, reckoned by the time that is left now."""
    if left is None:
        return lambda: False
    least = PRESSED * left()
    return lambda: left() < least


def enough_of(left: Left | None) -> Callable[[int], bool] | None:
    """What tells whether a tree of so many vertices stays as it is; None: it never does."""
    if left is None:
        return None
    whole = left()
    return lambda vertices: left() < whole * (GROWN if vertices >= FEW else PRESSED)


class Pace:
    """How many classes there is time for in a plan against a clock, by how long the last ones took."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, float]] = deque(maxlen=RECENT)  # classes, and until they were sampled [s]

    def most(self, left: Left | None) -> int | None:
        """Classes at most that a plan has time for, the cheapest ones; None: all."""
        if left is None or not self._recent:
            return None
        time = SPENT * left() * (ALONE if len(self._recent) == 1 else 1.0)
        return max(1, int(min(classes * (1.0 + (time / taken - 1.0) / EACH) for classes, taken in self._recent)))

    def note(self, classes: int, taken: float) -> None:
        """How long a plan of so many classes took until samples were drawn [s]."""
        self._recent.append((max(classes, 1), max(taken, 1e-6)))
