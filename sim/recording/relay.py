"""A pipe that Rerun writes into, and the thread that writes what comes out to where it belongs.

Rerun's own writer ends at the first error, says so on the terminal, and whoever waits for it waits for ever.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from pathlib import Path

DOORS = Path("/dev/fd")  # descriptors as files; Windows has none
GULP = 1 << 16  # bytes taken out of the pipe at once
NAP = 0.001  # [s]


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
    """Whether there is something to read, or the end, within the time [s]."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if timeout is None else 1e3 * timeout))
