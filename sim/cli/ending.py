"""Ending of a command: with a status and at most one line, whatever stops it and wherever it is then.

Signals are heeded from the first line of `main` on, so this module imports next to nothing.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
import time
from _thread import interrupt_main, start_new_thread
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from pirrht.errors import PirrhtError, printable

BAD_INPUT, BY_SIGNAL = 2, 128  # exit statuses; a signal's number is added to the second
AGAIN = 0.1  # after which an interruption that some callback swallowed is delivered once more [s]
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}
_swallowed: list[int] = []  # signals that callbacks of this command have kept to themselves
_told: list[str] = []  # lines of this command


class Stopped(SystemExit):
    """A signal ends the command: context managers clean up while it unwinds."""

    def __init__(self, number: int) -> None:
        super().__init__(BY_SIGNAL + number)
        self.number = number


def ended(command: Callable[[], int], *, process: bool = False) -> int:
    """Run a command; its exit status, 2 for bad input and what the system refuses, 128 + n for signal n.

    Args:
        process: this process is the command's own, so that nobody heeds signals after it.
    """
    status: int = signal.SIGINT + BY_SIGNAL
    try:
        with _signals(), _swallowed_again():
            if process:
                _any_name_prints()
            status = _status(command)
            if process:
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left cannot be done better by a traceback
    except (KeyboardInterrupt, Stopped) as stop:  # a second one, while the first was dealt with
        number = stop.number if isinstance(stop, Stopped) else signal.SIGINT
        status = BY_SIGNAL + number
        if not _told:
            tell(WORDS[signal.Signals(number).name])
    for stream in (sys.stdout, sys.stderr) if process else ():  # else the interpreter tries again, and reports that
        _discard(stream)
    return status


@contextmanager
def at_once() -> Iterator[None]:
    """Signals end the process without unwinding: for imports, of which C code catches and prints what interrupts it."""
    numbers = [number for number in _numbers() if callable(signal.getsignal(number))]

    def leave(number: int, _: FrameType | None) -> None:
        tell(WORDS[signal.Signals(number).name])
        os._exit(BY_SIGNAL + number)

    before = {number: signal.signal(number, leave) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def tell(line: str) -> None:
    """One line on standard error, if anyone listens."""
    text = f"pirrht: {printable(line)}\n"  # names of files need not be text
    with suppress(OSError, ValueError, AttributeError):  # AttributeError: closed from the start
        sys.stderr.write(text)
        sys.stderr.flush()
    _told.append(line)


def _status(command: Callable[[], int]) -> int:
    try:
        return _flushed(command)
    except PirrhtError as error:
        tell(str(error))
        return BAD_INPUT
    except KeyboardInterrupt:
        tell(WORDS["SIGINT"])
        return BY_SIGNAL + signal.SIGINT
    except Stopped as stop:
        tell(WORDS[signal.Signals(stop.number).name])
        return BY_SIGNAL + stop.number
    except MemoryError:
        tell("there is not enough memory; ask for less (--vertices, --samples, --classes) or close other programs")
        return BAD_INPUT
    except OSError as error:
        number = _unwound(error)
        if number is None:
            return _refused(error)
        tell(WORDS[signal.Signals(number).name])
        return BY_SIGNAL + number
    except Exception as error:
        if not _swallowed:
            return _blamed(error)
        tell(WORDS[signal.Signals(_swallowed[0]).name])  # what a callback was kept from doing is missed now
        return BY_SIGNAL + _swallowed[0]


def _unwound(error: BaseException | None) -> int | None:
    """The signal that was unwinding when an error came up; None if there was none."""
    while error is not None and not isinstance(error, KeyboardInterrupt | Stopped):
        error = error.__context__
    return error.number if isinstance(error, Stopped) else signal.SIGINT if error is not None else None


def _blamed(error: Exception) -> int:
    """The status of an error in somebody's own system, told in a line; others are ours and are raised again."""
    systems = sys.modules.get("sim.system_import")
    told = None if systems is None else systems.blamed(error)
    if told is None:
        raise error
    tell(told)
    return BAD_INPUT


def _flushed(command: Callable[[], int]) -> int:
    """A command's status once all that it said has been taken; SystemExit is that of --help."""
    leave = None
    try:
        status = command()
    except SystemExit as exit:
        if isinstance(exit, Stopped):
            raise
        leave, status = exit, 0
    if sys.stdout is not None:
        sys.stdout.flush()
    if leave is not None:
        raise leave
    return status


def _refused(error: OSError) -> int:
    """The status where the system refused something: a reader who has gone is content, all else is one line."""
    gone = isinstance(error, BrokenPipeError) and _reader_gone()
    _discard(sys.stdout)
    if gone:
        return 0
    tell(f"{error.filename or 'standard output'}: {error.strerror or error}")
    return BAD_INPUT


def _reader_gone() -> bool:
    """Return whether standard output is a pipe that nobody reads."""
    if not hasattr(select, "poll"):
        return True
    watch = select.poll()
    try:
        watch.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):
        return True
    return any(events & select.POLLERR for _, events in watch.poll(0))


def _discard(stream: Any) -> None:
    """Throw away what is left in a stream that cannot be written, so that the interpreter does not try again."""
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


def _any_name_prints() -> None:
    """File names that are no UTF-8 are shown by their bytes; a stream that was closed takes everything."""
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - it stays open as long as the process


def _waits(number: int) -> bool:
    """Return whether kernels are just being made or loaded, so that a signal comes again a little later."""
    compiled = sys.modules.get("pirrht.jit.patches")
    return compiled is not None and bool(compiled.waits(number))


def _deliver(number: int) -> None:
    time.sleep(AGAIN)
    if _swallowed:  # unless the command has ended meanwhile
        interrupt_main(signal.Signals(number))


def _numbers() -> list[signal.Signals]:
    return [getattr(signal, name) for name in WORDS if hasattr(signal, name)]


@contextmanager
def _signals() -> Iterator[None]:
    """SIGTERM and SIGHUP unwind as Ctrl-C does; whoever ignores or heeds them already goes on doing so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    owner = os.getpid()
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, _: FrameType | None) -> None:
        if os.getpid() != owner:  # a forked process that has this handler from its parent
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        elif not _waits(number):
            raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)

    free = [number for number in _numbers()[1:] if signal.getsignal(number) is signal.SIG_DFL]
    mine = [signal.SIGINT] if before in (signal.SIG_DFL, signal.default_int_handler) else []
    for number in mine + free:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number in free:
            signal.signal(number, signal.SIG_DFL)
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)


@contextmanager
def _swallowed_again() -> Iterator[None]:
    """Callbacks and finalizers swallow interruptions, which Python then prints; here they are delivered once more."""
    before = sys.unraisablehook

    def hook(unraisable: Any) -> None:
        stop = unraisable.exc_value
        if not isinstance(stop, (KeyboardInterrupt, Stopped)):
            before(unraisable)
            return
        number = stop.number if isinstance(stop, Stopped) else signal.SIGINT
        _swallowed.append(number)
        start_new_thread(_deliver, (number,))

    _swallowed.clear()
    _told.clear()
    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        _swallowed.clear()
