"""Independent calls of compiled code, which runs without the interpreter lock, on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from itertools import count
from threading import Barrier, Thread
from time import sleep
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")
RETRY = 1e-3  # time between checks of the work that other threads have begun [s]


def mapped(work: Callable[[A], B], items: Iterable[A], threads: int) -> list[B]:
    """The results of a function for every item, in their order; the calling thread takes its share of them.

    Waking a thread takes longer than a short call does, so that what has not begun when all is done is called off.
    """
    given = list(items)
    if threads == 1 or len(given) < 2:
        return [work(item) for item in given]
    found: dict[int, B] = {}
    inside: list[None] = []  # one of each thread that may be at work
    turn, total = count(), len(given)  # a step of the first is atomic

    def pull() -> None:
        inside.append(None)
        try:
            while (i := next(turn)) < len(given):
                found[i] = work(given[i])
        finally:
            inside.pop()

    try:
        helpers = [_pool(threads - 1, os.getpid()).submit(pull) for _ in range(min(threads, total) - 1)]
        pull()
        for helper in [helper for helper in helpers if not helper.cancel()]:
            helper.result()
    except BaseException:
        _leave(given, inside)
        raise
    return [found[i] for i in range(total)]


def over_ranges(work: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call a function (start, stop) for ranges that cover 0 to `count`, on several threads."""
    if threads == 1:
        work(0, count)
        return
    edges = [count * i // (2 * threads) for i in range(2 * threads + 1)]
    mapped(lambda ends: work(*ends), zip(edges[:-1], edges[1:], strict=True), threads)


def _leave(given: list[A], inside: Sequence[None]) -> None:
    """Call off what has not begun and wait for the rest, whatever interrupts meanwhile: it writes to arrays of ours.

    It waits for threads that are inside, not for those that were sent: a signal may strike while they are sent.
    """
    while given or inside:
        with suppress(BaseException):
            given.clear()
            sleep(RETRY)


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """A pool whose threads all wait for work.

    Another thread begins them: a signal that strikes the main one while it does so would leave a thread that the pool
    does not know, and that nobody ends when the process does.
    """
    pool, all_here = ThreadPoolExecutor(threads), Barrier(threads)
    starter = Thread(target=lambda: wait([pool.submit(all_here.wait) for _ in range(threads)]))
    starter.start()
    starter.join()
    return pool
