"""Many tasks in this thread, on processes of this machine or on a cluster: none is lost when a process dies."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any, Self

from pirrht.errors import PirrhtError

TRIES = 3  # processes that a task may end before it counts as failed
TICK = 0.2  # how often the loop looks up while nothing happens [s]
CHUNK_SECONDS, CHUNK_TASKS = 2.0, 64  # a worker of a cluster reports after so long, or so many tasks
# A process does linear algebra in one thread, since the others' cores are taken, and imports nothing from the current
# folder: what Python runs to begin it would look there first.
ENVIRONMENT = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "PYTHONSAFEPATH")


class Stop:
    """Count of requests to stop: one ends what is under way, two end at once."""

    asked = 0
    number: int = signal.SIGINT  # the last signal that asked
    inline = False  # whether the work is done in this thread, which only an exception can stop

    def ask(self, times: int = 1, number: int = signal.SIGINT) -> None:
        """Take note of a wish to stop."""
        self.asked, self.number = self.asked + times, number
        if self.inline and self.asked > 1:
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[Stop]:
    """A stop that Ctrl-C asks for, once or twice, and SIGTERM with urgency; in the main thread only."""
    stop = Stop()
    times = dict[int, int]()

    if threading.current_thread() is threading.main_thread():
        times = {signal.SIGINT: 1, signal.SIGTERM: 2}
    before = {number: signal.signal(number, lambda n, _: stop.ask(times[n], n)) for number in times}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Agenda:
    """Queue of tasks, of which those with one `point` share what a process keeps at hand."""

    def __init__(self, tasks: Sequence[Any]) -> None:
        self._waiting: OrderedDict[Any, deque[Any]] = OrderedDict()
        self.add(tasks)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, tasks: Sequence[Any]) -> None:
        """Put tasks first, even while others are being done."""
        for task in reversed(tasks):
            self._waiting.setdefault(task.point, deque()).appendleft(task)
            self._waiting.move_to_end(task.point, last=False)

    def take(self, workers: int, most: int, others: Collection[Any] = ()) -> list[Any]:
        """The next tasks of one point, if possible none of the points of others: at most a fair share of them."""
        point = next((point for point in self._waiting if point not in others), next(iter(self._waiting)))
        alike = self._waiting[point]
        share = 1 + (len(alike) - 1) // (2 * workers)
        tasks = [alike.popleft() for _ in range(min(most, share))]
        if not alike:
            del self._waiting[point]
        return tasks


class Crew:
    """Who does the work, as a context: this thread, one task after the other. Subclasses have other workers."""

    inline, remote = True, False  # whether it works on this thread; on other machines
    workers, ahead, most = 1, 1, 1  # chunks of a worker that are under way, tasks of a chunk
    broken: tuple[type[BaseException], ...] = ()  # raised by the chunks of a process that has died
    tries, death = 1, ""  # processes that a task may end with nothing else under way, and the error of its record then

    def __init__(self, stop: Stop) -> None:
        self.stop = stop

    def __enter__(self) -> Self:
        self.stop.inline = self.inline
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.inline = False

    def submit(self, work: Callable[[Any], Any], tasks: Sequence[Any]) -> Future[list[Any]]:
        """Begin a chunk of tasks."""
        future: Future[list[Any]] = Future()
        future.set_result(chunk(work, tasks))
        return future

    def check(self, error: BaseException | None = None) -> None:
        """Raise PirrhtError if there is nobody any more."""

    def run(
        self, work: Callable[[Any], Any], agenda: Agenda, lost: Callable[[Any, str], Any]
    ) -> Iterator[tuple[Any, Any] | None]:
        """Do all of it: tasks with their results as they come, and None now and then while there are none.

        What was under way when a process died is suspected of it, and tried again with nothing else under way.

        Args:
            agenda: what is done to a result, before the next is asked for, may add to it.
            lost: the result of a task that ended too many processes, from it and why.

        Raises:
            PirrhtError: there are no workers, or none can begin.
        """
        chunks: dict[Future[list[Any]], list[Any]] = {}
        suspects: deque[Any] = deque()  # the first is tried alone, and leaves the queue when that is over
        deaths = 0  # of the first suspect
        while self.stop.asked < 2:
            workers = self.workers
            room = 1 if suspects else workers * self.ahead
            while len(chunks) < room and (suspects or agenda) and not self.stop.asked:
                # With one chunk per worker, the idle one has just left its point, so nobody else is there: it goes on.
                others = {tasks[0].point for tasks in chunks.values()} if self.ahead == 1 else ()
                tasks = [suspects[0]] if suspects else agenda.take(workers, self.most, others)
                chunks[self.submit(work, tasks)] = tasks
            if not chunks:
                return
            ended = wait(chunks, TICK, FIRST_COMPLETED).done
            if not ended:
                self.check()
                yield None
            for future in ended:
                tasks = chunks.pop(future)
                alone = bool(suspects) and tasks[0] is suspects[0]
                try:
                    results = future.result()
                except self.broken:
                    if not alone:
                        suspects.extend(tasks)
                        continue
                    deaths += 1
                    if deaths < self.tries:
                        continue
                    results = [lost(tasks[0], self.death)]
                except Exception as error:
                    self.check(error)
                    results = [lost(task, f"{type(error).__name__}: {error}") for task in tasks]
                if alone:
                    suspects.popleft()
                    deaths = 0
                agenda.add(tasks[len(results) :])
                yield from zip(tasks, results, strict=False)


class Pool(Crew):
    """Processes of this machine: those that are busy when it is left are ended at once."""

    inline = False
    broken = (BrokenProcessPool,)
    tries = TRIES - 1
    death = f"its process died {TRIES} times"

    def __init__(self, size: int, stop: Stop) -> None:
        super().__init__(stop)
        self.workers = size
        self._context = multiprocessing.get_context("spawn")  # forking a process that has threads is not safe
        self._theirs, self._lifeline = self._context.Pipe(duplex=False)
        self._pool: ProcessPoolExecutor | None = None

    def __exit__(self, *_: object) -> None:
        self._lifeline.close()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._theirs.close()

    def submit(self, work: Callable[[Any], Any], tasks: Sequence[Any]) -> Future[list[Any]]:
        """Begin a chunk; processes that have died are replaced."""
        with _surroundings():
            if self._pool is not None:
                with suppress(BrokenProcessPool):
                    return self._pool.submit(chunk, work, tasks)
            for _ in range(TRIES):
                self._pool = ProcessPoolExecutor(self.workers, self._context, _begin, (self._theirs,))
                with suppress(BrokenProcessPool):
                    self._pool.submit(int).result()
                    return self._pool.submit(chunk, work, tasks)
        raise PirrhtError(f"{TRIES} processes ended before they could begin; try --jobs 1")


def chunk(work: Callable[[Any], Any], tasks: Sequence[Any]) -> list[Any]:
    """Results of the first tasks, as many as there is time for."""
    began = time.perf_counter()
    results = []

    for task in tasks:
        results.append(work(task))
        if time.perf_counter() - began >= CHUNK_SECONDS:
            break
    return results


def _begin(lifeline: Any) -> None:
    """Make a process that ends with its parent, and that leaves it to it what Ctrl-C means."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end() -> None:
        with suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


@contextmanager
def _surroundings() -> Iterator[None]:
    """Let processes that begin here find `ENVIRONMENT`, and spare them Ctrl-C, which all of a terminal receive."""
    missing = [name for name in ENVIRONMENT if not os.environ.get(name)]
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.update(dict.fromkeys(missing, "1"))
    try:
        yield
    finally:
        for name in missing:
            del os.environ[name]
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
