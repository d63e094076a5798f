"""Commands of the CLI by name, and those that make no plan themselves: lists, sweeps, reports, imports and exports."""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pirrht.errors import OptionError, printable
from sim.cli import parser, plan_command, run_command
from sim.cli.plan_command import notice
from sim.files import check_writable, path_text, refused, replaced, write_json
from sim.mjcf import load, models_folder, robot_names, scene_names
from sim.rehearsal import rehearse
from sim.scenario import prepare
from sim.systems import named
from sim.text import counted, say, table

SHOWN_ERRORS = 3
DEMO_LEVELS = (("little", 0.1), ("much", 0.3))  # noise b [m/sqrt(s)]
DEMO_PATHS = {"0,0": "through the slit", "-1,0": "around the slit, above", "0,1": "around the slit, below"}
DEMO_ENDS = {"collision": "into a wall", "timeout": "nowhere in time"}


def scenes(_: argparse.Namespace) -> int:
    """List the built-in scenes: robot, noise, number of moving obstacles, and a sentence on each."""
    rows = []
    about = ["about", "-----"]

    for name in scene_names():
        loaded = load(name)
        noise = loaded.scene.defaults.get("noise", named(loaded.dynamics_name).settings.noise)
        rows.append([name, loaded.robot, f"{noise:g}", str(len(loaded.scene.movers))])
        about.append(loaded.about)
    print(*map("{}  {}".format, table(["scene", "robot", "noise", "moving"], rows).splitlines(), about), sep="\n")
    print(f"\nfiles: {models_folder() / 'scenes'}; pictures of all: docs/gallery.md")
    return 0


def demo(_: argparse.Namespace, more: Sequence[str] = ()) -> int:
    """Run the paper's first example with both noise levels and `more` words, and print two sentences."""
    found, status = [], 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.json"
        for word, noise in DEMO_LEVELS:
            print(f"{word} noise: pirrht run slit --noise {noise:g}\n")
            words = ["run", "slit", "--noise", f"{noise:g}", "--json", str(file), *more]
            status |= run_command.run(parser.read(words))
            found.append(json.loads(file.read_text()))
            print()
    print(*demo_sentences(*found), sep="\n")
    return status


def demo_sentences(little: dict[str, Any], much: dict[str, Any]) -> list[str]:
    """Return the two sentences to take along, from the JSON of both runs."""
    one, two = (DEMO_ENDS.get(r["outcome"]) or DEMO_PATHS.get(r["executed_class"], "elsewhere") for r in (little, much))
    (_, low), (_, high) = DEMO_LEVELS
    return [
        f"1. The plan was the same; with noise b = {low:g} the robot went {one}, with b = {high:g} {two}.",
        "2. Noise decides the worth of a path, the mean of exp(-cost / lambda) over what may happen on it: a short "
        "path on which most samples hit a wall loses to a longer one on which they arrive.",
    ]


def warm(arguments: argparse.Namespace) -> int:
    """Compile kernels that later commands need of robots."""
    scene, where = ("crossing", "among moving obstacles") if arguments.moving else ("slit", "in static scenes")
    for name in arguments.robots or robot_names():
        began = time.perf_counter()
        notice().run = scene, {"robot": name}
        scenario = prepare(scene, robot=name)
        rehearse(scenario, driving=True)
        notice().finish()
        print(f"{name}: kernels for runs {where} are compiled ({time.perf_counter() - began:.0f} s)", flush=True)
    return 0


