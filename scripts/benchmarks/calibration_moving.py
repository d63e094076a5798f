"""Plans among moving bodies at random states and times against the exact grid: value, control, and their errors.

The built-in scenes in which bodies move, one that is given, or random ones (`--scenes`). Times are uniform up to half
a second after the last row of any motion, places stratified by clearance as those of `calibration`. Every plan begins a
drive of its own, for which the tree gains some vertices at each state. `1 %` counts states where the mean of the plans'
v is so near the grid's, and `worst` tells the farthest of them [%]. `contested` counts further states at which no class
has nine tenths of the weight, and `shares off` is the greatest difference there between the share of a class in the
samples of 40 to 600 plans together, until it is known to a point, and how many of the grid's paths take it [points],
`in s.e.` that of the likeliest class in standard errors; `a plan's off` takes the mean of what single plans say, which
is a ratio of sums over few samples that weigh.
`--png` draws coverage and errors over room, and one scene with its states.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from benchmarks import calibration_plot
from benchmarks.calibration_table import HEADER as COLUMNS
from benchmarks.calibration_table import by_noise_and_scene, summary, text_of
from benchmarks.contested import CANDIDATES, apart, contested, in_errors, mean_of, pooled_of
from benchmarks.first_plan import controller_of, first_plan
from benchmarks.oblique_scene import oblique_scenario
from benchmarks.pool import spread
from benchmarks.scenes import places_of, random_states

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario, prepare

SCENES = ("crossing", "pincer", "closing_door")
NOISES, STATES, PLANS = (0.1, 0.2, 0.3), 20, 10
AFTER = 0.5  # of the last row [s]
FREE = 0.005  # clearance from what moves at least [m]
NEAR = 0.01  # share of v
HEADER = [
    f"{COLUMNS[0].split(',')[0]}, scene",
    *COLUMNS[1:],
    "1 %",
    "worst",
    "contested",
    "shares off",
    "in s.e.",
    "a plan's off",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One scene at one noise."""

    scene: str | int  # a name, a file, or the seed of a random one
    noise: float
    seed: int
    states: int
    plans: int
    threads: int | None
    near_goal: float | None  # states lie so near the goal's disc [m]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    found, where = collect(options)
    table, values = [], []
    for noise, name, some in by_noise_and_scene(found):
        off = [_off(s) for s in some if s["plans"]]
        near = int(np.sum(np.abs(off) <= NEAR)) if off else 0
        worst = float(100.0 * max(off, key=abs)) if off else float("nan")
        there = [s for s in where if s["noise"] == noise and name in (s["scene"], "all")]
        shares = {
            "contested": len(there),
            "shares": 100.0 * max((apart(pooled_of(one), one["shares"]) for one in there), default=np.nan),
            "shares_errors": max(map(in_errors, there), default=np.nan),
            "shares_alone": 100.0 * max((apart(mean_of(one["plans"]), one["shares"]) for one in there), default=np.nan),
        }
        values.append({"noise": noise, "scene": name, **summary(some), "near": near, "worst": worst, **shares})
        cells = text_of({**values[-1], "from": 0.0, "to": None})
        table.append(
            [
                f"{noise:g}, {name}",
                *cells[1:],
                f"{near}/{len(some)}",
                f"{worst:+.2f}",
                str(len(there)),
                *(f"{shares[key]:.1f}" for key in ("shares", "shares_errors", "shares_alone")),
            ]
        )
    if options.png is not None:
        calibration_plot.draw(options.png, found, lambda state: _scenario(state["of"], {}))
    return HEADER, table, {"table": values, "states": found, "contested": where}


Records = list[dict[str, Any]]


def collect(options: argparse.Namespace) -> tuple[Records, Records]:
    """One record per scene, noise, state and time, and those of contested states."""
    scenes: Sequence[str | int] = SCENES if options.scene is None else (str(options.scene),)
    if options.scenes:
        scenes = range(options.first_seed, options.first_seed + options.scenes)
    shared = {
        "seed": options.first_seed, "states": options.states or STATES, "plans": options.plans or PLANS,
        "threads": 1 if options.workers > 1 else None, "near_goal": options.near_goal,
    }  # fmt: skip
    todo = [Job(scene=scene, noise=noise, **shared) for scene in scenes for noise in options.noises or NOISES]
    found = list(spread(looked_at, todo, options.workers, "scenes x noises"))
    return [one for records, _ in found for one in records], [one for _, records in found for one in records]


def looked_at(job: Job) -> tuple[Records, Records]:
    """Records of a scene at one noise, and those of its contested states."""
    given = {"seed": job.seed, "threads": job.threads, "noise": job.noise}
    scenario = _scenario(job.scene, given)
    truth = Desirability.of(scenario.problem, scenario.space)
    controller = controller_of(scenario, scenario.grown_tree())
    controller.path_integral.warm_up()
    asked = states_and_times(scenario, job)
    found = [_record(scenario, truth, controller, x, t, job) for x, t in asked]
    if job.near_goal is not None:
        return found, []
    places = random_states(scenario.space, CANDIDATES, job.seed)
    some = contested(scenario, truth, controller, places, job.seed, last=_last(scenario))
    return found, [{"scene": scenario.loaded.scene.name, "noise": job.noise, **one} for one in some]


def _scenario(scene: str | int, given: Mapping[str, Any]) -> Scenario:
    return oblique_scenario(scene, given) if isinstance(scene, int) else prepare(scene, given=given)


def states_and_times(scenario: Scenario, job: Job) -> list[tuple[Array, float]]:
    """Random places (2,) [m] and times [s] at which nothing is there."""
    last = _last(scenario)
    rng, found = np.random.default_rng([job.seed, 55]), []
    for x in places_of(scenario.space, 4 * job.states, job.seed, job.near_goal):
        t = float(rng.uniform(0.0, last + AFTER))
        if scenario.space.moving.distance(x, t) > FREE:
            found.append((x, t))
    return found[: job.states]


def _last(scenario: Scenario) -> float:
    """When all motions are over [s]."""
    return max(float(mover.motion.rows[-1, 0]) for mover in scenario.loaded.scene.movers)


def _record(
    scenario: Scenario, truth: Desirability, controller: Controller, x: Array, t: float, job: Job
) -> dict[str, Any]:
    plans = [first_plan(controller, x, t) for _ in range(job.plans)]
    clearance = min(scenario.space.clearance(x), scenario.space.moving.distance(x, t))
    return {
        "scene": scenario.loaded.scene.name, "of": job.scene, "x": x.tolist(), "t": t, "noise": job.noise,
        "clearance": clearance, "room": clearance / job.noise, "v": float(truth.value(x, t)),
        "u": truth.control(x, t).tolist(),
        "plans": [plan for plan in plans if plan is not None], "without": sum(plan is None for plan in plans),
    }  # fmt: skip


def _off(state: dict[str, Any]) -> float:
    """How far the mean of the plans' v is off, as a share of v."""
    mean = float(np.mean([plan["v"] for plan in state["plans"]]))
    return mean / float(state["v"]) - 1.0
