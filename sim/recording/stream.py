"""A Rerun recording stream that puts equal data into equal chunks in the same order, and where it goes.

A file grows as a draft `.NAME.part` and takes its place as soon as it holds rows of the run: a run that is killed
leaves them there. What was there before is `.NAME.old` until the recording is complete; if that fails, it returns.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import rerun as rr
import rerun.blueprint as rrb

from pirrht.errors import OptionError
from sim.drive.episode import IDLE, LONGEST_WAIT
from sim.files import SHOWN, Draft, path_text, takes_as_it_comes
from sim.recording import viewer

PATIENCE = 10.0  # after which a file that takes nothing is given up, and a viewer is queried again [s]
ATTEMPT = 0.5  # of a flush to a file [s]
PROBE = bytes(1 << 16)


class Stream:
    """One recording with the timelines `step` and `sim_time`.

    Args:
        orderly: keep chunks in the order in which they were logged, which files need to be compared.
    """

    def __init__(self, application: str, recording_id: str, *, orderly: bool) -> None:
        self._orderly = orderly
        self.native = rr.RecordingStream(
            application,
            recording_id=recording_id,
            send_properties=False,  # they would hold the wall time
            batcher_config=rr.ChunkBatcherConfig.NEVER(),  # chunks end where we say, not where a clock does
        )
        self.native.set_log_time_enabled(False)

    def static(self, path: str, archetype: rr.AsComponents | Sequence[rr.AsComponents]) -> None:
        """Log something, or several things together, that hold at all times."""
        together = archetype if isinstance(archetype, Sequence) else [archetype]
        self.native.log(path, *together, static=True)
        self.cut()

    def log(self, path: str, step: int, time: float, archetype: rr.AsComponents) -> None:
        """Log something at a step and simulated time [s]."""
        IDLE.wait(LONGEST_WAIT)
        self.native.set_time("step", sequence=step)
        self.native.set_time("sim_time", duration=time)
        self.native.log(path, archetype)
        self.cut()

    def columns(self, path: str, steps: Sequence[int], times: Sequence[float], columns: Iterable[Any]) -> None:
        """Log a row for each of many steps."""
        IDLE.wait(LONGEST_WAIT)
        index = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("sim_time", duration=times)]
        self.native.send_columns(path, indexes=index, columns=columns)

    def flush(self, timeout: float) -> bool:
        """Hand on everything logged so far; whether that worked within the time [s]."""
        with suppress(RuntimeError, ValueError):
            self.native.flush(timeout_sec=timeout)
            return True
        return False

    def cut(self) -> None:
        """Keep chunks in order: those that wait together leave in any; a flush in between is not waited for."""
        if self._orderly:
            self.native.flush(timeout_sec=0)


class ToFile:
    """Target that takes everything, in order, however long that takes; a device is written straight to."""

    lossless = True

    def __init__(self, path: Path, blueprint: rrb.Blueprint) -> None:
        self._path, self._blueprint = path, blueprint
        self._draft: Draft | None = None
        self._old: Path | None = None
        self._published = False

    def open(self, stream: Stream) -> None:
        """Begin a draft next to the file."""
        if not takes_as_it_comes(self._path):
            self._draft = Draft(self._path)
            os.close(self._draft.handle)
        file = self._path if self._draft is None else self._draft.file
        with_blueprint = {"default_blueprint": self._blueprint}
        saving = threading.Thread(target=stream.native.save, args=(file,), kwargs=with_blueprint, daemon=True)
        saving.start()  # it hands on what was logged before, and never returns where that cannot be written

        def saved() -> bool:
            saving.join(ATTEMPT)
            return not saving.is_alive()

        self._wait(saved)

    def deliver(self, stream: Stream) -> None:
        """Return once everything logged is written, and is there under the file's name, or raise OSError."""
        self._wait(lambda: stream.flush(ATTEMPT))
        if os.name != "nt":  # there, what is open cannot be moved
            self._publish()

    def _wait(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not done():
            if self._draft is not None:
                _probe(self._draft.target if self._published else self._draft.file)
            if time.monotonic() > deadline:
                raise TimeoutError(f"nothing could be written for {PATIENCE:g} s")

    def end(self, stream: Stream) -> None:
        """Write the file's footer; what was there before goes."""
        self.deliver(stream)
        stream.native.disconnect()
        self._publish()
        with suppress(OSError):
            if self._old is not None:
                self._old.unlink()

    def abandon(self) -> None:
        """Put back what was there before."""
        if self._draft is not None:
            self._draft.discard()
            if self._old is not None:
                os.replace(self._old, self._draft.target)

    def failed(self, error: Exception) -> OptionError:
        """Explain why, and what is there now."""
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        name = path_text(self._path)
        left = f"{name} holds what was recorded until then" if self._published else "nothing was recorded"
        if self._old is not None or (not self._published and self._path.exists()):
            left = f"{name} is what it was before"
        return OptionError(f"{name}: the recording broke off ({reason}); {left}")

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
            probe.write(PROBE)


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


class ToViewer:
    """Target that takes as much as a viewer can."""

    lossless = False

    def __init__(self, url: str, blueprint: rrb.Blueprint) -> None:
        self._url, self._blueprint = url, blueprint

    def open(self, stream: Stream) -> None:
        """Connect."""
        stream.native.connect_grpc(self._url, default_blueprint=self._blueprint)

    def deliver(self, stream: Stream) -> None:
        """Wait for the viewer as long as it is there."""
        while not stream.flush(PATIENCE):
            viewer.probe(self._url)

    def end(self, stream: Stream) -> None:
        """Close the stream."""
        stream.native.disconnect()

    def abandon(self) -> None:
        """Leave it alone."""
