"""Compiling on the second core: after installation the sampler's kernels are built while the planner's are.

`python -m sim.cli.warm DYNAMICS [--sampling|--among]` builds what shortens paths of one kind of dynamics, or what
drives need beside that where nothing or something moves, and leaves it in the cache on disk: that takes about as long
as what the process that plans has left to do.
It ends with its standard input, so that it does not outlive whoever started it, however that one ends.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import functools
from typing import Any

from numba.core import event
from tqdm import tqdm

from pirrht.compiled import cache
from pirrht.problem import Problem
from sim.cli.compile_work import Work
from sim.mjcf.load import Loaded
from sim.systems import BUILT_IN, System, named

# Modules of kernels that take long, by which one knows whether they have been compiled.
PLANNER, POINT, OTHERS = "extend", "block", "loops"
LATE, SLACK, ASKED = 1.5, 5.0, 1.0  # times what was said, and so much more, is late; how often one looks [s]
PLANNING, SAMPLING, LITTLE = 20, 15, 5  # how long they take where nothing else runs, and anything else [s]


class Notice(event.Listener):  # type: ignore[misc]
    """Tells in one line why the first command of an installation is slow, and adds up how long that was."""

    def __init__(self) -> None:
        self.told = False
        self.sampling = False  # whether this process will sample
        self.work: Work | None = None  # of the system, once it is known
        self.seconds = 0.0  # that it spent compiling
        self._depth, self._began = 0, 0.0
        self._told_at, self._late = 0.0, 0.0  # when it was said how long it takes, and when that is said again [s]

    def tell(self) -> None:
        """Say that kernels are being compiled; once per process."""
        if self.told:
            return
        self.told = True
        left = 0
        if self.work is None or not self.work.among:
            left += PLANNING * (not cache.cached(PLANNER))
            left += SAMPLING * (self.sampling and not any(map(cache.cached, (POINT, OTHERS))))
        own = 0 if self.work is None else self.work.seconds(self.sampling)
        kept = cache.kept() and (self.work is None or self.work.key is not None)
        whose = f", most of them for {self.work.called}" if self.work is not None and own > left else ""
        often = "once" if kept else "every time"
        seconds = left + own or LITTLE
        self._told_at = time.perf_counter()
        self._late = self._told_at + LATE * seconds + SLACK
        _say(f"compiling kernels, {often}: about {seconds} s{whose}")

    def tell_if_late(self) -> None:
        """Say that it takes longer than was said, and again when it has taken twice as long as that."""
        now = time.perf_counter()
        if not self.told or now < self._late:
            return
        self._late = 2.0 * now - self._told_at
        _say(
            f"still compiling kernels: {now - self._told_at:.0f} s so far, more than this takes where nothing else runs"
        )

    def wait(self, compiling: subprocess.Popen[bytes]) -> int:
        """The exit status of what is compiled elsewhere; tells if it is late."""
        while True:
            try:
                return compiling.wait(ASKED)
            except subprocess.TimeoutExpired:
                self.tell_if_late()

    def known(self, system: System, problem: Problem) -> None:
        """Take note of what moves."""
        self.work = Work.of(system, problem)

    def done(self, *what: str) -> None:
        """Remember that kernels for "plan" or "sample" of what moves have been compiled."""
        if self.work is not None:
            self.work.done(*what)

    def clock(self) -> float:
        """A time [s] that stands still while kernels are compiled."""
        return time.perf_counter() - self.seconds

    def on_start(self, happening: Any) -> None:
        """A kernel is compiled, maybe for another one that is."""
        if happening.data["dispatcher"].py_func.__module__.startswith("pirrht."):
            self.tell()
            self.tell_if_late()
        if self._depth == 0:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, happening: Any) -> None:
        """It has been compiled, or cannot be."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began


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


def sampler(dynamics_name: str) -> str:
    """The module of kernels that samples a system."""
    from pirrht.rollouts.point.block import is_point

    system = named(dynamics_name)
    return POINT if is_point(system.dynamics(system.settings)) else OTHERS


