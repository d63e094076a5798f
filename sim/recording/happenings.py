"""What happens on the way besides what the drive itself tells: classes that come and go, and close passages."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sim.drawing.colors import title
from sim.recording.step_row import Row

CLOSE, APART = 0.5, 2.0  # a passage is close below this share of the robot's radius, and over above this multiple of it
GONE = 0.5  # classes that are away for no longer than this are not told of [s]
NAMED = 4  # classes named in one line at most


class Happenings:
    """Watches the steps of a drive.

    Args:
        radius: of the robot [m].
        nearest: what is nearest to the robot at a step, in words.
        said: a class in words.
    """

    def __init__(self, radius: float, nearest: Callable[[Row], str], said: Callable[[str], str]) -> None:
        self._close, self._nearest, self._said = CLOSE * radius, nearest, said
        self._known: set[str] = set()  # classes that are there, or were until a moment ago
        self._ever: set[str] = set()
        self._seen: dict[str, float] = {}  # when each was seen last [s]
        self._passage: Row | None = None  # the closest step of a passage that goes on
        self._begun = False

    def add(self, row: Row) -> list[tuple[Row, str]]:
        """Take a step in; what is to be told, each at the step that it is about."""
        return [*((row, text) for text in self._classes(row)), *self._passages(row)]

    def _classes(self, row: Row) -> list[str]:
        if not row.ids:
            return []
        for name in row.ids:
            self._seen[name] = row.time
        here = set(row.ids)
        gained = [name for name in row.ids if name not in self._known]
        lost = sorted(name for name in self._known - here if row.time - self._seen[name] > GONE)
        self._known = (self._known | here) - set(lost)
        again = [name for name in gained if name in self._ever]
        new = [name for name in gained if name not in self._ever]
        self._ever |= here
        if not self._begun:
            self._begun = True
            return [f"at first {self._counted(row.ids)}"]
        told = (("new", new), ("back", again), ("without a path for now", lost))
        return [f"{what}: {self._counted(names)}" for what, names in told if names]

    def _passages(self, row: Row) -> list[tuple[Row, str]]:
        if row.clearance < self._close and (self._passage is None or row.clearance < self._passage.clearance):
            self._passage = row
        over = self._passage is not None and (row.clearance > APART * self._close or row.outcome is not None)
        if not over or self._passage is None:
            return []
        closest, self._passage = self._passage, None
        return [(closest, f"passes {self._nearest(closest)} with {100 * max(0.0, closest.clearance):.1f} cm to spare")]

    def _counted(self, names: Sequence[str]) -> str:
        if len(names) == 1:
            return f"class {title(names[0])} ({self._said(names[0])})"
        shown = "; ".join(f"{title(name)} ({self._said(name)})" for name in names[:NAMED])
        more = f"; and {len(names) - NAMED} more" if len(names) > NAMED else ""
        return f"{len(names)} classes: {shown}{more}"
