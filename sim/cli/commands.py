"""What each command of the CLI does."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.control.methods import TREELESS
from pirrht.errors import OptionError, SceneError
from pirrht.estimation.estimate import OTHER, Estimate
from pirrht.outcome import Outcome
from pirrht.tree import file as tree_file
from pirrht.tree.convergence import Convergence
from pirrht.tree.homology_tree import HomologyTree
from pirrht.tree.reference import Reference
from sim.cli import sweep_commands, tables, warm
from sim.drawing.colors import title
from sim.drive import episode
from sim.drive.truth import Truth, Witness
from sim.files import check_writable, write_json
from sim.mjcf import load, models_folder, scene_names
from sim.options import table as options
from sim.rehearsal import rehearse
from sim.result import estimate_json, passages_json, plan_json, run_json, settings_json
from sim.scenario import Scenario, prepare
from sim.systems import POSE, SPEED, VELOCITIES, named, typed
from sim.text import counted, say, width


def scenes(_: argparse.Namespace) -> int:
    """List the built-in scenes."""
    rows = []
    for name in scene_names():
        loaded = load(name)
        noise = loaded.scene.defaults.get("noise", named(loaded.dynamics_name).settings.noise)
        rows.append((name, loaded.robot, noise, len(loaded.scene.movers), loaded.about))
    print(tables.scene_table(rows, width()))
    print(f"\nfiles: {models_folder() / 'scenes'}; pictures of all: docs/gallery.md")
    return 0


def plan(arguments: argparse.Namespace) -> int:
    """Grow the tree and print one row per class."""
    _check_outputs(arguments, "json", "png", "convergence", "output")
    for option in ("png", "convergence"):
        path: Path | None = getattr(arguments, option)
        if path is not None:
            from sim.figures import draw

            draw.check(path, f"--{option}")
    scenario = _scenario(arguments)
    helper = warm.start(scenario.loaded.dynamics_name, sampling=False)
    clock = warm.notice().clock
    began = clock()
    convergence = None
    if arguments.convergence:
        tree, convergence = _watched(scenario)
        references = scenario.references(tree)
    else:
        tree, references = _planned(scenario)
    seconds = clock() - began
    if helper is not None:
        helper.kill()
    passages = passages_json(tree, references)
    print(tables.class_table(references, width(), scenario.homology))
    say(f"{tree.size} vertices, {tree.node_count} nodes, {scenario.space.collision.calls} FCL calls, {seconds:.2f} s")
    say(tables.passages_line(passages))
    if arguments.output:
        tree_file.save(tree, arguments.output)
        print(f"tree: {arguments.output}")
    if arguments.json:
        write_json(arguments.json, plan_json(scenario, tree, references, passages, seconds, convergence))
    if arguments.png:
        draw.draw_plan(arguments.png, scenario, tree, references)
    if convergence is not None:
        draw.draw_convergence(arguments.convergence, scenario.loaded.scene.name, convergence, references)
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Plan, drive, record and sum up."""
    _check_outputs(arguments, "json", "record", "video", "png")
    _sinks(arguments)
    scenario = _scenario(arguments)
    _look(arguments, scenario)
    settings = scenario.settings
    optimal = settings.method == "optimal"
    film = _film(arguments, scenario)
    truth = scenario.truth() if arguments.truth else None
    witness = None if truth is None else Witness(truth)
    compiling = None if optimal else warm.start(scenario.loaded.dynamics_name)
    tree, references = (None, []) if settings.method in TREELESS else _planned(scenario)
    if references:
        print(tables.class_table(references, width(), scenario.homology))
    _wait(compiling)
    driver = scenario.driver(tree, truth if truth is not None and truth.dt is None else None)
    rehearse(scenario, driving=True)
    tally = episode.Tally(settings.period)
    frames = scenario.drive(scenario.plant(), driver)
    recorder = _recorder(arguments, scenario, tree, driver.path_integral, truth)
    with closing(frames), recorder or nullcontext(), _bar("drive", settings.max_time, "s") as bar:
        for frame in frames:
            news = tally.add(frame)
            known = None if witness is None else witness.add(frame.plan)
            if recorder is not None:
                recorder.log(frame, news, known)
            if film is not None:
                film.add(frame)
            if news and frame.outcome is None:  # how it ended is in the summary
                bar.write(news)
            bar.update(round(frame.end_time - bar.n, 6))
            bar.set_postfix_str(f"class {title(tally.favourite or OTHER)}, cost {frame.cost:.2f}", refresh=False)
    warm.notice().done("sample")
    drive = tally.drive()
    result = {**drive.json(), **({} if witness is None else {"truth": witness.result()})}
    tables.summary(drive, result.get("truth"))
    if recorder is not None and recorder.live:
        result["dropped_frames"] = recorder.dropped
        print(f"{recorder.dropped} of {result['steps']} steps did not reach a viewer")
    if arguments.record:
        print(f"recording: {arguments.record}  (open it with: rerun {arguments.record})")
    if arguments.json:
        write_json(arguments.json, run_json(scenario, references, result))
    if film is not None:
        with _bar("film", film.length, " pictures") as bar:
            film.save(bar.update)
        print("film:", *(file for file in (arguments.video, arguments.png) if file is not None))
    if recorder is not None and recorder.server is not None and sys.stdout.isatty():
        print("served until Ctrl-C", flush=True)
        recorder.server.stay()
    return 0 if tally.outcome is Outcome.GOAL else 1


