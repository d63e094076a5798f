"""Changes of numba's behaviour: signals wait for LLVM, names of code differ between processes, types are remembered.

An exception that breaks into LLVM while it makes or loads machine code leaves that in pieces, and a crash later.
"""

import gc
import os
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from secrets import randbits
from signal import Signals
from typing import Any

from numba import types
from numba.core import event
from numba.core.bytecode import FunctionIdentity
from numba.core.types.functions import BaseFunction

VALUES = (types.Number, types.Boolean, types.Array, types.BaseTuple)
BITS = 48  # among a thousand processes two share a count with a chance of one in a million
LOWERING = "native_lowering"  # numba's pass that hands a function to LLVM; of the largest kernel it takes some seconds
_at_work: list[None] = []  # appending and popping are atomic
_waiting: list[int] = []


def waits(number: int) -> bool:
    """Return whether a signal has to wait; then it comes again as soon as LLVM is done."""
    if _at_work:
        _waiting.append(number)
    return bool(_at_work)


class _Unbroken(event.Listener):  # type: ignore[misc]
    """Lets signals wait during work: as a context, and as a listener to numba's passes."""

    def __enter__(self) -> None:
        _at_work.append(None)

    def __exit__(self, *_: object) -> None:
        _at_work.pop()
        if not _at_work and _waiting:
            numbers, _waiting[:] = _waiting[-1:], []  # first, since work of another thread may make it wait again
            for number in numbers:  # none, where another thread ended its work at the same moment
                interrupt_main(Signals(number))

    def on_start(self, happening: Any) -> None:
        if happening.data["name"].startswith(LOWERING):
            self.__enter__()

    def on_end(self, happening: Any) -> None:
        if happening.data["name"].startswith(LOWERING):
            self.__exit__()


unbroken = _Unbroken()
event.register("numba:run_pass", unbroken)


def count_from_chance() -> None:
    """Let this process count what it compiles from a random number, which numba puts into the names of code.

    Else the linker would mistake functions of numba, compiled by two processes that count alike, for each other.
    """
    FunctionIdentity._unique_ids = count(randbits(BITS))


count_from_chance()
if hasattr(os, "register_at_fork"):  # not on Windows, where there is no fork
    os.register_at_fork(after_in_child=count_from_chance)


def remember_types() -> None:
    """Let numba search once for the templates of an operation: that takes a fifth of the time that kernels compile."""
    known: dict[Any, Any] = {}
    plain = BaseFunction.get_call_type

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(kind, VALUES) for kind in args):
            return plain(self, context, args, kws)
        return known.get((self, args)) or known.setdefault((self, args), plain(self, context, args, kws))

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]


@contextmanager
def without_garbage() -> Iterator[None]:
    """Collect no garbage meanwhile."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
