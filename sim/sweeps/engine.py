"""Many errands on several processes of this machine: none is lost when a process dies, and none outlives its parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Sequence, Set
from contextlib import contextmanager, suppress
from multiprocessing import connection
from typing import Any, Protocol

from pirrht.errors import PirrhtError

TRIES = 3  # processes that an errand may end before it counts as failed
TICK = 0.2  # how often the loop looks up while nothing happens [s]
READY, DONE = "ready", "done"
# A process does linear algebra in one thread, since the others' cores are taken, and imports nothing from the current
# folder: what Python runs to begin it would look there first.
ENVIRONMENT = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "PYTHONSAFEPATH")


class Item(Protocol):
    """A piece of work."""

    @property
    def point(self) -> tuple[Hashable, ...]:
        """Key of items that one process had better do one after the other; the scene comes first."""


class Stop:
    """Count of requests to stop: one ends what is under way, two end at once."""

    def __init__(self) -> None:
        self.asked = 0
        self.number = signal.SIGINT  # the last signal that asked
        self.inline = False  # whether the work is done in this thread, which only an exception can stop

    def ask(self, times: int = 1, number: signal.Signals = signal.SIGINT) -> None:
        """Take note of a wish to stop."""
        self.asked, self.number = self.asked + times, number
        if self.inline and self.asked > 1:
            raise KeyboardInterrupt


def _asking(stop: Stop, wishes: dict[signal.Signals, int]) -> Callable[[int, Any], None]:
    return lambda n, _: stop.ask(wishes[signal.Signals(n)], signal.Signals(n))


@contextmanager
def interruptible() -> Iterator[Stop]:
    """A stop that Ctrl-C asks for, once or twice, and SIGTERM with urgency."""
    stop = Stop()
    wishes = {signal.SIGINT: 1, signal.SIGTERM: 2}
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, _asking(stop, wishes)) for number in wishes}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Agenda:
    """Queue of work, handed out so that a process stays with one point and two processes keep apart."""

    def __init__(self, items: Sequence[Item]) -> None:
        self._waiting: dict[tuple[Hashable, ...], deque[Any]] = {}
        self._failures: dict[int, int] = {}
        for item in items:
            self.add(item)

    def add(self, item: Item) -> None:
        """One more item, even while others are being done."""
        self._waiting.setdefault(item.point, deque()).append(item)

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def take(self, last: tuple[Hashable, ...] | None, others: Sequence[tuple[Hashable, ...] | None]) -> Any:
        """The next item for one who did `last`, while others are at theirs."""
        point = last if last in self._waiting else self._best(last, others)
        queue = self._waiting[point]
        item = queue.popleft()
        if not queue:
            del self._waiting[point]
        return item

    def batch(
        self,
        last: tuple[Hashable, ...] | None,
        others: Sequence[tuple[Hashable, ...] | None],
        most: int,
        workers: int,
        single: Set[int],
    ) -> list[Any]:
        """Items of one point at a time: at most a fair share of them, and those whose id is in `single` alone."""
        items = [self.take(last, others)]
        point = items[0].point
        share = len(self._waiting.get(point, ())) // (2 * workers)
        while point in self._waiting and len(items) < min(most, 1 + share):
            if id(items[0]) in single or id(self._waiting[point][0]) in single:
                break
            items.append(self.take(point, ()))
        return items

    def put_back(self, item: Any) -> None:
        """An item that was not done; it is the next of its point."""
        self._waiting.setdefault(item.point, deque()).appendleft(item)

    def failed(self, item: Any) -> bool:
        """Take note that an item ended a process; whether it has done so too often, else it is put back."""
        self._failures[id(item)] = self._failures.get(id(item), 0) + 1
        if self._failures[id(item)] >= TRIES:
            return True
        self.put_back(item)
        return False

    def _best(
        self, last: tuple[Hashable, ...] | None, others: Sequence[tuple[Hashable, ...] | None]
    ) -> tuple[Hashable, ...]:
        taken = {point for point in others if point is not None}
        scenes = {point[0] for point in taken}

        def rank(point: tuple[Hashable, ...]) -> tuple[bool, bool, bool]:
            return point in taken, last is None or point[0] != last[0], point[0] in scenes

        best = min(self._waiting, key=rank)
        if best in taken:
            return max(self._waiting, key=lambda point: len(self._waiting[point]))
        return best


class Worker:
    """A process that does one item at a time and ends with its parent."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")  # forking a process that has threads is not safe
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _without_interrupts(), _environment():
            self.process.start()
        theirs.close()
        self.item: Any = None
        self.last: tuple[Hashable, ...] | None = None
        self.ready = False

    def give(self, work: Callable[[Any], Any], item: Any) -> None:
        """Hand an item over; that the process is dead shows when it is listened to."""
        self.item, self.last = item, item.point
        with suppress(OSError):
            self.pipe.send((work, item))

    def end(self, *, at_once: bool = False) -> None:
        """End the process: when it is through with its item, or at once."""
        self.pipe.close()
        if at_once:
            self.process.kill()
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class Pool:
    """Processes of this machine, as a context: those that are busy when it is left are ended at once."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._workers: list[Worker] = []

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end(at_once=worker.item is not None or not worker.ready)

    def run(
        self, work: Callable[[Any], Any], agenda: Agenda, stop: Stop, lost: Callable[[Any, str], Any]
    ) -> Iterator[Any]:
        """Do all of it: results as they come, and None now and then while there are none.

        Args:
            work: a function of a module, which is told one item.
            agenda: what is done to a result, before the next is asked for, may add to it.
            lost: the result of an item that ended so many processes that nobody will try again, from it and why.

        Raises:
            PirrhtError: processes end before they have begun.
        """
        false_starts = 0
        while stop.asked < 2:
            self._hire(len(agenda), stop)
            _hand_out(self._workers, work, agenda, stop)
            busy: dict[Any, Worker] = {worker.pipe: worker for worker in self._workers if worker.item is not None}
            if not busy:
                return
            heard = connection.wait(list(busy), TICK)
            for worker in [busy[pipe] for pipe in heard]:
                try:
                    news, result = worker.pipe.recv()
                except (EOFError, OSError):
                    item, code, ready = worker.item, _buried(worker), worker.ready
                    self._workers[self._workers.index(worker)] = Worker()
                    false_starts = 0 if ready else false_starts + 1
                    if false_starts >= TRIES:
                        why = f"{TRIES} processes ended before they could begin (exit status {code})"
                        raise PirrhtError(f"{why}; try --jobs 1") from None
                    if not ready:
                        agenda.put_back(item)
                    elif agenda.failed(item):
                        yield lost(item, f"the process died {TRIES} times (exit status {code})")
                    continue
                if news == READY:
                    worker.ready = True
                else:
                    worker.item = None
                    yield result
            if not heard:
                yield None

    def _hire(self, items: int, stop: Stop) -> None:
        """As many processes as there is work for, up to the size of the pool."""
        idle = sum(worker.item is None for worker in self._workers)
        while idle < items and len(self._workers) < self._size and not stop.asked:
            self._workers.append(Worker())
            idle += 1


def in_turn(work: Callable[[Any], Any], agenda: Agenda, stop: Stop) -> Iterator[Any]:
    """Do all of it in this thread: results as they come. A second wish to stop is a KeyboardInterrupt."""
    last = None
    stop.inline = True
    try:
        while agenda and not stop.asked:
            item = agenda.take(last, ())
            last = item.point
            yield work(item)
    finally:
        stop.inline = False


def _hand_out(workers: Sequence[Worker], work: Callable[[Any], Any], agenda: Agenda, stop: Stop) -> None:
    for worker in workers:
        if worker.item is None and agenda and not stop.asked:
            others = [other.last for other in workers if other is not worker]  # who is idle too stays where it was
            worker.give(work, agenda.take(worker.last, others))


def _buried(worker: Worker) -> int | None:
    worker.pipe.close()
    worker.process.join(5.0)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()
    return worker.process.exitcode


def _serve(pipe: Any) -> None:
    """Serve items in a process."""
    with suppress(ValueError, OSError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pipe.send((READY, None))
    while True:
        try:
            work, item = pipe.recv()
        except (EOFError, OSError):
            return
        pipe.send((DONE, work(item)))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """A process that begins here is spared Ctrl-C, which goes to all processes of a terminal."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment() -> Iterator[None]:
    """Set what processes that begin here find in their environment, unless the user has."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update({name: "1" for name, value in before.items() if not value})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
