"""The command `pirrht run`: one drive, watched and recorded."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import closing, nullcontext
from typing import Any

from pirrht.control.settings import TREELESS
from pirrht.estimation.estimate import OTHER
from pirrht.files import path_text
from pirrht.outcome import Outcome
from pirrht.planner.tree import HomologyTree
from sim.cli import tables, warm
from sim.cli.shared import (
    as_they_stand,
    check_outputs,
    growing,
    planned,
    progress_bar,
    scenario_of,
    solving,
    unforeseen,
)
from sim.drawing.colors import title
from sim.drive.truth import ExactReference
from sim.files import write_json
from sim.rehearsal import rehearse
from sim.result import run_json, settings_json
from sim.scenario import Scenario
from sim.text import say, width


def run(arguments: argparse.Namespace) -> int:
    """Plan, drive, record and sum up."""
    check_outputs(arguments, "json", "record", "video", "png")
    _sinks(arguments)
    scenario = scenario_of(arguments)
    _look(arguments, scenario)
    settings = scenario.settings
    film = _film(arguments, scenario)
    with solving() as progress:
        truth = scenario.truth(progress) if arguments.truth else None
    exact = None if truth is None else ExactReference(truth)
    tree, references = (None, []) if settings.method in TREELESS else planned(scenario, waits=True)
    if references:
        print(tables.class_table(references, width(), scenario.homology))
        as_they_stand(scenario)
    say(tables.odds(scenario))
    with solving() as progress:
        driver = scenario.driver(tree, truth if truth is not None and truth.dt is None else None, progress)
    rehearse(scenario, driving=True)
    warm.finish("sample")
    if settings.grow and not settings.real_time and tree is not None and settings.grow > tree.size:
        say(f"--grow {settings.grow}: the drive waits while the tree of {tree.size} vertices grows between two plans")
    bar = progress_bar("drive", settings.max_time, "s")
    frames = scenario.drive(scenario.plant(), driver, growing(bar))
    recorder = _recorder(arguments, scenario, tree, driver.path_integral, truth)
    with closing(frames), recorder or nullcontext(), bar:
        for frame in frames:
            known = None if exact is None else exact.add(frame.plan)
            if recorder is not None:
                recorder.log(frame, frame.news, known)
            if film is not None:
                film.add(frame, driver.path_integral)
            if frame.news and frame.outcome is None:  # how it ended is in the summary
                bar.write(frame.news)
            bar.update(round(frame.end_time - bar.n, 6))
            bar.set_postfix_str(
                f"class {title(frame.metrics.favourite or OTHER)}, cost {frame.cost:.2f}", refresh=False
            )
        if recorder is not None:
            _wait(recorder)
    drive = frame.metrics.result()
    result = {**drive.json(), **({} if exact is None else {"truth": exact.result()})}
    tables.summary(drive, result.get("truth"))
    if truth is not None:
        unforeseen(scenario)
    if recorder is not None and recorder.live:
        result["dropped_frames"] = recorder.dropped
        print(f"{recorder.dropped} of {result['steps']} steps did not reach a viewer")
    if arguments.record:
        print(f"recording: {path_text(arguments.record)}  (open it with: rerun {path_text(arguments.record)})")
    if arguments.json:
        write_json(arguments.json, run_json(scenario, references, result))
    if film is not None:
        with progress_bar("film", film.length, " pictures") as bar:
            film.save(bar.update)
        for what, file in (("film", arguments.video), ("picture", arguments.png)):
            if file is not None:
                print(f"{what}: {path_text(file)}")
    if recorder is not None and recorder.server is not None and sys.stdout.isatty():
        print("served until Ctrl-C", flush=True)
        recorder.server.stay()
    return 0 if frame.outcome is Outcome.GOAL else 1


def _wait(recorder: Any) -> None:
    """A bar, on a terminal, until what a drive against the clock has left to record is written."""
    whole = recorder.waiting
    with progress_bar("recording", whole, " steps") as bar:
        while (left := recorder.waiting) > 0:
            bar.update(whole - left - bar.n)
            time.sleep(0.1)


def _sinks(arguments: argparse.Namespace) -> Any:
    """Check and return where a recording goes, before any work is done."""
    from sim.recording.options import Sinks

    sinks = Sinks(file=arguments.record, connect=arguments.connect, view=arguments.view, serve=arguments.serve)
    sinks.check()
    return sinks


def _look(arguments: argparse.Namespace, scenario: Scenario) -> Any:
    """Check and return what a recording shows, before the plan."""
    from sim.recording.options import Look

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
