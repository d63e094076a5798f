"""Commands `pirrht plan` and `pirrht estimate`, and what all share: read the scene, grow the tree, show progress."""

from __future__ import annotations

import argparse
import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba.core import event
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.control.settings import TREELESS
from pirrht.errors import OptionError, SceneError
from pirrht.estimation.estimate import Estimate
from pirrht.jit import cache
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from sim import options, tree_file
from sim.cli import tables
from sim.drive.truth import Truth
from sim.files import check_writable, path_text, write_json
from sim.result import convergence_json, estimate_json, plan_json
from sim.scenario import Scenario, prepare
from sim.systems import POSE, typed
from sim.text import counted, say, width

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


def plan(arguments: argparse.Namespace) -> int:
    """Grow the tree and print one row per class."""
    check_outputs(arguments, "json", "png", "convergence", "output")
    for option in ("png", "convergence"):
        if getattr(arguments, option) is not None:
            from sim import figures

            figures.check(getattr(arguments, option), f"--{option}")
    scenario = scenario_of(arguments)
    if scenario.settings.method in TREELESS:
        say(f"--method {scenario.settings.method} plans without a tree: this is the tree of pi-rrht")
    began, lengths = notice().clock(), None
    if arguments.convergence:
        tree, vertices = scenario.empty_tree(), scenario.settings.vertices
        with progress("plan", vertices, " vertices") as grown:
            lengths = convergence_json(tree, scenario.start, vertices, every=max(1, vertices // 200), progress=grown)
        references = scenario.references(tree)
    else:
        tree, references = planned(scenario)
    seconds = notice().clock() - began
    notice().finish()
    found = plan_json(scenario, tree, references, seconds)
    print(tables.class_table(references, width(), scenario.homology))
    say(f"{tree.size} vertices, {tree.node_count} nodes, {found['fcl_calls']} FCL calls, {seconds:.2f} s")
    say(tables.passages_line(found["passages"]))
    if arguments.output:
        tree_file.save(tree, arguments.output)
        print(f"tree: {path_text(arguments.output)}")
    if arguments.json:
        more = {} if lengths is None else {"convergence": lengths}
        write_json(arguments.json, {**found, **more})
    if arguments.png:
        figures.draw_plan(arguments.png, scenario, tree, references)
    if lengths is not None:
        figures.draw_convergence(arguments.convergence, scenario.loaded.scene.name, lengths, references)
    return 0


def estimate(arguments: argparse.Namespace) -> int:
    """Estimate value and control at one state, repeated with independent samples."""
    check_outputs(arguments, "json")
    scenario = scenario_of(arguments)
    if scenario.settings.method == "optimal":
        raise OptionError("--method optimal draws no samples to estimate from; add --truth to another method")
    x, time = state_of(arguments.at, scenario), arguments.time
    if time > 0.0 and not scenario.moving:
        raise OptionError(f"--time is {time:g}, and nothing moves in this scene; leave it out")
    if scenario.space.moving.distance(x[:2], time) <= 0.0:
        raise OptionError(
            f"--at {x[0]:g} {x[1]:g}: a moving obstacle is there at {time:g} s; choose another state or --time"
        )
    truth = None
    if arguments.truth:
        with progress("exact value") as solved:
            truth = Truth.at(scenario.truth(solved), x, time)
    tree, _ = (None, []) if scenario.settings.method in TREELESS else planned(scenario, x)
    controller = scenario.driver(tree)
    controller.begin(x, time)
    estimates: list[Estimate | None] = []
    references: tuple[Reference, ...] = ()
    for _ in range(arguments.repeat):
        decision = controller.plan(x)
        references = decision.references
        estimates.append(decision.estimate)
    notice().finish()
    print(tables.estimate_table(estimates, [r.id for r in references], truth, width()))
    if dead := sum(e is None for e in estimates):
        say(f"{dead} of {len(estimates)} repeats: no sample reached the goal; try more --samples, or another state")
    if truth is not None:
        report_prediction(scenario, "the exact value is that")
    for line in tables.doubts(estimates, references, scenario.problem.temperature, scenario.settings.target_error):
        say(line)
    if scenario.settings.weights == "biased":
        say("--weights biased leaves the likelihood ratio out: v and shares are no estimates, however many samples")
    if arguments.json:
        write_json(arguments.json, estimate_json(scenario, references, estimates, truth))
    return 0


def state_of(at: list[float], scenario: Scenario) -> Array:
    """The state (n,) that `--at` names; missing numbers are 0, and a heading is left out where there is none."""
    system, finite = scenario.system, bool(np.all(np.isfinite(at)))
    bare = set(system.states) <= set(POSE)
    whole, place = (POSE, POSE) if bare else (system.states, system.joints)
    where = " ".join(f"{v:g}" for v in at)
    if not 2 <= len(at) <= len(whole) or not finite:
        found = f"has {counted(len(at), 'number')}" if finite else f"is {where}"
        raise OptionError(f"--at {found}; it must be X Y or the first few of {typed(whole)}, all finite")
    if len(at) <= len(place):
        x = scenario.problem.dynamics.state_of(np.array([*at, 0.0]))
    else:
        x = np.array([*at, *[0.0] * (len(whole) - len(at))])
    if scenario.space.clearance(x) <= 0.0:
        raise SceneError(f"--at {where}: this state is in collision or outside the workspace; choose another")
    if scenario.loaded.scene.goal.contains(x[:2]):
        raise SceneError(f"--at {where}: this state is already in the goal; choose another")
    return x
