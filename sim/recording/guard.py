"""Runs a command until standard input ends, so that it does not outlive whoever started it, however that one ends.

`python -P guard.py COMMAND ARGUMENT ...`: by file and with the standard library alone, from any folder.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from types import FrameType

PATIENCE = 0.5  # what a command gets to end by itself [s]; a server has nothing to save


def main(command: list[str]) -> int:
    """Run the command; its exit status."""
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)

    def stop(*_: int | FrameType | None) -> None:
        end(process)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who holds the other end of the pipe decides
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), stop)
    threading.Thread(target=_end_with_input, args=[process], daemon=True).start()
    status = process.wait()
    end(process, signal.SIGKILL)  # whatever it has started and left behind
    return status


def end(process: subprocess.Popen[bytes], how: int = signal.SIGTERM) -> None:
    """End a process that leads a session, and those that it started."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, how)
    else:
        process.terminate()


def _end_with_input(process: subprocess.Popen[bytes]) -> None:
    while sys.stdin.buffer.read(4096):
        pass
    end(process)
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        end(process, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
