"""Work shared among threads is over when the call returns, and what interrupts LLVM comes a little later."""

import signal
import threading
import time

import numpy as np
import pytest
from numba import njit
from numba.core import event

from pirrht.jit import patches
from pirrht.jit.jit import mapped


def test_results_come_in_the_order_of_the_items_whatever_the_number_of_threads():
    for n in (1, 2, 5):
        assert mapped(lambda i: i * i, range(40), n) == [i * i for i in range(40)]


def test_an_error_of_any_thread_is_raised():
    def work(i: int) -> int:
        if i == 7:
            raise ZeroDivisionError("seven")
        return i

    with pytest.raises(ZeroDivisionError, match="seven"):
        mapped(work, range(20), 3)


def test_no_thread_still_works_when_interruptions_have_ended_the_call():
    """Arrays of the caller would be gone under it: two interruptions, one of them while the others are waited for."""
    working, main = threading.Semaphore(0), threading.main_thread()
    over: list[int] = []

    def work(i: int) -> int:
        if threading.current_thread() is main:
            working.acquire()  # until a helper is at it
            signal.raise_signal(signal.SIGINT)
        working.release()
        timer = threading.Timer(0.05, signal.pthread_kill, [main.ident, signal.SIGINT])
        timer.start()
        time.sleep(0.2)
        timer.join()
        over.append(i)
        return i

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            mapped(work, range(2), 2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(over) == 1


@pytest.fixture
def heard():
    """Signals of Ctrl-C: what became of each."""
    happened: list[str] = []

    def handler(number: int, _) -> None:
        happened.append("waits" if patches.waits(number) else "heeded")

    before = signal.signal(signal.SIGINT, handler)
    yield happened
    signal.signal(signal.SIGINT, before)


def test_a_signal_waits_until_the_outermost_work_is_done_and_comes_once_and_without_any_at_once(heard: list[str]):
    with patches.unbroken:
        with patches.unbroken:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        assert heard == ["waits", "waits"]
    assert heard == ["waits", "waits", "heeded"]
    signal.raise_signal(signal.SIGINT)
    assert heard[3:] == ["heeded"]


class During(event.Listener):  # type: ignore[misc]
    """Interrupts a pass of the compiler when it begins."""

    def __init__(self, name: str) -> None:
        self.name = name

    def on_start(self, happening: event.Event) -> None:
        if happening.data["name"].startswith(self.name):
            signal.raise_signal(signal.SIGINT)

    def on_end(self, happening: event.Event) -> None:
        pass


@pytest.mark.parametrize(("name", "first"), [(patches.LOWERING, "waits"), ("nopython_type_inference", "heeded")])
def test_compiling_is_interrupted_before_and_after_llvm_but_not_within(heard: list[str], name: str, first: str):
    listener = During(name)
    event.register("numba:run_pass", listener)
    try:
        assert njit(lambda x: x + 1)(np.int64(1)) == 2
    finally:
        event.unregister("numba:run_pass", listener)
    assert (heard[0], heard[-1]) == (first, "heeded")
