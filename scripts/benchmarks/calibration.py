"""Are the standard errors right? Plans at random states of random scenes against the exact grid.

Every plan begins a drive of its own: what an earlier one learned would make them depend on each other. A state's
room is its clearance over b sqrt(1 s), what noise moves the robot in a second: little room is hard. An error is
"within 2" if it is less than twice the standard error that the same plan claims; 68.3, 95.4 and, for beyond 3,
0.3 % are nominal for each of v, u_x and u_y, 91.1 % for both components of u within 2. Biases are means over plans,
that of u along u*. A bad state is one where more than a tenth of the plans lie beyond 3.
Truth has an error of its own: the last lines hold it against a grid of half the spacing in the first scene, and
tell the greatest difference there, and the greatest in standard errors of a plan (under `over 3`).
With --part car truth is a million samples, see `calibration_car`; with --part moving obstacles move, see
`calibration_moving`; with --part mazes scenes are mazes, see `calibration_mazes`; with --part rectangle the robot is
one, see `calibration_rectangle`.
"""

import argparse
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks import calibration_plot
from benchmarks.calibration_table import HEADER, summaries, text_of, truth_errors, truth_text
from benchmarks.first_plan import controller_of, first_plan
from benchmarks.pool import spread
from benchmarks.scenes import places_of, scenario_of

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import OptionError
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario, prepare

NOISES = (0.1, 0.2, 0.3)
SCENES, STATES, PLANS = 30, 12, 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One scene and what is asked there; scenes do not depend on each other."""

    seed: int  # of the scene, its states, its tree and its plans
    file: str | None  # a scene instead
    at: tuple[tuple[float, ...], ...]  # states of it, instead of random ones
    states: int
    plans: int
    noises: tuple[float, ...]
    threads: int | None
    check: bool  # whether truth is held against a finer grid
    near_goal: float | None  # random states lie so near the goal's disc [m]


def _scenario(file: str | None, seed: int, threads: int | None = None) -> Scenario:
    given = {"seed": seed, "threads": threads}
    return scenario_of(seed, given) if file is None else prepare(file, given=given)


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON; with --png also a picture."""
    if options.part is not None:
        part = import_module(f"benchmarks.calibration_{options.part}")
        found: tuple[list[str], list[list[str]], object] = part.rows(options)
        return found
    states = collect(options)
    table_rows = summaries(states)
    if options.png is not None:
        calibration_plot.draw(options.png, states, lambda state: _scenario(state["file"], state["seed"]))
    truth = truth_errors(states)
    table = [text_of(row) for row in table_rows] + [truth_text(row) for row in truth]
    return HEADER, table, {"table": table_rows, "truth": truth, "states": states}


def jobs(options: argparse.Namespace) -> list[Job]:
    """One per scene."""
    shared = {
        "plans": options.plans or PLANS,
        "states": options.states or STATES,
        "noises": tuple(options.noises or NOISES),
        "threads": 1 if options.workers > 1 else None,
        "at": tuple(map(tuple, options.at or ())),
        "near_goal": options.near_goal,
    }
    if options.scene is not None:
        return [Job(seed=options.first_seed, file=str(options.scene), check=True, **shared)]
    if options.at:
        raise OptionError("--at needs the scene that it lies in: give --scene")
    seeds = range(options.first_seed, options.first_seed + (options.scenes or SCENES))
    return [Job(seed=seed, file=None, check=seed == seeds[0], **shared) for seed in seeds]


def collect(options: argparse.Namespace) -> list[dict[str, Any]]:
    """One record per state and noise."""
    return [record for records in spread(looked_at, jobs(options), options.workers, "scenes") for record in records]


def looked_at(job: Job) -> list[dict[str, Any]]:
    """Records of a scene's states, noise by noise; the tree is grown once."""
    found, quiet = list[dict[str, Any]](), _scenario(job.file, job.seed, job.threads)
    tree = quiet.grown_tree()
    points = np.array(job.at) if job.at else places_of(quiet.space, job.states, job.seed, job.near_goal)
    for noise in job.noises:
        scenario = quiet.with_settings(noise=noise)
        truth = Desirability.of(scenario.problem, scenario.space)
        controller = controller_of(scenario, tree)
        controller.path_integral.warm_up()
        records = [_record(scenario, truth, controller, x, job) for x in points]
        if job.check:
            _hold_against_finer(scenario, truth, points, records)
        found += records
    return found


def _record(scenario: Scenario, truth: Desirability, controller: Controller, x: Array, job: Job) -> dict[str, Any]:
    """What `job.plans` plans say at x (2,), each the first of a drive, and what is true there."""
    plans = [first_plan(controller, x) for _ in range(job.plans)]
    clearance, noise = scenario.space.clearance(x), scenario.settings.noise
    return {
        "scene": Path(job.file).stem if job.file else f"random{job.seed}",
        "file": job.file,
        "seed": job.seed,
        "x": x.tolist(),
        "noise": noise,
        "radius": scenario.loaded.scene.robot_radius,
        "clearance": clearance,
        "room": clearance / noise,
        "v": float(truth.value(x)),
        "u": truth.control(x).tolist(),
        "finer": None,
        "plans": [plan for plan in plans if plan is not None],
        "without": sum(plan is None for plan in plans),
    }


def _hold_against_finer(scenario: Scenario, truth: Desirability, points: Array, records: list[dict[str, Any]]) -> None:
    """Note value and control of a grid of half the spacing, where one can be had."""
    try:
        finer = Desirability.of(scenario.problem, scenario.space, spacing=0.5 * truth.spacing)
    except OptionError:
        return
    for x, record in zip(points, records, strict=True):
        record["finer"] = {"v": float(finer.value(x)), "u": finer.control(x).tolist()}
