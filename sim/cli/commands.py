"""Commands of the CLI by name."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

from tqdm import tqdm

from pirrht.files import path_text
from sim.cli import estimate_command, plan_command, run_command, sweep_commands, tables, warm
from sim.cli.shared import check_outputs, progress_bar, scenario_of
from sim.mjcf import load, models_folder, scene_names
from sim.mjcf.library import robot_names
from sim.rehearsal import rehearse
from sim.scenario import prepare
from sim.systems import named
from sim.text import say, width


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


def play(arguments: argparse.Namespace) -> int:
    """Drive while somebody interferes."""
    from sim.cli import play_command
    from sim.play.drive import first

    scenario = play_command.checked(arguments, lambda: scenario_of(arguments, loose=True))
    with progress_bar("plan", scenario.settings.vertices, " vertices") as bar:
        built = first(scenario, lambda size: bar.update(size - bar.n))
    rehearse(scenario, driving=True)
    warm.finish("plan", "sample")
    return play_command.play(arguments, scenario, built)


def compile_ahead(arguments: argparse.Namespace) -> int:
    """Compile what later commands need of robots."""
    for name in arguments.robots or robot_names():
        began = time.perf_counter()
        scenario = prepare("crossing" if arguments.moving else "slit", robot=name, known=warm.begin)
        rehearse(scenario)
        rehearse(scenario, driving=True)
        warm.finish("plan", "sample")
        where = "among moving obstacles" if arguments.moving else "in static scenes"
        print(f"{name}: kernels for runs {where} are compiled ({time.perf_counter() - began:.0f} s)", flush=True)
    return 0


def import_world(arguments: argparse.Namespace) -> int:
    """Turn a Gazebo world, a ROS map or a file of motions into a scene."""
    from sim.importing import scene_file
    from sim.importing.model_paths import folders_of

    check_outputs(arguments, "output")
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
            decompose=bool(arguments.decompose),
            models=[*(arguments.models or ()), *folders_of(os.environ)],
            without=arguments.without or (),
            progress=progress,
        )
    moving = f", and {imported.movers} bodies that move" if imported.movers else ""
    print(f"{path_text(imported.path)}: {imported.geoms} geoms, {imported.obstacles} of them obstacles{moving}")
    for note in imported.notes:
        say(note)
    return 0


def export(arguments: argparse.Namespace) -> int:
    """Turn a recording into a table."""
    from sim.recording import export
    from sim.recording import export as engine

    check_outputs(arguments, "output")
    engine.check_format(arguments.output)
    known = export.read(arguments.recording)
    columns = engine.table(known)
    engine.write(arguments.output, columns, known)
    print(f"{path_text(arguments.output)}: {len(known.steps)} control steps, {len(columns)} columns")
    if not known.whole:
        name, end = path_text(arguments.recording), known.steps[-1][1]
        print(f"{name} ends at {end:.2f} s without an outcome; what it holds is exported")
    return 0


def demo(_: argparse.Namespace) -> int:
    """Both noise levels of the first example, and what to make of them."""
    from sim.cli import parser
    from sim.cli.demo import demo

    return demo(lambda words: run_command.run(parser.read(words)), lambda line: say(line) if line else print())


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "demo": demo,
    "scenes": scenes,
    "plan": plan_command.plan,
    "run": run_command.run,
    "play": play,
    "warm": compile_ahead,
    "estimate": estimate_command.estimate,
    "sweep": sweep_commands.sweep,
    "report": sweep_commands.report,
    "import": import_world,
    "export": export,
}
