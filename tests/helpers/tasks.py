"""Tasks for processes and clusters, and what is done with them; workers import this module by name."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from sim.sweeps.engine import ENVIRONMENT


@dataclass(frozen=True)
class Task:
    scene: str
    number: int
    folder: str = ""

    @property
    def point(self):
        return (self.scene,)


def wait_for(happened, patience: float = 300.0) -> None:
    deadline = time.monotonic() + patience
    while not happened() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert happened()


def square(task: Task) -> int:
    return task.number**2


def threads_of(task: Task) -> list[str | None]:
    return [os.environ.get(name) for name in ENVIRONMENT]


def held(task: Task) -> int:
    """Leaves a mark and waits for leave to end."""
    Path(task.folder, f"{task.number}-{os.getpid()}").touch()
    while not Path(task.folder, "leave").exists():
        time.sleep(0.02)
    return task.number


def gone(pid: int) -> bool:
    """Whether a process has ended, even if nobody has asked for its status."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def die_of_two(task: Task) -> int:
    """Ends its process at number 2, and at number 4 the first time that it is tried in a folder."""
    mark = Path(task.folder, "dead")
    if task.number == 2 or (task.number == 4 and task.folder and not mark.exists()):
        if task.number == 4:
            mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number


def slow(task: Task) -> int:
    time.sleep(0.3)
    return task.number
