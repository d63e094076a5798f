"""How much of a plan is left out when time is short; where there is no limit, nothing ever is."""

from __future__ import annotations

from collections.abc import Callable

PRESSED = 0.3  # of the time for sampling is left when time is short
GROWN = 0.6  # of it is left when a tree that had to be grown anew stays as it is ...
FEW = 100  # ... if it has so many vertices; else when time is short

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
