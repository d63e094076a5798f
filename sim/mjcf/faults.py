"""What keeps a scene from being read, all of it in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pirrht.errors import SceneError

SHOWN = 6  # faults in a line
T = TypeVar("T")


class Faults:
    """Collects what is wrong with a file, to be refused at once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._found: list[str] = []

    def of(self, read: Callable[..., T], *arguments: object) -> T | None:
        """What `read` returns for arguments; None, and its words are kept, if it raises a SceneError."""
        try:
            return read(*arguments)
        except SceneError as error:
            self._found.append(str(error).removeprefix(f"{self._path}: "))
            return None

    def settle(self) -> None:
        """Refuse the file if anything was wrong.

        Raises:
            SceneError: names all that was, `SHOWN` faults at most.
        """
        more = len(self._found) - SHOWN
        if self._found:
            words = "; also, ".join(self._found[:SHOWN]) + (f"; and {more} more" if more > 0 else "")
            raise SceneError(f"{self._path}: {words}")
