"""Independent calls of compiled code, which runs without the interpreter lock, on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from itertools import count
from threading import Barrier, Thread
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


def mapped(work: Callable[[A], B], items: Iterable[A], threads: int) -> list[B]:
    """The results of a function for every item, in their order; the calling thread takes its share of them.

    Waking a thread takes longer than a short call does, so that what has not begun when all is done is called off.
    """
    given = list(items)
    if threads == 1 or len(given) < 2:
        return [work(item) for item in given]
    found: dict[int, B] = {}
    turn = count()  # a step of it is atomic

    def pull() -> None:
        while (i := next(turn)) < len(given):
            found[i] = work(given[i])

    helpers = [_pool(threads - 1, os.getpid()).submit(pull) for _ in range(min(threads, len(given)) - 1)]
    begun: list[Future[None]] = []
    try:
        pull()
    finally:
        begun = _ended(helpers)
    for helper in begun:
        helper.result()
    return [found[i] for i in range(len(given))]


def _ended(helpers: Sequence[Future[None]]) -> list[Future[None]]:
    """Call off what has not begun and wait for the rest, whatever interrupts meanwhile: it writes to arrays of ours."""
    interruption: BaseException | None = None
    while True:
        try:
            begun = [helper for helper in helpers if not helper.cancel()]
            wait(begun)
            break
        except BaseException as error:
            interruption = interruption or error
    if interruption is not None:
        raise interruption
    return begun


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
