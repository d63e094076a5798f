"""Tasks of a sweep on a Dask cluster."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from typing import Any
from urllib.parse import urlsplit

import pirrht
from pirrht.errors import OptionError, PirrhtError
from sim.extras import require
from sim.sweeps.engine import CHUNK_TASKS, Crew, Stop, chunk

PATIENCE = 8.0  # for the scheduler to do what a client asks [s]
REACHABLE = 4.0  # for it to say who it is [s]


class Cluster(Crew):
    """The workers behind a scheduler, as a context.

    Raises:
        OptionError: Dask is missing, nobody answers at the address, or workers have another version.
    """

    inline, remote = False, True
    ahead, most = 2, CHUNK_TASKS
    tries, death = 1, "the workers died"  # the scheduler has tried it on several

    def __init__(self, address: str, stop: Stop) -> None:
        super().__init__(stop)
        probe(address)
        import distributed

        self._address, self.broken = address, (distributed.KilledWorker,)
        try:
            self._client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise _silent(address, error) from None
        self._executor = self._client.get_executor(pure=False)

    def __enter__(self) -> Cluster:
        try:
            for worker, found in self._client.run(_version, on_error="return").items():
                if found != pirrht.__version__:
                    theirs = "no pirrht" if isinstance(found, Exception) else f"pirrht {found}"
                    raise OptionError(
                        f"--scheduler {self._address}: worker {worker} has {theirs}; install {pirrht.__version__} there"
                    )
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close(timeout=2)

    @property
    def workers(self) -> int:  # type: ignore[override]
        """Number of workers at present; one while there are none, so that something waits for the first."""
        try:
            return len(self._client.nthreads()) or 1
        except Exception as error:
            self.check(error)
            raise

    def submit(self, work: Callable[[Any], Any], tasks: Sequence[Any]) -> Future[list[Any]]:
        """Begin a chunk on whichever worker the scheduler chooses."""
        return self._executor.submit(chunk, work, tasks)  # type: ignore[no-any-return]

    def check(self, error: BaseException | None = None) -> None:
        """Raise PirrhtError if the scheduler is gone."""
        gone = isinstance(error, (asyncio.CancelledError, CancelledError, OSError))
        if gone or self._client.status != "running":
            remedy = "with -o finished runs are kept; give the same command when it is back"
            raise PirrhtError(f"--scheduler {self._address}: the scheduler is gone; {remedy}") from None


def probe(address: str) -> None:
    """Refuse an address that no scheduler answers at, within seconds, before a client that cannot begin is made.

    Raises:
        OptionError: Dask is missing, it is no address, or nobody or another program answers.
    """
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        if not parts.hostname or not parts.port:
            raise ValueError("missing port" if parts.hostname else "missing machine")
    except ValueError as error:
        raise _silent(address, error) from None
    require("--scheduler", "cluster")
    from distributed import rpc

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is said in one line

    async def identity() -> Any:
        async with rpc(address, timeout=REACHABLE) as found:
            return await found.identity()

    try:
        found = asyncio.run(asyncio.wait_for(identity(), REACHABLE))
    except Exception as error:  # whatever another program's bytes lead to
        raise _silent(address, error) from None
    if not isinstance(found, dict) or found.get("type") != "Scheduler":
        raise _silent(address, "who does is none")


def _silent(address: str, reason: Exception | str) -> OptionError:
    why = " ".join(str(reason).split())[:80] or type(reason).__name__
    return OptionError(
        f"--scheduler {address}: no scheduler answers there ({why}); write for instance tcp://127.0.0.1:8786"
    )


def _version() -> str:
    return pirrht.__version__
