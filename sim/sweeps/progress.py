"""How far a sweep is, on a terminal: runs done of those asked for, the share that reached the goal, the time left."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

from tqdm import tqdm

SECOND = 1.0  # how often the line is written anew at least [s]


class Progress:
    """A line on standard error, as a context; nothing where that is no terminal.

    Args:
        asked: number of runs.
        done: records of runs that are there already.
        places: number of trees to grow.
    """

    def __init__(self, asked: int, done: Sequence[Mapping[str, Any]], places: int) -> None:
        self._ended, self._arrived, self._places = 0, 0, places
        self._bar = tqdm(total=asked, initial=len(done), desc="sweep", unit=" runs", disable=None, dynamic_ncols=True)
        for record in done:
            self._count(record)

        self._closed = threading.Event()
        self._clock = threading.Thread(target=self._tick, daemon=True)

    def __enter__(self) -> Progress:
        if not self._bar.disable:
            self.add(None, 0)
            self._clock.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._closed.set()
        if not self._bar.disable:
            self._clock.join()
        self._bar.close()

    def _tick(self) -> None:
        """Let the clock go on while the main thread is at a tree or a run."""
        while not self._closed.wait(SECOND):
            self._bar.refresh()

    def add(self, record: Mapping[str, Any] | None, grown: int) -> None:
        """Take note of a run that has ended, or of none, and of how many trees there have been."""
        if record is not None:
            self._count(record)
        told = [f"goal {self._arrived / self._ended:.0%}"] if self._ended else []
        told += [f"trees {grown}/{self._places}"] if grown < self._places else []
        self._bar.set_postfix_str(", ".join(told), refresh=record is None)  # the clock goes on while nothing ends
        self._bar.update(0 if record is None else 1)

    def say(self, line: str) -> None:
        """A line of its own, terminal or not."""
        self._bar.write(line, sys.stderr)

    def _count(self, record: Mapping[str, Any]) -> None:
        if record["outcome"] is not None:
            self._ended += 1
            self._arrived += record["outcome"] == "goal"
