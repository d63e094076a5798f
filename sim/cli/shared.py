"""Shared parts of commands: read the scene, check where results go, grow the tree, show progress and compiling."""

from __future__ import annotations

import argparse
import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.jit import cache
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from sim import options
from sim.cli import tables
from sim.files import check_writable
from sim.scenario import Scenario, prepare
from sim.text import counted, say

LINE = "compiling kernels, {often} for each kind of robot and scene (`pirrht warm` does so ahead)"


class Notice(event.Listener):  # type: ignore[misc]
    """Reports that the first command of an installation compiles, and adds up how long."""

    def __init__(self) -> None:
        self.reported = False
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
        if self._depth == 0:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, happening: Any) -> None:
        """Note that it has been compiled, or cannot be."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._began

    def finish(self) -> None:
        """Remove the count from the terminal."""
        if self._bar is not None:
            self._bar.close()


@functools.cache
def notice() -> Notice:
    """That of this process, which hears from now on what is compiled."""
    listener = Notice()
    event.register("numba:compile", listener)
    return listener


def scenario_of(arguments: argparse.Namespace, *, loose: bool = False) -> Scenario:
    """The scene and the task as the command line has them, and in `arguments` the scene's numbers for the rest."""
    start, given = arguments.start, vars(arguments)
    if start is not None and len(start) not in (2, 3):
        raise OptionError(
            f"--start has {counted(len(start), 'number')}; it must be X Y, and TH of a robot with a heading; runs "
            "begin at rest (`pirrht estimate --at` takes any state)"
        )
    notice()
    settings = options.settings(arguments.command, given)
    driven = arguments.command not in ("plan", "estimate")
    scenario = prepare(arguments.scene, given=settings, loose=loose, driven=driven, **options.scene_options(given))
    if start is not None and len(start) == 3 and not scenario.problem.dynamics.angles:
        raise OptionError(f"--start has a heading, and {scenario.loaded.robot} has none; give X Y")
    for name in ("predict", "speed_limit") if not scenario.moving else ():
        if settings[name] is not None:
            say(f"--{name.replace('_', '-')} changes nothing here: nothing moves in this scene")
    for note in scenario.loaded.notes:
        say(note)
    given.update(options.completed(arguments.command, given, scenario.loaded.scene.defaults))
    return scenario


def check_outputs(arguments: argparse.Namespace, *names: str) -> None:
    """Refuse files that could not be written, before any work is done."""
    for name in names:
        if getattr(arguments, name) is not None:
            check_writable(getattr(arguments, name), f"--{name}")


def planned(
    scenario: Scenario, at: Array | None = None, *, waits: bool = False
) -> tuple[HomologyTree, list[Reference]]:
    """The grown tree and the references at the start, none where a robot waits for a path; `at`: another state (n,)."""
    say(tables.fitting_lines(scenario))
    with progress("plan", scenario.settings.vertices, " vertices") as grown:
        tree = scenario.grown_tree(grown, at)
    references = scenario.references(tree, waits=waits)
    if not references:
        say("no class reaches the goal from the start past moving obstacles: the robot waits for a path")
    if tree.limit > scenario.settings.limit and scenario.settings.tree is None:
        say(
            f"|1 - H_i| <= {scenario.settings.limit:g} leaves out paths that are not much longer than the shortest: "
            f"grown within {tree.limit:g} (--limit keeps to a limit)"
        )
    return tree, references


@contextmanager
def progress(what: str, total: float = 1.0, unit: str = "") -> Iterator[Callable[[float], Any]]:
    """A bar, on a terminal; yields a function that takes how much of the total is done."""
    with progress_bar(what, total, unit) as bar:
        yield lambda done: bar.update(done - bar.n)


def report_prediction(scenario: Scenario, what: str) -> None:
    """Report that classes or an exact value rest on motions that plans only predict."""
    if scenario.moving and scenario.settings.predict != "known":
        say(f"{what} of the true motions, which plans of --predict {scenario.settings.predict} do not know")


def progress_bar(what: str, total: float, unit: str) -> Any:
    """A bar on a terminal, nothing in a pipe."""
    style = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g}{unit} {postfix}"
    return tqdm(total=total, desc=what, unit=unit, leave=False, disable=None, bar_format=style)