def estimate(arguments: argparse.Namespace) -> int:
    """What the controller would do at one state, repeated with independent samples."""
    _check_outputs(arguments, "json")
    scenario = _scenario(arguments)
    if scenario.settings.method == "optimal":
        raise OptionError("--method optimal draws no samples to estimate from; add --truth to another method")
    x = _state(arguments.at, scenario)
    compiling = warm.start(scenario.loaded.dynamics_name)
    truth = _truth(scenario, x, arguments.time) if arguments.truth else None
    tree, _ = (None, []) if scenario.settings.method in TREELESS else _planned(scenario)
    _wait(compiling)
    controller = scenario.driver(tree)
    _check_bodies(scenario, x, arguments.time)
    controller.begin(x, arguments.time)
    estimates: list[Estimate | None] = []
    references: tuple[Reference, ...] = ()
    for _ in range(arguments.repeat):
        decision = controller.plan(x)
        references = decision.references
        estimates.append(decision.estimate)
    warm.notice().done("sample")
    print(tables.estimate_table(estimates, [r.id for r in references], truth, width()))
    if any(e is None for e in estimates):
        dead = sum(e is None for e in estimates)
        remedy = "start slower" if _too_fast(scenario, controller, x) else "try more --samples"
        say(f"{dead} of {len(estimates)} repeats: no sample reached the goal; {remedy}")
    for line in tables.doubts(estimates, [r.id for r in references], scenario.settings.target_error):
        say(line)
    if scenario.settings.weights == "biased":
        say("--weights biased leaves the likelihood ratio out: v and shares are no estimates, however many samples")
    if arguments.json:
        write_json(arguments.json, estimate_json(scenario, references, estimates, truth))
    return 0


def import_world(arguments: argparse.Namespace) -> int:
    """Turn a Gazebo world, a ROS map or a file of motions into a scene."""
    from sim.importing import scene_file

    _check_outputs(arguments, "output")
    with tqdm(desc="import", leave=False, disable=None, dynamic_ncols=True) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        imported = scene_file.import_world(
            arguments.world,
            arguments.output,
            start=arguments.start,
            goal=arguments.goal,
            workspace=arguments.workspace,
            unknown=arguments.unknown,
            motion=arguments.motion,
            number=arguments.number,
            progress=progress,
        )
    moving = f", and {imported.movers} bodies that move" if imported.movers else ""
    print(f"{imported.path}: {imported.geoms} geoms, {imported.obstacles} of them obstacles{moving}")
    return 0


