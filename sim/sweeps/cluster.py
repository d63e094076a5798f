"""Tasks of a sweep on a Dask cluster: batches of a few seconds, of which none is lost when a worker is."""

from __future__ import annotations

import logging
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol
from urllib.parse import urlsplit

import pirrht
from pirrht.errors import OptionError, PirrhtError
from sim.sweeps.engine import TICK, Agenda, Item, Stop

BATCH_SECONDS, BATCH_ITEMS = 2.0, 64  # a worker reports after so long, or so many items
AHEAD = 2  # batches that a worker has at hand, the one under way included
PATIENCE = 8.0  # for the scheduler to answer [s]
REACHABLE = 4.0  # for its machine to be found and its port to be open [s]
PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx")
CENSUS = 1.0  # how often it is asked for its workers [s]


class Traveller(Item, Protocol):
    """A piece of work with luggage that pieces of its point share, which travels apart and once only."""

    @property
    def luggage(self) -> Any:
        """Heavy data; None if there is none."""

    def carrying(self, luggage: Any) -> Traveller:
        """Return the piece with other luggage."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Pieces of one point on their way."""

    items: Sequence[Any]
    worker: str = ""  # for whom it was meant
    alone: bool = False  # whether nothing else is under way beside it


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """State of a run on the cluster."""

    work: Callable[[Any], Any]
    agenda: Agenda
    batches: dict[Any, Batch] = field(default_factory=dict)  # under way, by their futures
    last: dict[str, Any] = field(default_factory=dict)  # point that a worker is at
    single: set[int] = field(default_factory=set)  # items of batches that ended workers: one of them is to blame
    suspects: list[Any] = field(default_factory=list)  # items that ended workers, or waited beside what did


class Cluster:
    """The workers behind a scheduler, as a context.

    Raises:
        OptionError: Dask is missing, nobody answers at the address, or workers have another version.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise OptionError("--scheduler needs Dask; install it with: pip install 'pirrht[cluster]'") from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is said in one line
        check_address(address)
        _check_scheduler_at(address)
        self._address, self._killed = address, distributed.KilledWorker
        try:
            self._client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise _silent(address, " ".join(str(error).split()) or type(error).__name__) from None
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._luggage: dict[int, tuple[Any, Any]] = {}
        self._counted, self._workers = -CENSUS, list[str]()

    def __enter__(self) -> Cluster:
        try:
            self._check()
        except BaseException:
            self._client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._luggage.clear()
        self._client.close(timeout=2)

    def run(
        self, work: Callable[[Any], Any], agenda: Agenda, stop: Stop, lost: Callable[[Any, str], Any]
    ) -> Iterator[Any]:
        """Do all of it: results as they come, and None now and then while there are none.

        Args:
            work: a function of a module, which is told one item.
            lost: the result of an item that ended so many workers that nobody will try again, from it and why.

        Raises:
            PirrhtError: the scheduler is gone.
        """
        way = Way(work, agenda)
        while stop.asked < 2 and (way.batches or ((agenda or way.suspects) and not stop.asked)):
            if not stop.asked:
                self._submit(way)
            try:
                future = self._done.get(timeout=TICK)
            except queue.Empty:
                self._check_scheduler()
                yield None
                continue
            batch = way.batches.pop(future, None)
            if batch is None:
                continue
            try:
                results = future.result()
            except Exception as error:
                self._check_scheduler(error)
                yield from self._failed(way, batch, error, lost)
                continue
            for item in reversed(batch.items[len(results) :]):
                agenda.put_back(item)
            yield from results
        self._client.cancel(list(way.batches), force=True)

    def _submit(self, way: Way) -> None:
        """Give every worker something to do, and something to go on with; but a suspect the whole cluster."""
        if way.suspects or any(batch.alone for batch in way.batches.values()):
            if not way.batches:
                self._send(way, Batch(items=[way.suspects.pop()], alone=True))
            return
        busy = [batch.worker for batch in way.batches.values()]
        for worker in [w for depth in range(AHEAD) for w in self._census() if busy.count(w) <= depth]:
            if not way.agenda:
                return
            others = [point for other, point in way.last.items() if other != worker and other in busy]
            items = way.agenda.batch(way.last.get(worker), others, BATCH_ITEMS, len(self._workers), way.single)
            way.last[worker] = items[0].point
            self._send(way, Batch(items=items, worker=worker))
            busy.append(worker)

    def _send(self, way: Way, batch: Batch) -> None:
        """To whom it goes is the scheduler's choice: near its luggage, and elsewhere when a worker is lost."""
        items, luggage = [item.carrying(None) for item in batch.items], self._sent(batch.items[0].luggage)
        future = self._client.submit(_batch, way.work, items, luggage, pure=False)
        way.batches[future] = batch
        future.add_done_callback(self._done.put)

    def _failed(self, way: Way, batch: Batch, error: Exception, lost: Callable[[Any, str], Any]) -> Iterator[Any]:
        why = "the workers died" if isinstance(error, self._killed) else " ".join(str(error).split())
        if len(batch.items) > 1:
            way.single.update(map(id, batch.items))
            for item in reversed(batch.items):
                way.agenda.put_back(item)
        elif isinstance(error, self._killed) and batch.alone:
            yield lost(batch.items[0], why)
        elif isinstance(error, self._killed):
            way.suspects.extend(batch.items)
        elif way.agenda.failed(batch.items[0]):
            yield lost(batch.items[0], f"{type(error).__name__}: {why}")

    def _sent(self, luggage: Any) -> Any:
        """Luggage as the result of a task: what dies with a worker is made again."""
        if luggage is None:
            return None
        if id(luggage) not in self._luggage:
            while len(self._luggage) >= 2 * max(1, len(self._workers)):
                del self._luggage[next(iter(self._luggage))]
            self._luggage[id(luggage)] = luggage, self._client.submit(_same, luggage, pure=False)
        return self._luggage[id(luggage)][1]

    def _census(self) -> list[str]:
        if time.monotonic() - self._counted >= CENSUS:
            try:
                self._workers = list(self._client.nthreads())
            except Exception as error:
                self._check_scheduler(error)
                raise
            self._counted = time.monotonic()
        return self._workers

    def _check(self) -> None:
        for worker, found in self._client.run(_version, on_error="return").items():
            if found != pirrht.__version__:
                says = "no pirrht" if isinstance(found, Exception) else f"pirrht {found}"
                raise OptionError(
                    f"--scheduler {self._address}: worker {worker} has {says}; install {pirrht.__version__} there"
                )

    def _check_scheduler(self, error: Exception | None = None) -> None:
        from asyncio import CancelledError
        from concurrent import futures

        gone = isinstance(error, (CancelledError, futures.CancelledError, OSError))
        if gone or self._client.status != "running":
            raise PirrhtError(
                f"--scheduler {self._address}: the scheduler is gone; with -o finished runs are kept, and the same "
                "command goes on when it is back"
            ) from None


