"""Commands `pirrht plan` and `pirrht estimate`, and what all share: read the scene, grow the tree, show progress."""

import argparse
import functools
import gc
import subprocess
import sys
import time
from dataclasses import replace
from shutil import get_terminal_size
from typing import Any

import numpy as np
from numba.core import event
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.control.settings import TREELESS, WITHOUT_SAMPLES
from pirrht.errors import OptionError, SceneError
from pirrht.geometry.scene import ROUNDING
from pirrht.jit import cache
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from sim import options, rehearsal, tree_file
from sim.cli import tables
from sim.drive.metrics import Truth
from sim.files import path_text, replaced, write_json
from sim.mjcf.footprint import collision_of
from sim.recording.reasons import shares_of
from sim.result import convergence_json, estimate_json, plan_json
from sim.scenario import Scenario, prepare
from sim.scenario.first_seen import first_seen
from sim.scenario.prepared import deviation
from sim.scenario.risk import predicted
from sim.settings import FORMS
from sim.text import counted, say

SHARE_PATHS = 2000  # optimal paths that tell the exact share of each class
LINE = "compiling kernels, {often} for each kind of robot and scene (`pirrht warm` does so ahead)"
BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g}{unit}, {remaining} left{postfix}"
COMPILING = "compiling: {n_fmt} kernels, {elapsed}"


class Progress(tqdm):  # type: ignore[misc]
    """A bar on a terminal, nothing in a pipe."""

    def __init__(self, what: str, total: float = 1.0, unit: str = "") -> None:
        wide = get_terminal_size().columns  # also where a terminal does not report its width
        super().__init__(total=total, desc=what, unit=unit, leave=False, disable=None, bar_format=BAR, ncols=wide)

    def to(self, done: float) -> None:
        """Show how much of the total is done."""
        self.update(done - self.n)


class Notice(event.TimingListener):  # type: ignore[misc]
    """Reports that the first command of an installation compiles, and adds up how long.

    From the first kernel of a run to `finish` no garbage is collected, which would take a tenth of the time or more.
    """

    def __init__(self) -> None:
        super().__init__()
        self.reported = False
        self.run: tuple[str, dict[str, Any]] | None = None  # scene and options of the run that is compiled for
        self._bar: Any = None
        self._helper: subprocess.Popen[bytes] | None = None  # compiles on another core what is needed last

    def clock(self) -> float:
        """Return a time [s] that does not count compiling."""
        return time.perf_counter() - (self.duration if self.done else 0.0)

    def on_start(self, happening: Any) -> None:
        """Report a kernel that is compiled, maybe for another one: a line, and on a terminal how many there are."""
        super().on_start(happening)
        if happening.data["dispatcher"].py_func.__module__.startswith("pirrht."):
            if not self.reported:
                self.reported = True
                tqdm.write(LINE.format(often="once" if cache.kept() else "every time"), sys.stderr)
                sys.stderr.flush()
                self._bar = tqdm(disable=None, leave=False, bar_format=COMPILING, file=sys.stderr)
            if self._bar is not None:
                self._bar.update()
            if self.run is not None:
                gc.disable()
                self._helper = rehearsal.helper(*self.run)
                self.run = None

    def finish(self) -> None:
        """Remove the count from the terminal, end what compiles on another core, and collect garbage from now on."""
        if self._bar is not None:
            self._bar.close()
        if self._helper is not None:
            self._helper.kill()
            self._helper.communicate()
            self._helper = None
        if not gc.isenabled():
            gc.freeze()  # else the first collection would search all that is left of compiling
            gc.enable()


@functools.cache
def notice() -> Notice:
    """Return the notice of this process, which from now on counts what is compiled."""
    listener = Notice()
    event.register("numba:compile", listener)
    return listener


def scenario_of(arguments: argparse.Namespace, *, loose: bool = False) -> Scenario:
    """Read the scene and the task of a command line, and put into `arguments` the scene's numbers for the rest."""
    given = vars(arguments)
    command = arguments.command
    for name, forms in FORMS.items():
        count = len(given[name] or ())
        if count and count not in forms.counts:
            more = "; runs begin at rest (`pirrht estimate --at` takes any state)" if name == "start" else ""
            raise OptionError(f"--{name} has {counted(count, 'number')}; it must be {forms.text}{more}")
    driven = command not in ("plan", "estimate")
    of_run = options.of_run(command, given)
    notice().run = arguments.scene, of_run
    scenario = prepare(arguments.scene, given=of_run, loose=loose, driven=driven)
    adapter = scenario.system.adapter
    if arguments.start and len(arguments.start) > len(adapter.places):
        spare = " ".join(adapter.pose[len(adapter.places) : len(arguments.start)])
        raise OptionError(
            f"--start has a {spare}, and {scenario.loaded.robot} has none; give {adapter.typed(adapter.places)}"
        )
    for name in ("predict", "speed_limit"):
        if given[name] is not None and not scenario.moving:
            say(f"--{name.replace('_', '-')} changes nothing here: nothing moves in this scene")
    say("\n".join(scenario.loaded.notes))
    scene, moved = scenario.loaded.scene, deviation(scenario.problem, 1.0)
    if moved > (width := float(np.hypot.reduce(scene.upper - scene.lower))):
        say(f"noise alone moves the robot by {moved:.3g} m in a second, more than the {width:.3g} m of the workspace: "
            f"is --noise {scenario.settings.noise:g} in {scenario.system.noise_in or 'its unit'}?")  # fmt: skip
    given.update(options.completed(command, given, scene.defaults))
    return scenario


