"""One process compiles a kernel, others that want it wait and then find it on disk.

Else processes that begin together, of a sweep or of a test suite, would all compile the same minutes long.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock

try:
    import fcntl
except ImportError:  # a system without such locks: everyone compiles
    fcntl = None  # type: ignore[assignment]


def one_at_a_time(work: Callable[..., Any], path: Path) -> Callable[..., Any]:
    """The same work, done by one process at a time of those that name the same file.

    A lock is held until its holder is through or gone. Kernels call each other in no circle, so that who waits for one
    is never waited for; threads of a process take the lock of numba's compiler first, in which they compile anyway.
    """

    def alone(*given: Any) -> Any:
        with global_compiler_lock, _held(path):
            return work(*given)

    return alone


@contextmanager
def _held(path: Path) -> Iterator[None]:
    """Hold the lock of a file; where it cannot be had, go on without."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("ab")
    except OSError:
        yield
        return
    with stream:
        if fcntl is not None:
            with suppress(OSError):
                fcntl.flock(stream, fcntl.LOCK_EX)
        yield
