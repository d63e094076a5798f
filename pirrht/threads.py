"""Independent calls of compiled code, which runs without the interpreter lock, on several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

A = TypeVar("A")
B = TypeVar("B")


def mapped(work: Callable[[A], B], items: Iterable[A], threads: int) -> list[B]:
    """The results of a function for every item, in their order."""
    given = list(items)
    if threads == 1 or len(given) < 2:
        return [work(item) for item in given]
    return list(_pool(threads, os.getpid()).map(work, given))


@cache
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)
