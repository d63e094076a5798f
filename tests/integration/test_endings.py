"""However a command is stopped, it ends with the status that reports it and at most one line."""

import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim.cli.ending import ended, unwinding


def failing(error: BaseException, number: int | None = None):
    """A command that fails, maybe while a signal unwinds."""

    def command() -> int:
        with unwinding():
            try:
                if number is not None:
                    signal.raise_signal(number)
            finally:
                raise error

    return command


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_contexts_clean_up_while_a_signal_unwinds(number, capsys):
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    ignored, left = signal.signal(signal.SIGHUP, signal.SIG_DFL), []  # under nohup

    def command() -> int:
        with unwinding(), ExitStack() as stack:
            stack.callback(left.append, "cleaned up")
            signal.raise_signal(number)
        return 0

    before = [signal.getsignal(n) for n in numbers]
    assert ended(command) == 128 + number
    assert left == ["cleaned up"]
    assert capsys.readouterr().err.count("\n") == 1
    assert [signal.getsignal(n) for n in numbers] == before
    signal.signal(signal.SIGHUP, ignored)


@pytest.mark.parametrize(
    ("errors", "status", "line"),
    [  # a name of many lines; a pipe that is found closed while a signal unwinds, as by a progress bar; no output
        ([OptionError("--json a\nb\x1b[2J\ud800 é: no")], 2, r"pirrht: --json a\nb\x1b[2J\ud800 é: no"),
        ([BrokenPipeError(32, "Broken pipe"), signal.SIGTERM], 128 + signal.SIGTERM, "pirrht: terminated"),
        ([BrokenPipeError(32, "Broken pipe", "socket of a viewer")], 2, "pirrht: socket of a viewer: Broken pipe"),
    ],
)
def test_an_error_is_one_line_and_does_not_hide_a_signal(errors, status, line, capsys):
    assert ended(failing(*errors)) == status
    assert capsys.readouterr().err == line + "\n"


def test_errors_of_this_program_are_not_hidden():
    with pytest.raises(RuntimeError, match="of its own"):
        ended(failing(RuntimeError("of its own")))


def test_whoever_heeds_a_signal_already_goes_on_doing_so():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
    try:
        with unwinding():
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM]


HANDLED = """
import os, signal, sys
from sim.cli.ending import ended, unwinding
def command():
    print("a line that waits in a buffer")
    with unwinding():
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
