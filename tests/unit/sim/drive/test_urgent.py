"""What gives way to work that a clock waits for."""

from __future__ import annotations

import threading
from contextlib import suppress

import rerun as rr

from sim.drive import clock
from sim.drive.clock import URGENT, Urgent
from sim.recording.stream import Stream


def waiter(work: Urgent) -> tuple[threading.Thread, threading.Event]:
    done = threading.Event()

    def wait() -> None:
        work.give_way()
        done.set()

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread, done


def test_nothing_waits_when_nothing_is_urgent():
    _, done = waiter(Urgent())
    assert done.wait(10.0)


def test_what_gives_way_goes_on_as_soon_as_urgent_work_ends_or_fails(monkeypatch):
    monkeypatch.setattr(clock, "LONGEST", 60.0)
    work = Urgent()
    with suppress(ValueError), work.work():
        _, done = waiter(work)
        assert not done.wait(0.05)
        raise ValueError
    assert done.wait(10.0)


def test_work_that_never_ends_holds_nothing_up_for_ever(monkeypatch):
    monkeypatch.setattr(clock, "LONGEST", 0.01)
    work = Urgent()
    with work.work():
        _, done = waiter(work)
        assert done.wait(10.0)


def test_recordings_give_way(monkeypatch):
    asked: list[None] = []
    monkeypatch.setattr(URGENT, "give_way", lambda: asked.append(None))
    stream = Stream("test", "way", orderly=True)
    stream.columns("/number", [0], [0.0], rr.Scalars.columns(scalars=[1.0]))
    stream.log("/number", 1, 0.1, rr.Scalars(2.0))
    assert len(asked) == 2
    stream.close()
