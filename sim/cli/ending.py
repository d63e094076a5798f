"""Ending of a command: with a status and at most one line, whatever stops it and wherever it is then.

This module is there before any slow one, so it imports next to nothing.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from pirrht.errors import PirrhtError, printable

BAD_INPUT, BY_SIGNAL = 2, 128  # exit statuses; a signal's number is added to the second
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal was closed"}
_heard: list[int] = []  # signals that unwind the command


class Stopped(SystemExit):
    """A signal ends the command: context managers clean up while it unwinds."""


def ended(command: Callable[[], int], *, process: bool = False) -> int:
    """Run a command; its exit status, 2 for bad input and what the system refuses, 128 + n for signal n.

    Args:
        process: this process is the command's own.
    """
    _heard.clear()
    if process:
        _any_name_prints()
    try:
        try:
            status = command()
        except SystemExit:  # of --help, once its text has been taken
            _flush()
            raise
        _flush()
    except BaseException as error:
        if (explained := _explained(error)) is None:
            raise
        status, line = explained
        with suppress(OSError, ValueError, AttributeError):  # nobody listens; AttributeError: closed from the start
            sys.stderr.write(f"pirrht: {printable(line)}\n" if line else "")
            sys.stderr.flush()
    finally:
        for stream in (sys.stdout, sys.stderr) if process else ():
            try:
                stream.flush()
            except (OSError, ValueError):  # else the interpreter tries again, and reports that
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return status


def _flush() -> None:
    if sys.stdout is not None:
        sys.stdout.flush()


def _explained(error: BaseException) -> tuple[int, str] | None:
    """Return the exit status and the line of an error; None for one that is no end of a command."""
    if _heard or isinstance(error, KeyboardInterrupt):  # whatever failed while a signal unwound
        number = _heard[0] if _heard else signal.SIGINT
        return BY_SIGNAL + number, WORDS[signal.Signals(number).name]
    if isinstance(error, PirrhtError):
        return BAD_INPUT, str(error)
    if isinstance(error, MemoryError):
        remedy = "ask for less (--vertices, --samples, --classes) or close other programs"
        return BAD_INPUT, f"there is not enough memory; {remedy}"
    if isinstance(error, BrokenPipeError) and error.filename is None:  # nobody reads the output any more
        return 0, ""
    if isinstance(error, OSError):
        return BAD_INPUT, f"{error.filename or 'standard output'}: {error.strerror or error}"
    systems = sys.modules.get("sim.systems")
    blamed = None if systems is None or not isinstance(error, Exception) else systems.blamed(error)
    return None if blamed is None else (BAD_INPUT, blamed)  # of no system of the user's, so it is ours


def _any_name_prints() -> None:
    """File names that are no UTF-8 are shown by their bytes; a stream that was closed takes everything."""
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - it stays open as long as the process


@contextmanager
def unwinding() -> Iterator[None]:
    """SIGTERM and SIGHUP unwind as Ctrl-C does; whoever ignores or heeds them already goes on doing so."""

    def stop(number: int, _: FrameType | None) -> None:
        patches = sys.modules.get("pirrht.jit.patches")
        if patches is None or not patches.waits(number):  # else it comes again once a kernel is made or loaded
            _heard.append(number)
            raise KeyboardInterrupt if number == signal.SIGINT else Stopped(BY_SIGNAL + number)

    before = {number: signal.getsignal(number) for name in WORDS if (number := getattr(signal, name, None))}
    main = threading.current_thread() is threading.main_thread()
    plain = (signal.SIG_DFL, signal.default_int_handler)
    mine = {number: old for number, old in before.items() if main and old in plain}  # other threads set none
    for number in mine:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, old in mine.items():
            signal.signal(number, old)