def export(arguments: argparse.Namespace) -> int:
    """Turn a recording into a table."""
    from sim.recording import export as engine
    from sim.recording import read

    _check_outputs(arguments, "output")
    engine.check_format(arguments.output)
    known = read.read(arguments.recording)
    columns = engine.table(known)
    engine.write(arguments.output, columns, known)
    print(f"{arguments.output}: {len(known.steps)} control steps, {len(columns)} columns")
    if not known.whole:
        print(f"{arguments.recording} ends at {known.steps[-1][1]:.2f} s without an outcome; what it holds is exported")
    return 0


def play(arguments: argparse.Namespace) -> int:
    """Drive while somebody interferes."""
    from sim.cli import play_command

    scenario = play_command.checked(arguments, lambda: _scenario(arguments, loose=True))
    compiling = warm.start(scenario.loaded.dynamics_name)
    with _bar("plan", scenario.settings.vertices, " vertices") as bar:
        built = play_command.first(scenario, lambda size: bar.update(size - bar.n))
    warm.notice().done("plan")
    _wait(compiling)
    rehearse(scenario, driving=True)
    status = play_command.play(arguments, scenario, built)
    warm.notice().done("sample")
    return status


def demo(_: argparse.Namespace) -> int:
    """Both noise levels of the first example, and what to make of them."""
    from sim.cli import parser
    from sim.cli.demo import demo

    return demo(lambda words: run(parser.read(words)), lambda line: say(line) if line else print())


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "demo": demo,
    "scenes": scenes,
    "plan": plan,
    "run": run,
    "play": play,
    "estimate": estimate,
    "sweep": sweep_commands.sweep,
    "report": sweep_commands.report,
    "import": import_world,
    "export": export,
}


