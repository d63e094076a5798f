"""However a command is stopped, it ends with the status that reports it and at most one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim.cli.ending import Stopped, ended


def failing(error: BaseException, then: BaseException | None = None):
    """A command that fails, and once more while the first error unwinds."""

    def command() -> int:
        try:
            raise error
        finally:
            if then is not None:
                raise then

    return command


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Stopped(signal.SIGTERM), Stopped(signal.SIGHUP)])
def test_contexts_clean_up_while_a_signal_unwinds(stop, capsys):
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    ignored, left = signal.signal(signal.SIGHUP, signal.SIG_DFL), []  # under nohup

    def command() -> int:
        try:
            signal.raise_signal(stop.number if isinstance(stop, Stopped) else signal.SIGINT)
        finally:
            left.append("cleaned up")
        return 0

    before = [signal.getsignal(n) for n in numbers]
    assert ended(command) == (stop.code if isinstance(stop, Stopped) else 130)
    assert left == ["cleaned up"]
    assert capsys.readouterr().err.count("\n") == 1
    assert [signal.getsignal(n) for n in numbers] == before
    signal.signal(signal.SIGHUP, ignored)


@pytest.mark.parametrize(
    ("errors", "status", "line"),
    [  # a name of many lines; and a pipe that is found closed while a signal unwinds, as by a progress bar
        ([OptionError("--json a\nb\x1b[2J\ud800: no")], 2, r"pirrht: --json a\nb\x1b[2J\ud800: no"),
        ([Stopped(signal.SIGTERM), BrokenPipeError(32, "Broken pipe")], 128 + signal.SIGTERM, "pirrht: terminated"),
    ],
)
def test_an_error_is_one_line_and_does_not_hide_a_signal(errors, status, line, capsys):
    assert ended(failing(*errors)) == status
    assert capsys.readouterr().err == line + "\n"


def test_errors_of_this_program_are_not_hidden():
    with pytest.raises(RuntimeError, match="of its own"):
        ended(failing(RuntimeError("of its own")))


def test_a_second_signal_while_the_first_is_reported_leaves_one_line(capsys, monkeypatch):
    """It strikes before the line is written: then that of the second is."""
    write, struck = sys.stderr.write, []

    def struck_once(text: str) -> int:
        if not struck:
            struck.append(True)
            raise Stopped(signal.SIGTERM)
        return write(text)

    monkeypatch.setattr(sys.stderr, "write", struck_once)
    assert ended(failing(Stopped(signal.SIGTERM))) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "pirrht: terminated\n"


def test_whoever_heeds_a_signal_already_goes_on_doing_so():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
    try:
        assert ended(lambda: signal.raise_signal(signal.SIGTERM) or 0) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM]


def test_a_broken_pipe_that_is_not_the_output_is_reported(capsys, monkeypatch):
    reader, writer = os.pipe()  # an output that is read
    with os.fdopen(writer, "w") as out, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", out)
        assert ended(failing(BrokenPipeError(32, "Broken pipe", "socket of a viewer"))) == 2
    os.close(reader)
    assert capsys.readouterr().err == "pirrht: socket of a viewer: Broken pipe\n"


HANDLED = """
import os, signal, sys
from sim.cli.ending import ended
def command():
    print("a line that waits in a buffer")
    signal.raise_signal(signal.{signal})
sys.exit(ended(command, process=True))
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_pipe_that_closes_while_a_signal_is_handled_costs_no_second_line(name):
    reader, writer = os.pipe()
    os.close(reader)
    command, known = [sys.executable, "-c", HANDLED.format(signal=name)], environment() | {"PYTHONUNBUFFERED": ""}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, env=known, text=True)
    os.close(writer)
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr.count("\n") == 1, done.stderr
