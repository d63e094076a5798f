"""How far a solution has come, for those who wait for it."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]  # is told the share that is done, from 0 to 1


def untold(share: float) -> None:
    """Nobody waits."""
