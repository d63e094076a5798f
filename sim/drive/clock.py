"""The time that real-time drives run against."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Tells the time and lets it pass."""

    def now(self) -> float:
        """Time since some moment [s]."""

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""


class WallClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Time since some moment [s]."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Return when it is `until` [s], at once if that has passed."""
        rest = until - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