def given(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the user said, by setting."""
    return options.settings(arguments.command, vars(arguments))


def _scenario(arguments: argparse.Namespace, *, loose: bool = False) -> Scenario:
    if arguments.start is not None and len(arguments.start) not in (2, 3):
        raise OptionError(
            f"--start has {counted(len(arguments.start), 'number')}; it must be X Y, and TH if the robot has a heading"
        )
    warm.notice().sampling = arguments.command != "plan"
    said = vars(arguments)
    scenario = prepare(
        arguments.scene, **options.task(said), given=given(arguments), known=warm.notice().known, loose=loose
    )
    if arguments.start is not None and len(arguments.start) == 3 and not scenario.problem.dynamics.angles:
        raise OptionError(f"--start has a heading, and {scenario.loaded.robot} has none; give X Y")
    said.update(options.completed(arguments.command, said, scenario.loaded.scene.defaults))
    return scenario


def _planned(scenario: Scenario) -> tuple[HomologyTree, list[Reference]]:
    """The grown tree and the references at the start."""
    with _bar("plan", scenario.settings.vertices, " vertices") as bar:
        tree = scenario.grown_tree(lambda size: bar.update(size - bar.n))
    references = scenario.references(tree)
    if tree.limit > scenario.settings.limit and scenario.settings.tree is None:
        no = f"no class reaches the goal from the start within |1 - H_i| <= {scenario.settings.limit:g}"
        print(f"{no}: grown within {tree.limit:g}", file=sys.stderr)
    warm.notice().done("plan")
    return tree, references


def _wait(compiling: Any) -> None:
    """Until what is compiled elsewhere is there."""
    if compiling is not None and compiling.wait() == 0:
        warm.notice().done("sample")


def _watched(scenario: Scenario) -> tuple[HomologyTree, Convergence]:
    """The grown tree, and the lengths of the best path per class from the start while it grew."""
    from pirrht.tree.convergence import grow

    tree, vertices = scenario.empty_tree(), scenario.settings.vertices
    with _bar("plan", vertices, " vertices") as bar:
        convergence = grow(
            tree,
            scenario.start,
            vertices,
            every=max(1, vertices // 200),
            progress=lambda size: bar.update(size - bar.n),
        )
    return tree, convergence


def _truth(scenario: Scenario, x: Array, time: float) -> Truth:
    """The grid's value and control at x (n,) at a time [s]."""
    return Truth.at(scenario.truth(), x, time)


def _check_bodies(scenario: Scenario, x: Array, time: float) -> None:
    """Refuse a time where nothing moves, and a place where a body is then."""
    if time > 0.0 and not scenario.moving:
        raise OptionError(f"--time is {time:g}, and nothing moves in this scene; leave it out")
    if scenario.space.crowd.clearance(x[:2], time) <= 0.0:
        raise OptionError(
            f"--at {x[0]:g} {x[1]:g}: a body that moves is there at {time:g} s; ask elsewhere or at another --time"
        )


def _state(at: list[float], scenario: Scenario) -> Array:
    system = scenario.system
    bare = set(system.states) <= set(POSE)  # then a heading is taken, and left where there is none
    whole, place = (POSE, POSE) if bare else (system.states, system.joints)
    if not 2 <= len(at) <= len(whole) or not np.all(np.isfinite(at)):
        found = (
            f"has {counted(len(at), 'number')}" if np.all(np.isfinite(at)) else f"is {' '.join(f'{v:g}' for v in at)}"
        )
        raise OptionError(f"--at {found}; it must be X Y or the first few of {typed(whole)}, all finite")
    rest = [0.0] * (len(whole) - len(at))
    x = scenario.problem.dynamics.state_of(np.array([*at, 0.0])) if len(at) <= len(place) else np.array([*at, *rest])
    where = f"--at {' '.join(f'{v:g}' for v in at)}"
    if scenario.space.clearance(x) <= 0.0:
        raise SceneError(f"{where}: this state is in collision or outside the workspace; choose another")
    if scenario.loaded.scene.goal.contains(x[:2]):
        raise SceneError(f"{where}: this state is already in the goal; choose another")
    return x


def _too_fast(scenario: Scenario, controller: Any, x: Array) -> bool:
    """Whether samples reach the goal from the same place at rest, but not from x (n,) with its speed."""
    rest = x.copy()
    rest[[i for i, name in enumerate(scenario.system.states) if name in (*VELOCITIES, *SPEED)]] = 0.0
    if np.array_equal(rest, x):
        return False
    controller.begin(rest)
    return controller.plan(rest).estimate is not None


def _sinks(arguments: argparse.Namespace) -> Any:
    """Where a recording goes; refused before any work is done if that cannot be."""
    from sim.recording.sinks import Sinks

    sinks = Sinks(file=arguments.record, connect=arguments.connect, view=arguments.view, serve=arguments.serve)
    sinks.check()
    return sinks


def _look(arguments: argparse.Namespace, scenario: Scenario) -> Any:
    """What a recording shows; refused before the plan if the scene has no such obstacle."""
    from sim.recording.look import Look

    samples, lift = arguments.record_samples, arguments.record_lift
    look = Look(hz=arguments.record_hz, samples=samples, truth=arguments.truth, lift=lift)
    look.check(scenario.space)
    return look


def _recorder(
    arguments: argparse.Namespace, scenario: Scenario, tree: HomologyTree | None, path_integral: Any, truth: Any
) -> Any:
    sinks, look = _sinks(arguments), _look(arguments, scenario)
    if not sinks:
        return None
    from sim.recording.recorder import Recorder

    settings = settings_json(scenario)
    recorder = Recorder(scenario.loaded, tree, path_integral, sinks, look, settings=settings, grid=truth)
    if recorder.server is not None:
        print(f"watch it in a browser of this machine: {recorder.server.page}", flush=True)
    return recorder


def _film(arguments: argparse.Namespace, scenario: Scenario) -> Any:
    if arguments.video is None and arguments.png is None:
        return None
    from sim.film.film import Film

    return Film(scenario.loaded, video=arguments.video, still=arguments.png)


def _check_outputs(arguments: argparse.Namespace, *options: str) -> None:
    for option in options:
        path: Path | None = getattr(arguments, option)
        if path is not None:
            check_writable(path, f"--{option}")


def _bar(what: str, total: float, unit: str) -> Any:
    style = "{desc}: {percentage:3.0f}%|{bar}| {n:.4g}/{total:.4g}{unit} {postfix}"
    return tqdm(total=total, desc=what, unit=unit, leave=False, disable=None, bar_format=style)
