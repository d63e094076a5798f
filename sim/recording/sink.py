"""One target of a recording: a queue, and the thread that empties it into a stream of its own.

The control thread only puts rows into queues. A file takes all of them, and a full queue makes the sender wait; a
viewer never holds the sender up and may lose some. While a drive runs against the clock rows for a file are kept for
later: threads of a process share one interpreter, and pictures take more of it than plans among many bodies leave.
"""

from __future__ import annotations

import threading
import time
from collections import deque

from sim.drive.clock import URGENT
from sim.recording.outlet import Outlet
from sim.recording.step_row import Row
from sim.recording.stream import Stream, forget_lost_viewers
from sim.recording.subject import Subject
from sim.recording.writer import Writer

ROOM = 256  # rows a queue holds
KEPT = 256 * 2**20  # what rows that are kept for later may hold on to [bytes]
NAP = 0.02  # pause of a thread that has nothing to do [s]
GRACE = 2.0  # what a viewer gets to take the last rows [s]


class Sink:
    """Takes rows in and writes them to an outlet, which is opened when the first one comes."""

    def __init__(self, subject: Subject, outlet: Outlet) -> None:
        self.dropped = 0
        self._outlet = outlet
        self._stream = Stream(subject.application, subject.id, orderly=outlet.lossless)
        self._writer = Writer(self._stream, subject)
        self._writer.begin()  # kept in memory until the outlet is open
        self._rows: deque[Row] = deque()  # appending takes no lock that the control thread could wait for
        self._closing, self._done = threading.Event(), threading.Event()
        self._failure: Exception | None = None
        self._come = self._gone = 0  # what rows hold on to that were put in, and taken out [bytes]
        self._under_way = 0  # rows taken from the queue and not known to have arrived
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def put(self, row: Row) -> None:
        """Hand over a row; a file takes it sooner or later, a viewer only if there is room.

        Raises:
            OptionError: the file can no longer be written.
        """
        while self._outlet.lossless and self._full() and self._failure is None:
            time.sleep(0.001)
        self._check()
        if self._failure is None and not self._full():
            self._come += row.size
            self._rows.append(row)
        else:
            self.dropped += 1

    @property
    def waiting(self) -> int:
        """Rows that will be written, and are not yet."""
        return 0 if self._done.is_set() else len(self._rows)

    def _later(self) -> bool:
        """Whether rows are kept for when the drive is over."""
        return self._outlet.lossless and URGENT.clocked and self._come - self._gone < KEPT

    def _full(self) -> bool:
        return len(self._rows) >= ROOM and not self._later()

    def close(self) -> None:
        """Let the thread finish; a viewer gets little time for it.

        Raises:
            OptionError: the file could not be written.
        """
        self._closing.set()
        self._done.wait(None if self._outlet.lossless else GRACE)
        if not self._outlet.lossless:
            finished = self._done.is_set() and self._failure is None
            self.dropped += len(self._rows) + (0 if finished else self._under_way)
            if not finished:
                forget_lost_viewers()
        self._check()

    def _check(self) -> None:
        if self._failure is not None and self._outlet.lossless:
            self._done.wait()  # until what can be mended is mended
            raise self._outlet.failed(self._failure) from self._failure

    def _work(self) -> None:
        held = False
        try:
            self._write()
        except Exception as error:  # the control thread reports it, or goes on without the viewer
            self._failure = error
            held = self._outlet.abandon(self._stream, error)
        self._done.set()
        if held:
            # Letting go of a stream waits for whoever reads it: where that is nobody, hold it until the process ends.
            threading.Event().wait()

    def _write(self) -> None:
        opened = False
        while self._rows or not self._closing.is_set():
            if opened and self._outlet.lossless and self._writer.secure():
                self._deliver()
            if not self._rows or self._later():
                time.sleep(NAP)
                continue
            if not opened:
                self._outlet.open(self._stream)
                opened = True
            self._under_way += 1
            row = self._rows.popleft()
            self._gone += row.size
            if self._writer.add(row):
                self._deliver()
                self._under_way = 0
        if opened:
            self._writer.end()
            self._outlet.end()

    def _deliver(self) -> None:
        """See a batch off before the next one is drawn: what cannot be taken must not pile up."""
        self._outlet.deliver(self._stream, last=self._closing.is_set)
