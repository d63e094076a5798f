"""Work shared among threads is over when the call returns, however that ends."""

from __future__ import annotations

import signal
import threading
import time

import pytest

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
