"""How files are refused: in one line that names the file and all that is wrong, each with its remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import SceneError
from sim.mjcf.limits import FARTHEST

SHOWN = 6  # names or faults in a line
T = TypeVar("T")


@contextmanager
def prefixed(words: str) -> Iterator[None]:
    """Put words in front of the message of a SceneError."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{words}{str(error).removeprefix(words)}") from None


class Faults(list[str]):
    """Collects what is wrong with a file, to be refused at once."""

    def of(self, read: Callable[..., T], *arguments: object) -> T | None:
        """Return what `read` returns for arguments; None, and its words are kept, if it raises a SceneError."""
        try:
            return read(*arguments)
        except SceneError as error:
            self.append(str(error))
            return None

    def refuse(self) -> None:
        """Raise a SceneError if anything was wrong."""
        if self:
            more = f"; and {len(self) - SHOWN} more" if len(self) > SHOWN else ""
            raise SceneError("; also, ".join(self[:SHOWN]) + more)


def listed(names: Sequence[str], most: int = SHOWN) -> str:
    """Join names by commas, each in one line, not all of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(" ".join(name.split()) for name in names[:most]) + more


def refuse_far(label: str, *numbers: Array) -> None:
    """Refuse places and sizes [m] that are no numbers, or larger than any scene's."""
    values = np.concatenate([np.asarray(one, dtype=float).ravel() for one in numbers])
    wrong = values[~(np.abs(values) <= FARTHEST)]
    if len(wrong):
        raise SceneError(f"{label} has a place or size of {wrong[0]:g} m; write at most {FARTHEST:g} m")