def sweep(arguments: argparse.Namespace) -> int:
    """Run many seeds, methods and noise levels: a table on the terminal, and rows on disk."""
    from sim.report import rendering, summary
    from sim.sweeps import sweep as engine
    from sim.sweeps.dataset import Dataset

    grid, folder = engine.parse(vars(arguments)), arguments.output
    if arguments.scheduler is not None:
        from sim.sweeps import cluster

        cluster.probe(arguments.scheduler)
    if folder is None and arguments.again:
        raise OptionError("--again repeats runs of a dataset; add its folder, -o DIR")
    run = partial(engine.sweep, jobs_at_once=arguments.jobs, scheduler=arguments.scheduler)
    if folder is None:
        records = run(grid.jobs())
    else:
        dataset = Dataset(folder)
        jobs = engine.checked(grid.jobs())
        scenes = {job.label: job.digest for job in jobs}
        noises = {name: list(dict.fromkeys(job.noise for job in jobs if job.label == name)) for name in scenes}
        requested = {"methods": list(grid.methods), "noise": noises, "seeds": [grid.seeds.start, grid.seeds.stop]}
        dataset.check(grid.settings, scenes)
        with dataset.locked():
            dataset.begin(grid.settings, scenes, requested)
            records = run(jobs, dataset=dataset, again=arguments.again)
    print(rendering.figures(*summary.summed(records)))
    if arguments.json:
        write_json(arguments.json, records)
    errors = [printable((str(r["error"]).splitlines() or [""])[0]) for r in records if r["outcome"] is None]
    if folder is not None:
        print(f"{path_text(folder)}: {counted(len(records), 'run')}, {len(errors)} of them ended with an error")
    if errors:
        often = [f"  {count} x {error}" for error, count in Counter(errors).most_common(SHOWN_ERRORS)]
        again = ["the same command with --again repeats them"] if folder is not None else []
        print(f"{counted(len(errors), 'run')} ended with an error:", *often, *again, sep="\n", file=sys.stderr)
    return 1 if errors else 0


def report(arguments: argparse.Namespace) -> int:
    """Sum up a sweep: on the terminal, as Markdown and as a page."""
    from sim.report import summary as engine
    from sim.report.rendering import markdown, page, pictures, terminal
    from sim.sweeps.dataset import Dataset

    folder: Path = arguments.output or arguments.folder

    known = engine.report(Dataset(arguments.folder))
    text = folder / "report.md"
    web = folder / "report.html"

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a name that is no text
        raise refused("--output", folder, error) from None
    for file in (text, web):
        check_writable(file, "--output", follow=False)
    try:
        drawn = pictures(known)
    except OptionError as error:
        drawn = {}
        print(f"pirrht: {error}; report.html has no pictures", file=sys.stderr)
    print(terminal(known))
    for file, content in ((text, markdown(known)), (web, page(known, drawn))):
        with replaced(file, "--output", follow=False) as stream:
            stream.write(content.encode())
        print(f"written: {path_text(file)}")
    if arguments.json is not None:
        write_json(arguments.json, known)
    return 0


def import_world(arguments: argparse.Namespace) -> int:
    """Turn a Gazebo world, a ROS map or bag, or a file of motions into a scene."""
    from sim.importing import scene_file
    from sim.importing.sdf_files import folders_of

    words = {name: value for name, value in vars(arguments).items() if name not in ("command", "world", "output")}
    words |= {"models": [*(arguments.models or ()), *folders_of(os.environ)], "without": arguments.without or ()}
    words["topics"] = arguments.topics or ()
    imported = scene_file.import_world(arguments.world, arguments.output, **words)
    moving = f", and {counted(imported.movers, 'moving obstacle')}" if imported.movers else ""
    print(f"{path_text(imported.path)}: {imported.geoms} geoms, {imported.obstacles} of them obstacles{moving}")
    for note in imported.notes:
        say(note)
    return 0


def export(arguments: argparse.Namespace) -> int:
    """Turn a recording into a table, or into messages of ROS 2."""
    from sim.recording import export as engine

    engine.check_format(arguments.output)
    known = engine.read(arguments.recording)
    if arguments.output.suffix == engine.MCAP:
        from sim.ros import mcap

        counts = mcap.write(arguments.output, known, engine.shown(arguments.recording))
        what = f"{counted(sum(counts.values()), 'message')} on {counted(len(counts), 'topic')}"
    else:
        engine.write(arguments.output, columns := engine.table(known), known)
        what = f"{len(columns)} columns"
    print(f"{path_text(arguments.output)}: {len(known.steps)} control steps, {what}")
    if not known.whole:
        end = f"ends at {known.steps[-1][1]:.2f} s without an outcome"
        print(f"{path_text(arguments.recording)} {end}; all that it holds is exported")
    return 0


def ros(arguments: argparse.Namespace) -> int:
    """Plan for a robot of a ROS 2 graph until Ctrl-C, or --once until it has arrived; the robot stands at the end."""
    from sim.cli import ros_command

    return ros_command.ros(arguments)


PLANS = (plan_command.plan, plan_command.estimate, run_command.run, run_command.play)
COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    **{command.__name__: command for command in (*PLANS, ros, demo, scenes, warm, sweep, report, export)},
    "import": import_world,
}