def shortening(dynamics_name: str) -> str:
    """The module of kernels that shortens a system's paths."""
    from pirrht.rollouts.point.block import is_point
    from pirrht.systems.unicycle import Unicycle

    system = named(dynamics_name)
    dynamics = system.dynamics(system.settings)
    if isinstance(dynamics, Unicycle):
        return "dubins_shortcut"
    return "polyline" if is_point(dynamics) else PLANNER  # paths of others are shortened by what made them


def start(loaded: Loaded, *, sampling: bool = True) -> subprocess.Popen[bytes] | None:
    """Begin to compile elsewhere what this process needs last; None if nothing is to compile, or cannot be kept."""
    dynamics_name = loaded.dynamics_name
    if dynamics_name not in BUILT_IN or not cache.kept():
        return None
    if loaded.scene.movers:  # paths in space and time are shortened by other kernels, which take little
        work, words = notice().work, ["--among"]
        if not sampling or work is None or work.noted("sample"):
            return None
    else:
        words = ["--sampling"] if sampling else []
        if cache.cached((sampler if sampling else shortening)(dynamics_name)):
            return None
    notice().tell()
    command = [sys.executable, "-m", "sim.cli.warm", dynamics_name, *words]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class OneWay:
    """What a controller asks of a tree, without growing one: a single path, straight into the goal."""

    limit, size = 1.0, 0

    def __init__(self, space: Any, steering: Any, *, shortened: bool) -> None:
        self.space, self.steering, self._shortened = space, steering, shortened
        self.homology = steering.homology(space)

    def references(self, x: Any, **_: Any) -> list[Any]:
        """The path from x (n,)."""
        from pirrht.shortening.shorten import polish
        from pirrht.tree.reference import Reference

        x = self.steering.vertex_of(x)
        goal = x.copy()
        goal[:2] = self.space.scene.goal.center
        path = self.steering.connect(x[None], goal[None])
        if self._shortened:
            path = polish(path, self.steering, self.space)
        none = (0,) * self.space.homology.M
        signature, trajectory = self.space.homology.signature(x, none), self.steering.trajectory(path)
        return [Reference(winding=none, signature=signature, trajectory=trajectory)]


def compile_rest(dynamics_name: str, *, sampling: bool) -> None:
    """Compile what shortens paths or, for drives of one kind of dynamics, what samples: by three steps of one."""
    import numpy as np

    from pirrht.control.controller import Controller
    from pirrht.estimation.sampling import Sampling
    from pirrht.freespace import FreeSpace
    from sim.drive import episode
    from sim.drive.executor import Analytic
    from sim.rehearsal import ROOM

    system, space = named(dynamics_name), FreeSpace.of(ROOM)
    settings = system.settings
    problem = system.problem(ROOM, settings)
    tree = OneWay(space, system.steered(problem), shortened=not sampling)
    x = problem.dynamics.state_of(ROOM.start)
    if not sampling:
        tree.references(x)
        return
    drawing = Sampling(dt=settings.dt, first=min(settings.period, settings.dt), samples=20)
    controller = Controller(problem, space, tree, drawing, rng=np.random.default_rng(0))  # type: ignore[arg-type]
    controller.path_integral.warm_up()
    plant = Analytic(problem, space.collision.clearance, period=settings.period)
    list(episode.run(plant, controller, x, np.random.default_rng(0), max_time=3 * settings.period))


def compile_among(dynamics_name: str) -> None:
    """Compile what guides and samples of one kind of dynamics need where bodies move."""
    from pirrht.estimation.sampler import PathIntegral
    from pirrht.estimation.sampling import Sampling
    from pirrht.freespace import FreeSpace
    from sim.rehearsal import BUSY_ROOM

    system = named(dynamics_name)
    problem = system.problem(BUSY_ROOM, system.settings)
    PathIntegral(problem, FreeSpace.of(BUSY_ROOM), Sampling(samples=20)).warm_up()


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who holds the other end of the pipe decides
    threading.Thread(target=_end_with_input, daemon=True).start()
    if "--among" in sys.argv:
        compile_among(sys.argv[1])
    else:
        compile_rest(sys.argv[1], sampling="--sampling" in sys.argv)
