"""However a command is stopped, it ends with the status that says so and at most one line; nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from repository import environment

from pirrht.errors import OptionError
from sim.cli.ending import Stopped, ended


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Stopped(signal.SIGTERM), Stopped(signal.SIGHUP)])
def test_contexts_clean_up_while_a_signal_unwinds(stop, capsys):
    ignored = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup
    left = []

    def command() -> int:
        try:
            signal.raise_signal(stop.number if isinstance(stop, Stopped) else signal.SIGINT)
        finally:
            left.append("cleaned up")
        return 0

    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    assert ended(command) == (stop.code if isinstance(stop, Stopped) else 130)
    assert left == ["cleaned up"]
    assert capsys.readouterr().err.count("\n") == 1
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
    signal.signal(signal.SIGHUP, ignored)


def test_an_interruption_that_a_finalizer_swallows_is_delivered_again(capsys):
    class Swallowing:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def command() -> int:
        Swallowing()
        for _ in range(100_000):  # at most 100 s
            time.sleep(0.001)
        return 0

    assert ended(command) == 130
    assert capsys.readouterr().err == "pirrht: interrupted\n"


def test_a_second_signal_while_the_first_is_told_leaves_one_line(capsys, monkeypatch):
    """It strikes before the line is written: then that of the second is."""
    write, struck = sys.stderr.write, []

    def struck_once(text: str) -> int:
        if not struck:
            struck.append(True)
            raise Stopped(signal.SIGTERM)
        return write(text)

    def stopped() -> int:
        raise Stopped(signal.SIGTERM)

    monkeypatch.setattr(sys.stderr, "write", struck_once)
    assert ended(stopped) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "pirrht: terminated\n"


def test_what_goes_wrong_because_a_callback_swallowed_an_interruption_is_that_interruption(capsys):
    class Swallowing:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def command() -> int:
        Swallowing()
        raise RuntimeError("what the callback should have made is missing")

    assert ended(command) == 130
    assert capsys.readouterr().err == "pirrht: interrupted\n"
    with pytest.raises(RuntimeError, match="of its own"):
        ended(lambda: (_ for _ in ()).throw(RuntimeError("of its own")))


def test_whoever_heeds_a_signal_already_goes_on_doing_so():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
    try:
        assert ended(lambda: signal.raise_signal(signal.SIGTERM) or 0) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM]


def test_a_broken_pipe_that_is_not_the_output_is_told(capsys):
    def command() -> int:
        raise BrokenPipeError(32, "Broken pipe", "socket of a viewer")

    reader, writer = os.pipe()  # an output that is read
    out = os.fdopen(writer, "w")
    before, sys.stdout = sys.stdout, out
    try:
        assert ended(command) == 2
    finally:
        sys.stdout = before
        out.close()
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
    command = [sys.executable, "-c", HANDLED.format(signal=name)]
    known = environment() | {"PYTHONUNBUFFERED": ""}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, env=known, text=True)
    os.close(writer)
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr.count("\n") == 1, done.stderr


def test_a_pipe_that_is_found_closed_while_a_signal_unwinds_does_not_hide_the_signal(capsys):
    def command() -> int:
        try:
            raise Stopped(signal.SIGTERM)
        finally:
            raise BrokenPipeError(32, "Broken pipe")  # as a progress bar does that cannot be taken away

    assert ended(command) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "pirrht: terminated\n"


def test_a_line_has_no_second_one_whatever_names_it_holds(capsys):
    def refuse() -> int:
        raise OptionError("--json a\nb\x1b[2J\ud800: no")

    assert ended(refuse) == 2
    assert capsys.readouterr().err == "pirrht: --json a\\nb\\x1b[2J\\ud800: no\n"
