"""Compiling on the second core: after installation the sampler's kernels are built while the planner's are.

`python -m sim.cli.warm DYNAMICS` builds the kernels of one kind of dynamics and leaves them in the cache on disk. It ends
with its standard input, so that it does not outlive whoever started it, however that one ends.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from functools import cache
from typing import Any

from numba.core import event
from tqdm import tqdm

from pirrht.compiled import jit

# Modules of kernels that take long, by which one knows whether they have been compiled.
PLANNER, SAMPLER = "extend", {"single_integrator": "block", "unicycle": "loops"}
PLANNING, SAMPLING, LITTLE = 20, 15, 5  # how long they take where nothing else runs, and anything else [s]


class Notice(event.Listener):  # type: ignore[misc]
    """Tells in one line why the first command of an installation is slow, and adds up how long that was."""

    def __init__(self) -> None:
        self.told = False
        self.sampling = False  # whether this process will sample
        self.seconds = 0.0  # that it spent compiling
        self._depth, self._began = 0, 0.0

    def tell(self) -> None:
        """Say that kernels are being compiled; once per process."""
        if self.told:
            return
        self.told = True
        left = PLANNING * (not jit.cached(PLANNER))
        left += SAMPLING * (self.sampling and not any(map(jit.cached, SAMPLER.values())))
        often = "once" if jit.kept() else "every time"
        tqdm.write(f"compiling kernels, {often}: about {left or LITTLE} s", sys.stderr)
        sys.stderr.flush()

    def clock(self) -> float:
        """A time [s] that stands still while kernels are compiled."""
        return time.perf_counter() - self.seconds

    def on_start(self, happening: Any) -> None:
        """A kernel is compiled, maybe for another one that is."""
        if happening.data["dispatcher"].py_func.__module__.startswith("pirrht."):
            self.tell()
        if self._depth == 0:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, happening: Any) -> None:
        """It has been compiled, or cannot be."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began


@cache
def notice() -> Notice:
    """That of this process, which hears from now on what is compiled."""
    listener = Notice()
    event.register("numba:compile", listener)
    return listener


def start(dynamics_name: str) -> subprocess.Popen[bytes] | None:
    """Begin to compile in another process, if there is anything to compile; wait for it before sampling."""
    if jit.cached(SAMPLER[dynamics_name]) or not jit.kept():
        return None
    notice().tell()
    command = [sys.executable, "-m", "sim.cli.warm", dynamics_name]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def compile_sampler(dynamics_name: str) -> None:
    """Compile what drives of one kind of dynamics need for sampling."""
    import numpy as np

    from pirrht.estimation.sampler import PathIntegral
    from pirrht.estimation.sampling import Sampling
    from pirrht.freespace import FreeSpace
    from pirrht.geometry.scene import Goal, Scene
    from sim.scenario import pose
    from sim.settings import ROBOT_DEFAULTS

    scene = Scene(
        name="warm",
        lower=np.zeros(2),
        upper=np.full(2, 4.0),
        obstacles=(),
        goal=Goal(center=np.array([3.0, 2.0]), radius=0.3),
        start=np.array([1.0, 2.0, 0.0]),
        robot_radius=0.2,
    )
    settings = ROBOT_DEFAULTS[dynamics_name]
    PathIntegral(pose(dynamics_name, scene, settings), FreeSpace.of(scene), Sampling()).warm_up()


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who holds the other end of the pipe decides
    threading.Thread(target=_end_with_input, daemon=True).start()
    compile_sampler(sys.argv[1])
