"""How long planning, a control step and its recording take: medians over repeats in one process, compiled before."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from sim import episode
from sim.recorder import Recorder
from sim.scenarios import Scenario, prepare

REPEATS = 5


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    figures = speed(options.scene or "slit", options.drive)
    table = [[name, f"{v:.3f}", unit] for name, (v, unit) in figures.items()]
    return ["figure", "median", "unit"], table, {name: {"median": v, "unit": u} for name, (v, u) in figures.items()}


def speed(scene: str, drive: float) -> dict[str, tuple[float, str]]:
    """Times of planning (free space, tree, polished references) and of a drive's control steps."""
    warm = prepare(scene)
    warm.grown_tree().references(warm.start)
    planning = []
    for seed in range(REPEATS):
        began = time.perf_counter()
        scenario = prepare(scene, given={"seed": seed})
        tree = scenario.grown_tree()
        tree.references(scenario.start)
        planning.append(time.perf_counter() - began)
    steps = _drive(scenario, drive, None)
    with tempfile.TemporaryDirectory() as folder:
        logged = _drive(scenario, drive, Path(folder) / "drive.rrd")
    return {
        f"planning, {scenario.settings.vertices} vertices": (float(np.median(planning)), "s"),
        "control step": (float(np.median(steps)), "ms"),
        "control step, recording": (float(np.median(logged)), "ms"),
    }


def _drive(scenario: Scenario, seconds: float, record: Path | None) -> list[float]:
    """Wall time [ms] of each control step: references, samples, control, and putting the frame in the queue."""
    tree = scenario.grown_tree()
    controller = scenario.controller(tree)
    controller.path_integral.warm_up()
    recorder = None
    if record is not None:
        recorder = Recorder(
            scenario.loaded,
            scenario.space,
            tree,
            controller.path_integral,
            file=record,
            settings={"scene": "benchmark"},
        )
    spent = []
    for frame in episode.run(scenario.plant(), controller, scenario.start, scenario.plant_rng(), max_time=seconds):
        began = time.perf_counter()
        if recorder is not None:
            recorder.log(frame)
        spent.append(1e3 * (frame.plan_seconds + time.perf_counter() - began))
    if recorder is not None:
        recorder.close()
    return spent
