"""Signals wait while LLVM makes or loads machine code: what breaks into that leaves it in pieces, and a crash later."""

from __future__ import annotations

from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from signal import Signals
from typing import Any

from numba.core import event

LOWERING = "native_lowering"  # numba's pass that hands a function to LLVM; of the largest kernel it takes some seconds
_at_work: list[str] = []  # appending and popping are atomic
_waiting: list[int] = []


def waits(number: int) -> bool:
    """Whether a signal has to wait; then it comes again as soon as LLVM is done."""
    if _at_work:
        _waiting.append(number)
    return bool(_at_work)


@contextmanager
def unbroken(what: str) -> Iterator[None]:
    """Signals wait meanwhile."""
    _begin(what)
    try:
        yield
    finally:
        _end()


def _begin(what: str) -> None:
    _at_work.append(what)


def _end() -> None:
    _at_work.pop()
    if not _at_work and _waiting:
        numbers, _waiting[:] = _waiting[-1:], []  # before it is heeded: work of another thread may make it wait again
        for number in numbers:  # none, where another thread ended its work at the same moment
            interrupt_main(Signals(number))


class _Passes(event.Listener):  # type: ignore[misc]
    def on_start(self, happening: Any) -> None:
        if _lowers(happening):
            _begin(LOWERING)

    def on_end(self, happening: Any) -> None:
        if _lowers(happening):
            _end()


def _lowers(happening: Any) -> bool:
    return str(happening.data["name"]).split(" ")[0] == LOWERING  # behind it stands the function


event.register("numba:run_pass", _Passes())
