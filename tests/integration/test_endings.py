"""However a command is stopped, it ends with the status that says so and at most one line; nothing is left behind."""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

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
