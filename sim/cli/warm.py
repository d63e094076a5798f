"""Compiling ahead and on the second core: the sampler's kernels are built while this process builds the planner's.

`python -m sim.cli.warm ROBOT [--moving] [--plan]` builds what samples of a robot need, or what shortens its paths, and
leaves it in the cache on disk. It ends with its standard input, so that it does not outlive whoever started it.
"""

from __future__ import annotations

import functools
import hashlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core import event
from tqdm import tqdm

import pirrht
from pirrht.jit import cache
from pirrht.problem import Problem
from sim.systems import BUILT_IN, System, named

LINE = "compiling kernels, {often} for each kind of robot and scene (`pirrht warm` does so ahead)"


class Notice(event.Listener):  # type: ignore[misc]
    """Reports why the first command of an installation is slow, and adds up how long that was."""

    def __init__(self) -> None:
        self.reported = False
        self.helper: subprocess.Popen[bytes] | None = None  # what compiles on the other core
        self.key: str | None = None  # of what moves, once it is known
        self.seconds = 0.0  # that it spent compiling
        self._depth, self._began = 0, 0.0
        self._bar: Any = None

    def report(self) -> None:
        """Report that kernels are being compiled: a line, and on a terminal how many there are so far."""
        if not self.reported:
            self.reported = True
            _say(LINE.format(often="once" if cache.kept() else "every time"))
            style = "compiling: {n_fmt} kernels, {elapsed}"
            self._bar = tqdm(disable=None, leave=False, bar_format=style, file=sys.stderr)

    def known(self, system: System, problem: Problem) -> None:
        """Take note of what moves."""
        self.key = key_of(system, problem)

    def noted(self, what: str) -> bool:
        """Return whether kernels for "plan" or "sample" of what moves are noted to be there."""
        return self.key is not None and bool(cache.load(f"{what}-{self.key}", bool))

    def done(self, *what: str) -> None:
        """Note that kernels for "plan" or "sample" of what moves have been compiled."""
        self.close()
        for one in what if self.key is not None else ():
            cache.save(f"{one}-{self.key}", True)

    def close(self) -> None:
        """Remove the count from the terminal."""
        if self._bar is not None:
            self._bar.close()

    def clock(self) -> float:
        """A time [s] that stands still while kernels are compiled."""
        return time.perf_counter() - self.seconds

    def on_start(self, happening: Any) -> None:
        """A kernel is compiled, maybe for another one that is."""
        if happening.data["dispatcher"].py_func.__module__.startswith("pirrht."):
            self.report()
            if self._bar is not None:
                self._bar.update()
        if self._depth == 0:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, happening: Any) -> None:
        """It has been compiled, or cannot be."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began


def key_of(system: System, problem: Problem) -> str | None:
    """Hash the system's functions, its dynamics, and the sources of this package: the key of notes of compiled kernels.

    None if its kernels cannot be kept.
    """
    d = problem.dynamics
    parts = [system.name, str((d.n, d.m, d.stratonovich, bool(problem.scene.movers))), _sources()]
    for function in _functions(problem):
        name = cache.identity(function)
        if name is None:
            return None
        parts.append(name)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]


def _functions(problem: Problem) -> Iterator[Callable[..., Any]]:
    """Yield the parts of somebody's system that kernels close over."""
    d = problem.dynamics
    blocks = [None, None] if d.input_form else [d.control_block, d.diffusion_block]
    for one in (d.drift, *blocks, d.input_matrix, d.homing, problem.q):
        if callable(one):
            yield one


@functools.cache
def _sources() -> str:
    """Version, and when each source of the package was written: after an edit, notes say nothing."""
    root = Path(pirrht.__file__).parent
    written = [(path.relative_to(root).as_posix(), path.stat().st_mtime_ns) for path in sorted(root.rglob("*.py"))]
    return f"{pirrht.__version__} {written}"


def _say(line: str) -> None:
    """Write a line beside progress bars."""
    tqdm.write(line, sys.stderr)
    sys.stderr.flush()


@functools.cache
def notice() -> Notice:
    """That of this process, which hears from now on what is compiled."""
    listener = Notice()
    event.register("numba:compile", listener)
    return listener


def begin(system: System, problem: Problem, *, sampling: bool = True) -> None:
    """Compile elsewhere what this process needs last, unless that is noted to be there or cannot be kept."""
    notice().known(system, problem)
    moving = bool(problem.scene.movers)
    if system.name not in BUILT_IN or not cache.kept() or notice().noted("sample" if sampling else "plan"):
        return
    if moving and not sampling:  # paths in space and time are shortened by other kernels, which take little
        return
    words = [system.name] + ["--moving"] * moving + ["--plan"] * (not sampling)
    notice().helper = subprocess.Popen(
        [sys.executable, "-P", "-m", "sim.cli.warm", *words],  # -P: nothing is imported from the current folder
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def finish(*what: str) -> None:
    """Note that "plan" or "sample" is there, and end what compiles elsewhere: this process has all that it needs."""
    notice().done(*what)
    helper, notice().helper = notice().helper, None
    if helper is not None:
        helper.kill()
        helper.communicate()


def integral_of(dynamics_name: str, *, moving: bool) -> Any:
    """Make the sampler of one kind of dynamics in a small room, where an obstacle moves or none does."""
    from pirrht.estimation.assembly import path_integral
    from pirrht.estimation.sampling import Sampling
    from pirrht.freespace import FreeSpace
    from sim.rehearsal import BUSY_ROOM, ROOM

    system, room = named(dynamics_name), BUSY_ROOM if moving else ROOM
    settings = system.settings
    drawing = Sampling(dt=settings.dt, first=min(settings.period, settings.dt), samples=20)
    return path_integral(system.problem(room, settings), FreeSpace.of(room), drawing)


def compile_rest(dynamics_name: str, *, moving: bool) -> None:
    """Compile what runs of one kind of dynamics need, in the order opposite to that of the process that plans."""
    integral = integral_of(dynamics_name, moving=moving)
    integral.warm_up(guides=False)
    if not moving:
        compile_shortening(dynamics_name)
    integral.proposals.warm_up()


def compile_shortening(dynamics_name: str) -> None:
    """Compile what shortens paths in static scenes."""
    from pirrht.freespace import FreeSpace
    from pirrht.planner.shorten import shorten
    from pirrht.steering.edges import EdgeChecker
    from sim.rehearsal import ROOM

    system = named(dynamics_name)
    problem = system.problem(ROOM, system.settings)
    steering = system.steered(problem)
    start = steering.vertex_of(problem.dynamics.state_of(ROOM.start))
    goal = start.copy()
    goal[:2] = ROOM.goal.center
    shorten(steering.connect(start[None], goal[None]), steering, EdgeChecker.of(FreeSpace.of(ROOM), steering))


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who holds the other end of the pipe decides
    threading.Thread(target=_end_with_input, daemon=True).start()
    if "--plan" in sys.argv:
        compile_shortening(sys.argv[1])
    else:
        compile_rest(sys.argv[1], moving="--moving" in sys.argv)
