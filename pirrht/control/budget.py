"""Time budget of a plan: what is left of its time, and what there is time for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf

from pirrht.control.methods import TUNING, ControlTuning


class TimeBudget:
    """Time that one plan may take.

    Args:
        left: returns the time left for sampling [s]; None: it is unlimited.

    Attributes:
        whole: time when the plan began [s].
    """

    def __init__(self, left: Callable[[], float] | None = None, tuning: ControlTuning = TUNING) -> None:
        self._left, self._tuning = left, tuning
        self.whole = inf if left is None else left()

    @property
    def left(self) -> Callable[[], float] | None:
        """Clock of the time left for sampling [s]; None: it is unlimited."""
        return self._left

    def short(self) -> bool:
        """Check that little time is left."""
        return self._left is not None and self._left() < self._tuning.short * self.whole

    @property
    def enough(self) -> Callable[[int], bool] | None:
        """Check that a tree of so many vertices must do for lack of time; None: growth has no time limit."""
        if (left := self._left) is None:
            return None
        t, whole = self._tuning, self.whole
        return lambda vertices: left() < whole * (t.regrown if vertices >= t.few_vertices else t.short)

    def most_classes(self, recent: Sequence[tuple[int, float]]) -> int | None:
        """Return the number of classes, cheapest first, that a plan has time for; None: all.

        Args:
            recent: numbers of classes of the last plans, and the time until they sampled [s].
        """
        if self._left is None or not recent:
            return None
        t = self._tuning
        time = t.before_samples * self._left() * (t.first_share if len(recent) == 1 else 1.0)
        return max(1, int(min(n * (1.0 + (time / taken - 1.0) / t.per_class) for n, taken in recent)))

    def noted(self, classes: int, recent: Sequence[tuple[int, float]]) -> list[tuple[int, float]]:
        """Add a plan of so many classes that is about to sample to the recent ones."""
        if self._left is None:
            return [*recent]
        taken = max(self.whole - self._left(), 1e-6)  # clocks may stop
        return [*recent, (max(classes, 1), taken)][-self._tuning.recent :]
