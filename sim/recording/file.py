"""The file of a recording while it grows.

It grows as a draft beside the file, which takes the file's place as soon as it holds rows of the drive: a run that is
killed leaves them there. What was there before is set aside until the recording is complete, as `.NAME.old`, and set
back if the recording fails.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from pirrht.files import SHOWN, Draft, shown, takes_as_it_comes
from sim.recording import relay

PATIENCE = 10.0  # after which a disk that takes nothing is given up [s]


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
        self._draft = None if takes_as_it_comes(path) else Draft.beside(path)
        self._handle = os.open(path, os.O_WRONLY) if self._draft is None else self._draft.handle
        self._relay: relay.Relay | None = None
        self._aside: Path | None = None
        self._kept = False
        if relay.DOORS.is_dir():
            self._relay = relay.Relay(self._handle, save)
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
        """What a recording that failed has left under its name."""
        name = shown(self._path)
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
