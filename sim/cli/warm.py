"""Compiling ahead and on the second core: the sampler's kernels are built while this process builds the planner's.

`python -m sim.cli.warm SCENE ROBOT [--plan]` builds what samples in a scene need, or what shortens paths there, and
leaves it in the cache on disk. It ends with its standard input, so that it does not outlive whoever started it.
"""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

from numba.core import event
from tqdm import tqdm

from pirrht.jit import cache

LINE = "compiling kernels, {often} for each kind of robot and scene (`pirrht warm` does so ahead)"


class Notice(event.Listener):  # type: ignore[misc]
    """Reports that the first command of an installation compiles, adds up how long, and has another core help."""

    def __init__(self) -> None:
        self.reported = False
        self.helper: subprocess.Popen[bytes] | None = None
        self.words: list[str] = []  # that another process is started with once something is compiled; empty: none is
        self.seconds = 0.0  # spent compiling
        self._depth, self._began = 0, 0.0
        self._bar: Any = None

    def clock(self) -> float:
        """A time [s] that does not count compiling."""
        return time.perf_counter() - self.seconds

    def on_start(self, happening: Any) -> None:
        """Report a kernel that is compiled, maybe for another one: a line, and on a terminal how many there are."""
        if happening.data["dispatcher"].py_func.__module__.startswith("pirrht."):
            if not self.reported:
                self.reported = True
                tqdm.write(LINE.format(often="once" if cache.kept() else "every time"), sys.stderr)
                sys.stderr.flush()
                style = "compiling: {n_fmt} kernels, {elapsed}"
                self._bar = tqdm(disable=None, leave=False, bar_format=style, file=sys.stderr)
            if self._bar is not None:
                self._bar.update()
            if self.words and self.helper is None and cache.kept():
                self.helper = subprocess.Popen(
                    [sys.executable, "-P", "-m", "sim.cli.warm", *self.words],  # -P: imports nothing of this folder
                    stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                )  # fmt: skip
        if self._depth == 0:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, happening: Any) -> None:
        """Note that it has been compiled, or cannot be."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began

    def finish(self) -> None:
        """Remove the count from the terminal, and end what compiles elsewhere: this process has all that it needs."""
        if self._bar is not None:
            self._bar.close()
        helper, self.helper, self.words = self.helper, None, []
        if helper is not None:
            helper.kill()
            helper.communicate()


@functools.cache
def notice() -> Notice:
    """That of this process, which hears from now on what is compiled."""
    listener = Notice()
    event.register("numba:compile", listener)
    return listener


def compile_for(scene: str, robot: str | None, *, sampling: bool) -> None:
    """Compile what samples of a robot need, in the order opposite to that of the process that plans; or shortening."""
    from pirrht.estimation.assembly import path_integral
    from pirrht.estimation.sampling import Sampling
    from pirrht.freespace import FreeSpace
    from sim.mjcf import load
    from sim.rehearsal import BUSY_ROOM, ROOM
    from sim.systems import named

    loaded = load(scene, robot=robot)
    system, room = named(loaded.dynamics_name), BUSY_ROOM if loaded.scene.movers else ROOM
    problem, space, settings = system.problem(room, system.settings), FreeSpace.of(room), system.settings
    if sampling:
        drawing = Sampling(dt=settings.dt, first=min(settings.period, settings.dt), samples=20)
        integral = path_integral(problem, space, drawing)
        integral.warm_up(guides=False)
    if not loaded.scene.movers:  # other kernels shorten paths in space and time, and take little
        _compile_shortening(system, problem, space)
    if sampling:
        integral.proposals.warm_up()


def _compile_shortening(system: Any, problem: Any, space: Any) -> None:
    from pirrht.planner.shorten import shorten
    from pirrht.steering.edges import EdgeChecker

    steering = system.steered(problem)
    start = steering.vertex_of(problem.dynamics.state_of(problem.scene.start))
    goal = start.copy()
    goal[:2] = problem.scene.goal.center
    shorten(steering.connect(start[None], goal[None]), steering, EdgeChecker.of(space, steering))


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who holds the other end of the pipe decides
    threading.Thread(target=_end_with_input, daemon=True).start()
    words = sys.argv[1:]
    compile_for(words[0], words[1] or None, sampling="--plan" not in words)