def planned(
    scenario: Scenario, at: Array | None = None, *, waits: bool = False
) -> tuple[HomologyTree, list[Reference]]:
    """Return the grown tree and the references at the start or at state `at` (n,), none where a robot waits."""
    say(tables.fitting_lines(scenario))
    with Progress("plan", scenario.settings.vertices, " vertices") as bar:
        tree = scenario.grown_tree(bar.to, at)
    references = scenario.references(tree, waits=waits)
    if not references:
        past = "past moving obstacles: the robot waits for a path" if scenario.moving else "in the first map"
        say(f"no class reaches the goal from the start {past}")
    report_limit(scenario, tree)
    return tree, references


def report_limit(scenario: Scenario, tree: HomologyTree) -> None:
    """Report that a default limit gave way."""
    if tree.limit > scenario.settings.limit and scenario.settings.tree is None:
        out = f"|1 - H_i| <= {scenario.settings.limit:g} leaves out paths that are not much longer than the shortest"
        say(f"{out}: grown within {tree.limit:g} (--limit keeps to a limit)")


def report_prediction(scenario: Scenario, what: str) -> None:
    """Report that classes or an exact value rest on motions that plans only predict."""
    if scenario.moving and scenario.settings.predict != "known":
        say(f"{what} of the true motions, which plans of --predict {scenario.settings.predict} do not know")


