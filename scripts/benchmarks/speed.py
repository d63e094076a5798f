"""Speed of rollouts, of planning and of a drive's control steps, beside other libraries where there are any.

Everything is timed in one process, compiled before, and takes turns; figures are medians. Columns: the figure, how
many times ours it takes, the rate, effective samples per second, and what is needed to judge it.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks import moving, planners, rollouts, systems
from benchmarks.timing import row

from sim.recording.recorder import Recorder, Sinks
from sim.rehearsal import rehearse
from sim.scenario import Scenario, prepare

REPEATS = 5
HEADER = ["figure", "median", "unit", "over ours", "rate", "effective/s", "note"]
PARTS = {"rollouts": rollouts.rows, "planners": planners.rows}
PERIODS = 300  # of a plant that are timed
SCENES = ("slit", "clutter", "crossing")


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of all parts, or of the one that is asked for."""
    parts = {**PARTS, "drive": drive}
    if options.part in ALONE:
        parts = {options.part: ALONE[options.part]}
    table: list[list[str]] = []
    values: dict[str, Any] = {}
    for name in [options.part] if options.part else parts:
        found, values[name] = parts[name](options)
        table += found
    return HEADER, table, values


def plant(options: argparse.Namespace) -> tuple[list[list[str]], dict[str, Any]]:
    """Table and JSON of a physics step of the plant, without the control law: processor time."""
    figures = {scene: physics_step(scene) for scene in ([options.scene] if options.scene else SCENES)}
    table = [[f"step of the plant, {name}", f"{1e6 * spent:.1f}", "us", *4 * ["-"]] for name, spent in figures.items()]
    return table, {name: {"median": seconds, "unit": "s"} for name, seconds in figures.items()}


def physics_step(scene: str) -> float:
    """Processor time of a step under noise alone [s]: the least of some repeats, since others use the machine."""
    scenario = prepare(scene)
    driven, still = scenario.plant(), np.zeros(scenario.problem.dynamics.m)
    spent = []
    for seed in range(REPEATS + 1):  # the first one loads
        rng, steps, began = np.random.default_rng(seed), 0, time.process_time()
        driven.reset(scenario.start)
        for _ in range(PERIODS):
            advance = driven.advance(lambda x, s: still, rng)
            steps += len(advance.states)
            if advance.outcome is not None:
                driven.reset(scenario.start)
        spent.append((time.process_time() - began) / steps)
    return float(min(spent[1:]))


def drive(options: argparse.Namespace) -> tuple[list[list[str]], dict[str, Any]]:
    """Table and JSON of planning and of a drive's control steps."""
    figures = speed(options.scene or "slit", options.drive)
    table = [row(name, seconds) for name, seconds in figures.items()]
    return table, {name: {"median": seconds, "unit": "s"} for name, seconds in figures.items()}


def speed(scene: str, seconds: float) -> dict[str, float]:
    """Seconds of planning (free space, tree, shortened references) and of a drive's control steps."""
    warm = prepare(scene)
    warm.grown_tree().references(warm.start)
    planning = []
    for seed in range(REPEATS):
        began = time.perf_counter()
        scenario = prepare(scene, given={"seed": seed})
        tree = scenario.grown_tree()
        tree.references(scenario.start)
        planning.append(time.perf_counter() - began)
    steps = _drive(scenario, seconds, None)
    with tempfile.TemporaryDirectory() as folder:
        logged = _drive(scenario, seconds, Path(folder) / "drive.rrd")
    return {
        f"planning, {scenario.settings.vertices} vertices": float(np.median(planning)),
        "control step": float(np.median(steps)),
        "control step, recording": float(np.median(logged)),
    }


def _drive(scenario: Scenario, seconds: float, record: Path | None) -> list[float]:
    """Wall time [s] of each control step: references, samples, control, and putting the frame in the queue."""
    tree = scenario.grown_tree()
    rehearse(scenario, driving=True)
    driver, timed = scenario.driver(tree), scenario.with_settings(max_time=seconds)
    recorder = None
    if record is not None:
        sinks, settings = Sinks(file=record), {"scene": "benchmark"}
        recorder = Recorder(scenario.loaded, tree, driver.path_integral, sinks, settings=settings)
    spent = []
    for frame in timed.drive(timed.plant(), driver):
        began = time.perf_counter()
        if recorder is not None:
            recorder.log(frame)
        spent.append(frame.plan_seconds + time.perf_counter() - began)
    if recorder is not None:
        recorder.close()
    return spent


ALONE = {"systems": systems.rows, "moving": moving.rows, "plant": plant}  # of no table but their own
