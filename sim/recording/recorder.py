"""Recording a run in Rerun: to a file, which misses nothing, and to viewers, which never hold it up.

Each target has a queue, and a thread that empties it into a stream of its own; the control thread only puts rows into
queues. A full queue of a file makes the control thread wait. While a run goes against the clock rows for a file are
kept for later: threads share one interpreter, and pictures take more of it than plans among many obstacles leave.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import rerun as rr

from pirrht.errors import OptionError
from pirrht.estimation.sampler import PathIntegral
from pirrht.exact.desirability import Desirability
from pirrht.planner.tree import HomologyTree
from sim.drive.episode import CLOCKED
from sim.drive.metrics import Frame
from sim.files import SHOWN, Draft, path_text, takes_as_it_comes
from sim.mjcf import Loaded
from sim.recording import viewer
from sim.recording.stage import layout
from sim.recording.subject import Subject
from sim.recording.viewer import Look, Sinks
from sim.recording.writer import Row, Writer
from sim.states import ADAPTERS

__all__ = ["Look", "Recorder", "Sinks"]

ROOM, KEPT = 256, 10_000  # rows a queue holds, and of a file while a run goes against the clock
NAP = 0.02  # pause of a thread that has nothing to do [s]
GRACE = 2.0  # for a viewer to take the last rows [s]
PATIENCE = 10.0  # after which a file that takes nothing is given up, and a viewer is queried again [s]
ATTEMPT = 0.5  # of a flush to a file [s]
DEFAULT = Look()


class ToViewer:
    """Takes rows in and writes them on a thread of its own: to a viewer as many as it can take."""

    lossless = False

    def __init__(self, subject: Subject, target: Any) -> None:
        self.dropped, self._target = 0, target  # URL, or path of a file
        self.stream = subject.stream()
        self._blueprint = layout(subject, live=not self.lossless)
        self._writer = Writer(self.stream, subject)  # what it writes is kept in memory until the target is open
        self.rows: deque[Row] = deque()  # appending takes no lock that the control thread could wait for
        self._closing = threading.Event()
        self._done = threading.Event()
        self._failure: Exception | None = None
        self._under_way = 0  # rows taken from the queue and not known to have arrived
        threading.Thread(target=self._work, name="recorder", daemon=True).start()

    def put(self, row: Row) -> None:
        """Hand over a row, unless the queue is full."""
        if self._failure is None and len(self.rows) < ROOM:
            self.rows.append(row)
        else:
            self.dropped += 1

    def close(self) -> None:
        """Let the thread finish, for which it gets little time."""
        self._closing.set()
        self._done.wait(GRACE)
        self.dropped += len(self.rows)
        if not self._done.is_set() or self._failure is not None:
            self.dropped += self._under_way
            rr.unregister_shutdown()  # Rerun's last attempt to reach a viewer may take forever

    def open(self) -> None:
        """Connect."""
        self.stream.native.connect_grpc(self._target, default_blueprint=self._blueprint)

    def deliver(self) -> None:
        """Wait for the viewer as long as it is there."""
        while not self.stream.flush(PATIENCE):
            viewer.probe(self._target)

    def end(self) -> None:
        """Close the stream."""
        self.stream.native.disconnect()

    def later(self) -> bool:
        """Return whether rows are kept until the run is over."""
        return self.lossless and CLOCKED.is_set() and len(self.rows) < KEPT

    def abandon(self) -> None:
        """Leave it alone after a failure."""

    def _work(self) -> None:
        try:
            self._write()
        except Exception as error:  # the control thread reports it, or goes on without the viewer
            self._failure = error
            rr.unregister_shutdown()
            self.abandon()
        self._done.set()
        if self._failure is not None:  # letting go of a stream waits for whoever reads it: where nobody does, for ever
            threading.Event().wait()

    def _write(self) -> None:
        opened = False
        while self.rows or not self._closing.is_set():
            if opened and self.lossless and self._writer.secure():
                self.deliver()
            if not self.rows or self.later():
                time.sleep(NAP)
                continue
            if not opened:
                self.open()
                opened = True
            self._under_way += 1
            if self._writer.add(self.rows.popleft()):  # what cannot be delivered must not pile up: one batch at a time
                self.deliver()
                self._under_way = 0
        if opened:
            self._writer.end()
            self.end()


class ToFile(ToViewer):
    """Writes everything to a file, in order, however long that takes; a device is written straight to.

    A file grows as a draft `.NAME.part` and takes its place as soon as it holds rows of the run: a run that is killed
    leaves them there. What was there before is `.NAME.old` until the recording is complete; if that fails, it returns.
    """

    lossless = True
    _published = False
    _draft: Draft | None = None
    _old: Path | None = None

    def put(self, row: Row) -> None:
        """Hand over a row, sooner or later; an OptionError if the file can no longer be written."""
        while self._failure is None and len(self.rows) >= ROOM and not self.later():
            time.sleep(0.001)
        self._check()
        self.rows.append(row)

    def close(self) -> None:
        """Let the thread finish; an OptionError if the file was not written."""
        self._closing.set()
        self._done.wait()
        self._check()

    def _check(self) -> None:
        if self._failure is None:
            return
        self._done.wait()  # until the old file is back
        reason = getattr(self._failure, "strerror", None) or self._failure
        name = path_text(self._target)
        left = f"{name} holds what was recorded until then" if self._published else "nothing was recorded"
        if self._old is not None or (not self._published and self._target.exists()):
            left = f"{name} is what it was before"
        raise OptionError(f"{name}: the recording broke off ({reason}); {left}") from self._failure

    def open(self) -> None:
        """Begin a draft next to the file."""
        if not takes_as_it_comes(self._target):
            self._draft = Draft(self._target)
            os.close(self._draft.handle)
        file = self._target if self._draft is None else self._draft.file
        options = {"default_blueprint": self._blueprint}
        saving = threading.Thread(target=self.stream.native.save, args=(file,), kwargs=options, daemon=True)
        saving.start()  # it hands on what was logged before, and never returns where that cannot be written

        def saved() -> bool:
            saving.join(ATTEMPT)
            return not saving.is_alive()

        self._wait(saved)

    def deliver(self) -> None:
        """Return once everything logged is written, and is there under the file's name, or raise OSError."""
        self._wait(lambda: self.stream.flush(ATTEMPT))
        if os.name != "nt":  # there, what is open cannot be moved
            self._publish()

    def _wait(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not done():
            if self._draft is not None:
                _probe(self._draft.target if self._published else self._draft.file)
            if time.monotonic() > deadline:
                raise TimeoutError(f"nothing could be written for {PATIENCE:g} s")

    def end(self) -> None:
        """Write the file's footer and replace the earlier file."""
        self.deliver()
        self.stream.native.disconnect()
        self._publish()
        with suppress(OSError):
            if self._old is not None:
                self._old.unlink()

    def abandon(self) -> None:
        """Restore the file that was there before."""
        if self._draft is not None:
            self._draft.discard()
            if self._old is not None:
                os.replace(self._old, self._draft.target)

    def _publish(self) -> None:
        if self._draft is not None and not self._published:
            if self._draft.target.exists():
                self._old = _set_aside(self._draft.target)
            self._draft.publish()
        self._published = True


def _probe(file: Path) -> None:
    """Write next to a file where it ends, to learn from the system why it cannot grow."""
    with tempfile.TemporaryFile(dir=file.parent, buffering=0) as probe:
        probe.seek(file.stat().st_size)
        for _ in range(2):  # the first one may be cut
            probe.write(bytes(1 << 16))


def _set_aside(file: Path) -> Path:
    """Give a file a second name, equal every time."""
    name = file.name if len(file.name) <= SHOWN else f"{file.name[:SHOWN]}.{crc32(file.name.encode()):08x}"
    old = file.with_name(f".{name}.old")
    old.unlink(missing_ok=True)
    try:
        os.link(file, old)
    except OSError:  # no file system for links: for a moment there is no file
        os.replace(file, old)
    return old


class Recorder:
    """Takes the frames of a run and records them, with its settings as properties and `grid` shown on the floor.

    `tree` is None for methods without one. `server` serves browsers, if there is one; `live` is whether a viewer shows
    the run. An OptionError reports a file that cannot be written, a viewer that does not listen or start, and an
    obstacle to lift a tree by that is not there.
    """

    def __init__(
        self, loaded: Loaded, tree: HomologyTree | None, path_integral: PathIntegral, sinks: Sinks,
        look: Look = DEFAULT, *, settings: Mapping[str, object], grid: Desirability | None = None,
    ) -> None:  # fmt: skip
        look.check(path_integral.space)
        sinks.check()
        known = dict(settings)
        if not set(loaded.states) <= set(ADAPTERS[0].pose):  # after which an exported table names its columns
            known["states"] = " ".join(loaded.states)
        if look.truth:
            known["truth"] = True
        subject = Subject(loaded=loaded, tree=tree, path_integral=path_integral, look=look, settings=known, grid=grid)
        path_integral.warm_up()
        if grid is not None:  # compile what draws optimal paths before a run would have to wait for it
            grid.shares(grid.problem.dynamics.state_of(grid.space.scene.start), samples=1)
        self._interval, self._due = 1.0 / look.hz, 0.0
        self.server = viewer.Server() if sinks.serve else None
        urls = (sinks.connect, viewer.spawn() if sinks.view else None, self.server and self.server.url)
        self._sinks = [ToViewer(subject, url) for url in urls if url is not None]
        self.live = bool(self._sinks)
        if sinks.file is not None:
            self._sinks.append(ToFile(subject, sinks.file))

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close, however the run ended; what ended it is reported first."""
        with suppress(OptionError) if kind is not None else nullcontext():
            self.close()

    @property
    def dropped(self) -> int:
        """Frames that a viewer could not take."""
        return sum(sink.dropped for sink in self._sinks)

    def log(self, frame: Frame) -> None:
        """Record a control step; an OptionError if the file can no longer be written."""
        drawn = frame.time >= self._due - 1e-9 or frame.outcome is not None
        if drawn:
            self._due = max(self._due + self._interval, frame.time)
        row = Row(frame, drawn)
        for sink in self._sinks:
            sink.put(row)

    def close(self) -> None:
        """Write all that is not written yet and close everything; an OptionError if the file could not be written."""
        for sink in self._sinks:
            sink.close()
