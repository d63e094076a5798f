"""Work that is spread over processes, with a bar that counts it."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from tqdm import tqdm


def spread(work: Callable[[Any], Any], jobs: Sequence[Any], workers: int, text: str) -> Iterator[Any]:
    """Yield what `work` makes of each job, in their order; a single worker is this process."""
    bar = {"desc": text, "total": len(jobs), "leave": False, "disable": None}
    if workers == 1:
        yield from tqdm(map(work, jobs), **bar)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from tqdm(pool.map(work, jobs), **bar)
