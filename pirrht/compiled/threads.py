"""Independent calls of compiled code, which runs without the interpreter lock, on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import count
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
    try:
        pull()
    finally:
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()
    return [found[i] for i in range(len(given))]


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)