def check_address(address: str) -> None:
    """Refuse an address that nobody listens at, within seconds.

    Dask itself tries again and again until its time is over, and goes on trying while it is closed.

    Raises:
        OptionError: it is no address, or its machine is not found or refuses the connection.
    """
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise _silent(address, str(error)) from None
    if parts.scheme not in PROTOCOLS:
        raise _silent(address, f"the protocol {parts.scheme} is none of {', '.join(PROTOCOLS)}")
    if not host or not port:
        raise _silent(address, "it has no machine" if not host else "it has no port")
    if parts.scheme == "ucx":
        return
    found: queue.SimpleQueue[OSError | None] = queue.SimpleQueue()
    threading.Thread(target=lambda: found.put(_connected(host, port)), daemon=True).start()
    try:
        wrong = found.get(timeout=REACHABLE)  # looking a name up has no time limit of its own
    except queue.Empty:
        wrong = TimeoutError("timed out")
    if wrong is not None:
        raise _silent(address, wrong.strerror or str(wrong))


def _connected(host: str, port: int) -> OSError | None:
    """Why there is no connection; a scheduler that has just been started is waited for."""
    began = time.monotonic()
    while True:
        try:
            socket.create_connection((host, port), REACHABLE).close()
            return None
        except UnicodeError as error:
            return OSError(str(error))
        except OSError as error:
            if time.monotonic() - began > REACHABLE / 2 or not isinstance(error, ConnectionRefusedError):
                return error
        time.sleep(TICK)


def _check_scheduler_at(address: str) -> None:
    """Ask who is there before a client is made: one that cannot begin cannot be closed in decent time either."""
    import asyncio

    from distributed.core import connect

    async def identity() -> Any:
        comm = await connect(address, timeout=PATIENCE)
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    try:
        found = asyncio.run(asyncio.wait_for(identity(), PATIENCE))
        kind = found.get("type") if isinstance(found, dict) else None
    except Exception as error:  # whatever another program's bytes lead to
        raise _silent(address, " ".join(str(error).split())[:80] or type(error).__name__) from None
    if kind != "Scheduler":
        raise _silent(address, f"who does is a {kind}")


def _silent(address: str, reason: str) -> OptionError:
    return OptionError(
        f"--scheduler {address}: no scheduler answers there ({reason}); write for instance tcp://127.0.0.1:8786"
    )


def _batch(work: Callable[[Any], Any], items: Sequence[Any], luggage: Any) -> list[Any]:
    """Results of the first items, as many as there is time for."""
    began, results = time.perf_counter(), []
    for item in items:
        results.append(work(item.carrying(luggage)))
        if time.perf_counter() - began >= BATCH_SECONDS:
            break
    return results


def _same(luggage: Any) -> Any:
    return luggage


def _version() -> str:
    import pirrht

    return pirrht.__version__
