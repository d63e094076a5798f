"""Recording a run in Rerun: to a file, which misses nothing, and to viewers, which never hold it up.

Each target has a queue, and a thread that empties it into a stream of its own; the control thread only puts rows into
queues. A full queue of a file makes the control thread wait. While a run goes against the clock rows for a file are
kept for later: threads share one interpreter, and pictures take more of it than plans among many obstacles leave.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import nullcontext, suppress

import rerun as rr

from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.planner.tree import HomologyTree
from sim.drive.episode import CLOCKED, Frame
from sim.drive.metrics import Truth
from sim.mjcf import Loaded
from sim.recording import viewer
from sim.recording.options import Look, Sinks
from sim.recording.stage import layout
from sim.recording.stream import Stream, ToFile, ToViewer
from sim.recording.subject import Subject
from sim.recording.writer import Row, Writer
from sim.systems import POSE

__all__ = ["Look", "Recorder", "Sinks"]

ROOM, KEPT = 256, 10_000  # rows a queue holds, and of a file while a run goes against the clock
NAP = 0.02  # pause of a thread that has nothing to do [s]
GRACE = 2.0  # for a viewer to take the last rows [s]
DEFAULT = Look()


class Sink:
    """Takes rows in and writes them to a target, which is opened when the first one comes."""

    def __init__(self, subject: Subject, target: ToFile | ToViewer) -> None:
        self.dropped = 0
        self._target = target
        self._stream = Stream(subject.application, subject.id, orderly=target.lossless)
        self._writer = Writer(self._stream, subject)
        self._writer.begin()  # kept in memory until the target is open
        self.rows: deque[Row] = deque()  # appending takes no lock that the control thread could wait for
        self._closing, self._done = threading.Event(), threading.Event()
        self._failure: Exception | None = None
        self._under_way = 0  # rows taken from the queue and not known to have arrived
        threading.Thread(target=self._work, name="recorder", daemon=True).start()

    def put(self, row: Row) -> None:
        """Hand over a row; a file takes it sooner or later or raises, a viewer only if its queue is not full."""
        while self._target.lossless and self._failure is None and len(self.rows) >= ROOM and not self._later():
            time.sleep(0.001)
        self._check()
        if self._failure is None and (self._target.lossless or len(self.rows) < ROOM):
            self.rows.append(row)
        else:
            self.dropped += 1

    def _later(self) -> bool:
        """Return whether rows are kept until the run is over."""
        return self._target.lossless and CLOCKED.is_set() and len(self.rows) < KEPT

    def close(self) -> None:
        """Let the thread finish, for which a viewer gets little time; an OptionError if a file was not written."""
        self._closing.set()
        self._done.wait(None if self._target.lossless else GRACE)
        if not self._target.lossless:
            self.dropped += len(self.rows)
            if not self._done.is_set() or self._failure is not None:
                self.dropped += self._under_way
                rr.unregister_shutdown()  # Rerun's last attempt to reach a viewer may take forever
        self._check()

    def _check(self) -> None:
        if self._failure is not None and isinstance(self._target, ToFile):
            self._done.wait()  # until the old file is back
            raise self._target.failed(self._failure) from self._failure

    def _work(self) -> None:
        try:
            self._write()
            self._done.set()
        except Exception as error:  # the control thread reports it, or goes on without the viewer
            self._failure = error
            rr.unregister_shutdown()
            self._target.abandon()
            self._done.set()
            threading.Event().wait()  # letting go of a stream waits for whoever reads it: where nobody does, for ever

    def _write(self) -> None:
        opened = False
        while self.rows or not self._closing.is_set():
            if opened and self._target.lossless and self._writer.secure():
                self._target.deliver(self._stream)
            if not self.rows or self._later():
                time.sleep(NAP)
                continue
            if not opened:
                self._target.open(self._stream)
                opened = True
            self._under_way += 1
            if self._writer.add(self.rows.popleft()):  # what cannot be delivered must not pile up: one batch at a time
                self._target.deliver(self._stream)
                self._under_way = 0
        if opened:
            self._writer.end()
            self._target.end(self._stream)


class Recorder:
    """Takes the frames of a run and records them.

    Args:
        tree: grown; None for methods without one.
        settings: of the run; kept as properties of the recording.
        grid: the exact solution, shown on the floor.

    Attributes:
        server: that serves browsers, if there is one.

    Raises:
        OptionError: the file cannot be written, no viewer listens at the URL or none can be started, or an obstacle
            to lift a tree by is not there.
    """

    def __init__(
        self, loaded: Loaded, tree: HomologyTree | None, path_integral: PathIntegral, sinks: Sinks,
        look: Look = DEFAULT, *, settings: Mapping[str, object], grid: Desirability | None = None,
    ) -> None:  # fmt: skip
        look.check(path_integral.space)
        sinks.check()
        known = dict(settings)
        if not set(loaded.states) <= set(POSE):  # after which an exported table names its columns
            known["states"] = " ".join(loaded.states)
        if look.truth:
            known["truth"] = True
        subject = Subject(loaded=loaded, tree=tree, path_integral=path_integral, look=look, settings=known, grid=grid)
        path_integral.warm_up()
        if grid is not None:  # compile what draws optimal paths before a run would have to wait for it
            grid.shares(grid.problem.dynamics.state_of(grid.space.scene.start), samples=1)
        self._interval, self._due = 1.0 / look.hz, 0.0
        self.server = viewer.Server.start() if sinks.serve else None
        served = None if self.server is None else self.server.url
        urls = (sinks.connect, viewer.spawn() if sinks.view else None, served)
        shown = layout(subject, live=True)
        self._live = [Sink(subject, ToViewer(url, shown)) for url in urls if url is not None]
        self._file = [] if sinks.file is None else [Sink(subject, ToFile(sinks.file, layout(subject, live=False)))]

    def __enter__(self) -> Recorder:
        """The recorder itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close, however the run ended; what ended it is reported first."""
        with suppress(OptionError) if kind is not None else nullcontext():
            self.close()

    @property
    def live(self) -> bool:
        """Return whether a viewer shows the run."""
        return bool(self._live)

    @property
    def dropped(self) -> int:
        """Frames that a viewer could not take."""
        return sum(sink.dropped for sink in self._live)

    def log(self, frame: Frame, news: str | None = None, truth: Truth | None = None) -> None:
        """Record a control step, with a line for the log if there is news, and the truth if it is known.

        Raises:
            OptionError: the file can no longer be written.
        """
        drawn = frame.time >= self._due - 1e-9 or frame.outcome is not None
        if drawn:
            self._due = max(self._due + self._interval, frame.time)
        row = Row.of(frame, drawn, news, truth)
        for sink in [*self._live, *self._file]:
            sink.put(row)

    def close(self) -> None:
        """Write what is left and close everything; an OptionError if the file could not be written."""
        for sink in [*self._live, *self._file]:
            sink.close()
