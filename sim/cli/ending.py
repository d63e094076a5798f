"""Ending of a command: with a status and at most one line, whatever stops it and wherever it is then.

Signals are heeded from the first line of `main` on, so this module imports next to nothing.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from pirrht.errors import PirrhtError, printable

BAD_INPUT, BY_SIGNAL = 2, 128  # exit statuses; a signal's number is added to the second
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}
_importing: list[bool] = []  # not empty: signals end the process without unwinding
_lines: list[str] = []  # of this command on standard error


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
    try:
        _lines.clear()
        with _signals():
            if process:
                _any_name_prints()
            status = _status(command)
            if process:
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left cannot be done better by a traceback
    except (KeyboardInterrupt, Stopped) as stop:  # a second one, while the first was dealt with
        status = BY_SIGNAL + _number(stop) if _lines else _stopped(_number(stop))
    for stream in (sys.stdout, sys.stderr) if process else ():  # else the interpreter tries again, and reports that
        _discard(stream)
    return status


@contextmanager
def at_once() -> Iterator[None]:
    """Signals end the process without unwinding: for imports, of which C code catches and prints what interrupts it."""
    _importing.append(True)
    try:
        yield
    finally:
        _importing.pop()


def tell(line: str) -> None:
    """One line on standard error, if anyone listens."""
    text = f"pirrht: {printable(line)}\n"  # names of files need not be text
    with suppress(OSError, ValueError, AttributeError):  # AttributeError: closed from the start
        sys.stderr.write(text)
        sys.stderr.flush()
    _lines.append(line)


def _number(stop: BaseException) -> int:
    return stop.number if isinstance(stop, Stopped) else signal.SIGINT


def _stopped(number: int) -> int:
    tell(WORDS[signal.Signals(number).name])
    return BY_SIGNAL + number


def _status(command: Callable[[], int]) -> int:
    try:
        try:
            status: int | SystemExit = command()
        except SystemExit as leave:  # of --help, once its text has been taken
            status = leave
        if isinstance(status, Stopped):
            raise status
        if sys.stdout is not None:
            sys.stdout.flush()
        if isinstance(status, SystemExit):
            raise status
        return status
    except PirrhtError as error:
        line = str(error)
    except (KeyboardInterrupt, Stopped) as stop:
        return _stopped(_number(stop))
    except MemoryError:
        line = "there is not enough memory; ask for less (--vertices, --samples, --classes) or close other programs"
    except OSError as error:
        context: BaseException | None = error
        while context is not None:  # a signal may have been unwinding
            if isinstance(context, KeyboardInterrupt | Stopped):
                return _stopped(_number(context))
            context = context.__context__
        gone = isinstance(error, BrokenPipeError) and _reader_gone()
        _discard(sys.stdout)
        if gone:
            return 0
        line = f"{error.filename or 'standard output'}: {error.strerror or error}"
    except Exception as error:
        systems = sys.modules.get("sim.systems.registry")
        blamed = None if systems is None else systems.blamed(error)
        if blamed is None:  # of no system of the user's, so it is ours
            raise
        line = blamed
    tell(line)
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


@contextmanager
def _signals() -> Iterator[None]:
    """SIGTERM and SIGHUP unwind as Ctrl-C does; whoever ignores or heeds them already goes on doing so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    owner = os.getpid()

    def stop(number: int, _: FrameType | None) -> None:
        patches = sys.modules.get("pirrht.jit.patches")
        if os.getpid() != owner:  # a forked process that has this handler from its parent
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        elif _importing:
            os._exit(_stopped(number))
        elif patches is None or not patches.waits(number):  # else it comes again once a kernel is made or loaded
            raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)

    numbers = [getattr(signal, name) for name in WORDS if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    mine = {n: old for n, old in before.items() if old in (signal.SIG_DFL, signal.default_int_handler)}
    for number in mine:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, old in mine.items():
            if signal.getsignal(number) is not signal.SIG_IGN:  # as `ended` leaves SIGINT
                signal.signal(number, old)
