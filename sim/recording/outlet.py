"""Outlets of a stream: a viewer, or a file while it grows.

A file grows as a draft beside its place, which it takes as soon as it holds rows of the run: a run that is killed
leaves them there. What was there before is set aside until the recording is complete, as `.NAME.old`, and set back if
the recording fails. Rerun writes into a pipe, and a thread passes on what comes out: its own writer ends at the first
error, says so on the terminal, and whoever waits for it waits for ever.
"""

from __future__ import annotations

import os
import select
import threading
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from pirrht.errors import OptionError
from sim.files import SHOWN, Draft, path_text, takes_as_it_comes
from sim.recording import viewer
from sim.recording.layout import layout
from sim.recording.stream import Stream, forget_lost_viewers
from sim.recording.subject import Subject

DOORS = Path("/dev/fd")  # descriptors as files; Windows has none
GULP = 1 << 16  # bytes taken out of the pipe at once
NAP = 0.001  # [s]
PATIENCE = 10.0  # after which a file that takes nothing is given up, and a viewer is asked again [s]


class Relay:
    """Passes bytes on to a descriptor until the writer closes its end; after an error they are thrown away.

    Args:
        target: descriptor that takes the bytes; stays open.
        save: called with the path that the writer is to open.
    """

    def __init__(self, target: int, save: Callable[[Path], None]) -> None:
        self.failure: OSError | None = None
        self._target = target
        self._turn = threading.Lock()  # held from taking bytes out of the pipe until they are written
        self._outlet, inlet = os.pipe()
        self._thread = threading.Thread(target=self._work, name="relay", daemon=True)
        self._thread.start()  # first: there may be more to save at once than a pipe holds
        try:
            save(DOORS / str(inlet))
        finally:
            os.close(inlet)  # the writer has opened it anew

    def settle(self, timeout: float) -> None:
        """Wait until what the writer has handed over is written.

        Raises:
            OSError: it could not be; TimeoutError: it took too long [s].
        """
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            if self._turn.acquire(timeout=timeout):
                idle = not self._thread.is_alive() or not _ready(self._outlet, 0)
                self._turn.release()
                if idle:
                    return self.check()
            time.sleep(NAP)
        raise TimeoutError(f"nothing could be written for {timeout:g} s")

    def check(self) -> None:
        """Raise the error that ended the writing, if there was one."""
        if self.failure is not None:
            raise self.failure

    def join(self, timeout: float) -> None:
        """Wait for the writer to close its end.

        Raises:
            OSError: not everything could be written; TimeoutError: it took too long [s].
        """
        self._thread.join(timeout)
        self.check()
        if self._thread.is_alive():
            raise TimeoutError(f"nothing could be written for {timeout:g} s")

    def _work(self) -> None:
        content = b"."
        while content:
            _ready(self._outlet, None)
            with self._turn:
                content = os.read(self._outlet, GULP)
                self._write(content)
        os.close(self._outlet)

    def _write(self, content: bytes) -> None:
        try:
            while content and self.failure is None:
                content = content[os.write(self._target, content) :]
        except OSError as error:
            self.failure = error


