"""Figures that depend on the machine: how long planning, a control step and its recording take.

    python scripts/benchmark.py speed [--scene slit] [--json FILE]

Medians over repeats in one process after compilation; quote ratios from one run, not single times.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from sim import episode, present
from sim.recorder import Recorder
from sim.scenarios import Scenario, prepare

REPEATS = 5


def main() -> int:
    """Print a table; with --json also write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["speed"])
    parser.add_argument("--scene", default="slit")
    parser.add_argument("--drive", type=float, default=2.0, help="simulated seconds of the drives that are timed")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    figures = speed(options.scene, options.drive)
    print(
        present.table(["figure", "median", "unit"], [[name, f"{v:.3f}", unit] for name, (v, unit) in figures.items()])
    )
    if options.json:
        present.write_json(options.json, {name: {"median": v, "unit": unit} for name, (v, unit) in figures.items()})
    return 0


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


if __name__ == "__main__":
    raise SystemExit(main())