def plan(arguments: argparse.Namespace) -> int:
    """Grow the tree and print one row per class."""
    for option in ("png", "convergence"):
        if getattr(arguments, option) is not None:
            from sim import plotting

            plotting.check(getattr(arguments, option), f"--{option}")
    scenario = scenario_of(arguments)
    scenario, known = first_seen(scenario)
    began = notice().clock()
    watched = {}

    if arguments.convergence:
        vertices = scenario.settings.vertices
        with Progress("plan", vertices, " vertices") as bar:
            tree = scenario.empty_tree(scenario.grown_tree(bar.to).limit)
            x = tree.at(scenario.start, 0.0)
            lengths = convergence_json(tree, x, vertices, every=max(1, vertices // 200), progress=bar.to)
        references = scenario.references(tree)
        watched = {"convergence": lengths}
        report_limit(scenario, tree)
    else:
        tree, references = planned(scenario)
    seconds = notice().clock() - began
    collision = predicted(scenario, tree)
    notice().finish()
    found = plan_json(scenario, tree, references, seconds, collision) | watched
    print(tables.class_table(references, scenario.homology, scenario.names, scenario.space))
    say(f"{tree.size} vertices, {tree.node_count} nodes, {found['fcl_calls']} FCL calls, {seconds:.2f} s")
    say(tables.passages_line(found["passages"]))
    if scenario.settings.risk is not None:
        say(tables.odds(scenario))
    if collision is not None:
        say(tables.chance_at_start(collision, scenario.settings))
    if arguments.output:
        with replaced(arguments.output, "tree") as stream:
            tree_file.save(tree, stream)
        print(f"tree: {path_text(arguments.output)}")
    if arguments.json:
        write_json(arguments.json, found)
    if arguments.png:
        plotting.draw_plan(arguments.png, scenario, tree, references, known)
    if arguments.convergence:
        plotting.draw_convergence(arguments.convergence, scenario.loaded.scene.name, lengths, references)
    return 0


def estimate(arguments: argparse.Namespace) -> int:
    """Estimate value and control at one state, repeated with independent samples."""
    scenario = scenario_of(arguments)
    settings = scenario.settings
    if settings.method in WITHOUT_SAMPLES:
        raise OptionError(
            f"--method {settings.method} draws no samples to estimate from; add --truth to another method"
        )
    x = state_of(arguments.at, scenario)
    time = arguments.time
    _refuse_time(scenario, x, time)
    grid = None
    if arguments.truth:
        with Progress("exact value") as bar:
            grid = scenario.truth(bar.to)
    scenario, _ = first_seen(scenario, x)
    controller = scenario.controller(None if settings.method in TREELESS else planned(scenario, x)[0])
    controller.begin(x, time)
    decisions = [controller.plan(x) for _ in range(arguments.repeat)]
    estimates, references = [one.estimate for one in decisions], decisions[-1].references
    truth = None
    if grid is not None:
        shares = shares_of(grid, decisions[-1], time, SHARE_PATHS)
        truth = replace(Truth.at(grid, x, time), shares=shares, samples=SHARE_PATHS)
    notice().finish()
    collisions = [scenario.collisions(one) for one in decisions]
    print(tables.estimate_table(estimates, [r.id for r in references], truth))
    if known := [one for one in collisions if one is not None]:
        say(tables.chance(known[0], settings) + (", of the first repeat" if len(known) > 1 else ""))
    if dead := sum(e is None for e in estimates):
        say(f"in {dead} of {len(estimates)} repeats no sample reached the goal; try more --samples, or another state")
    if truth is not None:
        report_prediction(scenario, "the exact value is that")
    say("\n".join(tables.doubts(estimates, references, scenario.problem.temperature, settings.target_error)))
    if settings.weights == "biased":
        say("--weights biased leaves the likelihood ratio out: v and shares are no estimates, however many samples")
    if arguments.json:
        write_json(arguments.json, estimate_json(scenario, references, estimates, truth, collisions))
    return 0


def _refuse_time(scenario: Scenario, x: Array, time: float) -> None:
    """Refuse a time [s] where nothing moves, or when a moving obstacle is at a state (n,)."""
    if time > 0.0 and not scenario.moving:
        raise OptionError(f"--time is {time:g}, and nothing moves in this scene; leave it out")
    place = x[scenario.system.adapter.position]
    reads = scenario.problem.dynamics.reads(scenario.space.static.kernels.turns)
    if scenario.space.moving.distance(x[list(reads)], time) <= 0.0:
        there = f"a moving obstacle is there at {time:g} s; choose another state or --time"
        raise OptionError(f"--at {' '.join(f'{v:g}' for v in place)}: {there}")


def state_of(at: list[float], scenario: Scenario) -> Array:
    """Return the state (n,) that `--at` names; missing numbers are 0, and a heading is left out where there is none."""
    adapter, where = scenario.system.adapter, " ".join(f"{v:g}" for v in at)
    pose = adapter.pose
    whole, place = (pose, pose) if adapter.bare else (adapter.states, adapter.places)
    finite = bool(np.all(np.isfinite(at)))
    if not adapter.dimension <= len(at) <= len(whole) or not finite:
        known = f"has {counted(len(at), 'number')}" if finite else f"is {where}"
        few, all_of = adapter.typed(pose[: adapter.dimension]), adapter.typed(whole)
        more = f" or the first few of {all_of}" if all_of != few else ""
        raise OptionError(f"--at {known}; it must be {few}{more}, all finite")
    x = np.array([*at, *[0.0] * (len(whole) - len(at))])
    if len(at) <= len(place):
        x = scenario.problem.dynamics.state_of(np.array([*at, *[0.0] * (len(pose) - len(at))]))
    if scenario.space.clearance(x) <= 0.0:
        raise SceneError(f"--at {where}: {why_covered(x, scenario)}; choose another state")
    if scenario.loaded.scene.goal.contains(x[adapter.position]):
        raise SceneError(f"--at {where}: this state is already in the goal; choose another")
    return x


def why_covered(x: Array, scenario: Scenario) -> str:
    """Return why the robot may not be at a state (n,): the border, an obstacle, or the margin around one."""
    scene, collision, adapter = scenario.space.scene, scenario.space.collision, scenario.system.adapter
    place = x[None, adapter.position]
    if not scene.world.contains(place[0]):
        return f"this state is outside the workspace, {adapter.borders_text(scene.lower, scene.upper)}"
    nearest = collision.nearest_walls(place, range(len(scene.obstacles)), scene.robot_radius).which[0]
    obstacle, free = scene.obstacles[nearest].name, float(collision.true_distance(place)[0]) - scene.body.radius
    if not scene.body.is_disc:
        free = float(collision_of(scene.world, scene.body).clearance(adapter.poses(x[None]))[0])
    if free < ROUNDING:
        return f'the robot collides with obstacle "{obstacle}" there'
    return (
        f'the robot is {free:.3g} m from obstacle "{obstacle}" there, and plans keep a margin of {scene.margin:.3g} m'
    )
