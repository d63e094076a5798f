"""What a recording's stream leads to: a file, or a viewer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from pirrht.errors import OptionError
from pirrht.files import shown
from sim.recording import viewer
from sim.recording.file import RecordingFile
from sim.recording.layout import layout
from sim.recording.stream import Stream, forget_lost_viewers
from sim.recording.subject import Subject

PATIENCE = 10.0  # after which a file that takes nothing is given up, and a viewer is asked again [s]


class Outlet(ABC):
    """Where one stream goes; used by one thread."""

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
        return OptionError(f"{shown(self._path)}: the recording broke off ({reason}); {left}")


class ToViewer(Outlet):
    """What it can take."""

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