def _ready(descriptor: int, timeout: float | None) -> bool:
    """Return whether there is something to read, or the end, within the time [s]."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if timeout is None else 1e3 * timeout))


class RecordingFile:
    """A draft that becomes a file when it holds rows.

    Args:
        path: of the file; links are followed. A device is written straight to.
        save: called with the path that Rerun is to write to.

    Raises:
        OSError: no draft can be made.
    """

    def __init__(self, path: Path, save: Callable[[Path], None]) -> None:
        self._path = path
        self._draft = None if takes_as_it_comes(path) else Draft(path)
        self._handle = os.open(path, os.O_WRONLY) if self._draft is None else self._draft.handle
        self._relay: Relay | None = None
        self._aside: Path | None = None
        self._kept = False
        if DOORS.is_dir():
            self._relay = Relay(self._handle, save)
        else:  # Rerun writes the draft itself, and it stays one until it is complete: what is open cannot be moved
            save(path if self._draft is None else self._draft.file)

    def keep(self) -> None:
        """Put the draft, which holds rows by now, in the file's place.

        Raises:
            OSError: what was handed over so far could not be written.
        """
        if self._relay is not None:
            if not self._kept:
                self._relay.settle(PATIENCE)
                self._publish()
            self._relay.check()

    def close(self, *, whole: bool) -> None:
        """Complete the file, or if it is not whole set back what was there before; Rerun has closed its end.

        Raises:
            OSError: it could not be completed; what was there before is there again.
        """
        try:
            try:
                if self._relay is not None:
                    self._relay.join(PATIENCE)
            finally:
                os.close(self._handle)
            if whole and not self._kept:
                self._publish()
        except OSError:
            whole = False
            raise
        finally:
            self._forget() if whole else self._set_back()

    @property
    def left(self) -> str:
        """Describe what a recording that failed has left under its name."""
        name = path_text(self._path)
        if self._aside is not None or (not self._kept and self._path.exists()):
            return f"{name} is what it was before"
        return f"{name} holds what was recorded until then" if self._kept else "nothing was recorded"

    def _publish(self) -> None:
        if self._draft is not None:
            if self._draft.target.exists():
                self._aside = _set_aside(self._draft.target)
            self._draft.publish()
        self._kept = True

    def _forget(self) -> None:
        if self._aside is not None:
            with suppress(OSError):
                self._aside.unlink()

    def _set_back(self) -> None:
        if self._draft is not None:
            self._draft.discard()
            if self._aside is not None:
                os.replace(self._aside, self._draft.target)


def _set_aside(file: Path) -> Path:
    """Another name for a file, the same every time."""
    name = file.name if len(file.name) <= SHOWN else f"{file.name[:SHOWN]}.{zlib.crc32(file.name.encode()):08x}"
    aside = file.with_name(f".{name}.old")
    with suppress(FileNotFoundError):
        aside.unlink()
    try:
        os.link(file, aside)
    except OSError:  # no file system for links: for a moment there is no file
        os.replace(file, aside)
    return aside


class Outlet(ABC):
    """Destination of one stream; used by one thread."""

    lossless: ClassVar[bool]  # whether it takes everything, in order, however long that takes

    @abstractmethod
    def open(self, stream: Stream) -> None:
        """Lead the stream there."""

    @abstractmethod
    def deliver(self, stream: Stream, *, last: Callable[[], bool]) -> None:
        """Return once everything logged has left; `last` tells whether no more will come."""

    @abstractmethod
    def end(self) -> None:
        """Complete what was opened; the stream is closed."""

    @abstractmethod
    def abandon(self, stream: Stream, error: Exception) -> bool:
        """Clear up after an error; whether the stream can never be let go of."""

    @abstractmethod
    def failed(self, error: Exception) -> OptionError:
        """An error in the user's words."""


class ToFile(Outlet):
    """Everything, in the order in which it was logged."""

    lossless = True

    def __init__(self, subject: Subject, path: Path) -> None:
        self._subject, self._path = subject, path
        self._file: RecordingFile | None = None

    def open(self, stream: Stream) -> None:
        """Begin a draft beside the file."""
        blueprint = layout(self._subject, live=False)
        self._file = RecordingFile(self._path, lambda door: stream.save(door, blueprint))

    def deliver(self, stream: Stream, *, last: Callable[[], bool]) -> None:
        """Make sure that it is written, and that it is there under the file's name."""
        assert self._file is not None
        if not stream.flush(PATIENCE):
            raise TimeoutError(f"nothing could be written for {PATIENCE:g} s")
        self._file.keep()

    def end(self) -> None:
        """Complete the file."""
        assert self._file is not None
        self._file.close(whole=True)

    def abandon(self, stream: Stream, error: Exception) -> bool:
        """Set back what was there before."""
        stuck = isinstance(error, TimeoutError)
        if stuck:
            forget_lost_viewers()
        else:
            stream.close()
        if self._file is not None:
            with suppress(OSError):  # the first error is the one to tell
                self._file.close(whole=False)
        return stuck

    def failed(self, error: Exception) -> OptionError:
        """Why, and what is there now."""
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        left = "nothing was recorded" if self._file is None else self._file.left
        return OptionError(f"{path_text(self._path)}: the recording broke off ({reason}); {left}")


class ToViewer(Outlet):
    """Outlet that passes on as much as a viewer can take."""

    lossless = False

    def __init__(self, subject: Subject, url: str) -> None:
        self._subject, self._url = subject, url

    def open(self, stream: Stream) -> None:
        """Connect."""
        stream.connect(self._url, layout(self._subject, live=True))

    def deliver(self, stream: Stream, *, last: Callable[[], bool]) -> None:
        """Wait for it as long as it is there and the drive goes on."""
        while not stream.flush(PATIENCE):
            viewer.probe(self._url)
            if last():
                raise TimeoutError("the viewer did not keep up to the end")

    def end(self) -> None:
        """Nothing is left to do."""

    def abandon(self, stream: Stream, error: Exception) -> bool:
        """Let it be."""
        return True

    def failed(self, error: Exception) -> OptionError:
        """Why."""
        return OptionError(f"the viewer at {self._url} is gone ({error})")
