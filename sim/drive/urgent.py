"""Work that a clock waits for, and work that gives way to it: threads of a process share one interpreter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event

LONGEST = 0.1  # what gives way goes on after this time in any case, lest it never end [s]


class Urgent:
    """Whether something is made right now that a clock waits for.

    Attributes:
        clocked: whether a drive runs against the clock, after which there will be more time.
    """

    def __init__(self) -> None:
        self.clocked = False
        self._idle = Event()
        self._idle.set()

    @contextmanager
    def drive(self) -> Iterator[None]:
        """A drive runs against the clock meanwhile."""
        self.clocked = True
        try:
            yield
        finally:
            self.clocked = False

    @contextmanager
    def work(self) -> Iterator[None]:
        """Everything else gives way meanwhile."""
        self._idle.clear()
        try:
            yield
        finally:
            self._idle.set()

    def give_way(self) -> None:
        """Return when nothing is urgent, or after LONGEST."""
        self._idle.wait(LONGEST)


URGENT = Urgent()  # the interpreter is one for all, too
