"""Speed among 24 bodies that move: rollouts, planning, a control step by phase, and plans that are late in real time.

Rollouts are those of a plan at the start, around its guides and ways; without bodies they are the same ones, in the
same scene with nothing that moves in it. The rate counts steps of the grid: fitted ones are split near bodies, of
uniform ones each is one step of a path.
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.first_plan import first_batch
from benchmarks.moving_scene import moving_scenario
from benchmarks.timing import interleaved, planning, row, ticks

from pirrht.moving.obstacles import MovingObstacleArrays
from pirrht.rollouts.tables import PredictedWorld
from sim.recording.recorder import Recorder, Sinks
from sim.scenario import Scenario

BODIES, VERTICES, SAMPLES, PERIOD = 24, 2000, 300, 0.1
SEEDS = (0, 1, 2)  # of the scenes that are driven through
REPEATS = 5
PHASES = {"_references": "references", "_leads": "guides", "_estimate": "samples"}  # methods of a controller's own


def rows(options: argparse.Namespace) -> tuple[list[list[str]], dict[str, Any]]:
    """Table and JSON for one robot."""
    given = {"vertices": VERTICES, "samples": SAMPLES, "period": PERIOD}
    scenarios = [moving_scenario(seed, BODIES, given, options.robot) for seed in SEEDS]
    for scenario in scenarios:
        scenario.controller(scenario.grown_tree()).plan(scenario.start)  # compiles, and loads what is compiled
    rates = {steps: rollouts(scenarios[0].with_settings(steps=steps)) for steps in ("fitted", "uniform")}
    table = []
    for steps, known in rates.items():
        for name, (taken, rate) in known.items():
            over = known["one guide, none" if "guide" in name else "none"][1] / rate  # the same without bodies
            table.append(row(f"rollouts, {steps} steps, {name}", taken, over, rate=f"{rate / 1e6:.2f} M steps/s"))
    seconds = planning(scenarios[0], REPEATS)
    table.append(row(f"planning {VERTICES} vertices", seconds))
    spent, classes = control_steps(scenarios, options.drive)
    for name, times in spent.items():
        table.append(
            row(f"control step, {name}", float(np.median(times)), note=f"p99 {1e3 * np.percentile(times, 99):.0f} ms")
        )
    table[-1][-1] += f", {classes:.1f} classes"
    late = {predict: late_plans(scenarios, options.drive, predict) for predict in ("known", "velocity")}
    for predict, (missed, plans, elsewhere) in late.items():
        note = f"{missed} of {plans}; other machines took {100.0 * elsewhere:.1f} % of the processors"
        table.append(
            [f"late plans, 10 Hz, recording, {predict}", f"{100.0 * missed / plans:.2g}", "%", "-", "-", "-", note]
        )
    return table, {
        "rollouts": {steps: {k: v[1] for k, v in known.items()} for steps, known in rates.items()},
        "planning": seconds,
        "control_step": {name: [float(np.median(t)), float(np.percentile(t, 99))] for name, t in spent.items()},
        "late": late,
    }


def rollouts(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Median time [s] and steps per second of a plan's rollouts, and of the first guide's, with bodies and without."""
    among, batch, _, _ = first_batch(scenario)
    alone, nothing = copy(among), MovingObstacleArrays.of(replace(scenario.loaded.scene, movers=()))
    alone.proposals = copy(among.proposals)
    world = among.setup.world._replace(moving=nothing)
    alone.proposals.world = PredictedWorld((among.setup._replace(world=world), among.homology))
    one = replace(batch, proposals=batch.proposals[:1]).counting([1000])
    work: dict[str, Callable[[int], Any]] = {
        "none": lambda k: alone.rollout(batch, k),
        f"{BODIES} bodies": lambda k: among.rollout(batch, k),
        "one guide, none": lambda k: alone.rollout(one, k),
        f"one guide, {BODIES} bodies": lambda k: among.rollout(one, k),
    }
    seconds = interleaved(work, REPEATS)
    return {name: (spent, float(work[name](0).paths.steps.sum()) / spent) for name, spent in seconds.items()}


def control_steps(scenarios: list[Scenario], seconds: float) -> tuple[dict[str, list[float]], float]:
    """Wall times of control steps by phase [s], first ones aside, and the mean number of classes."""
    spent: dict[str, list[float]] = defaultdict(list)
    classes = []
    for scenario in scenarios:
        timed = scenario.with_settings(max_time=seconds)
        driver = timed.driver(timed.grown_tree())
        now: dict[str, float] = defaultdict(float)
        for method, name in PHASES.items():
            whose = driver if hasattr(driver, method) else driver.around
            setattr(whose, method, _timing(getattr(whose, method), name, now))
        for frame in timed.drive(timed.plant(), driver):
            now["rest"] = frame.plan_seconds - sum(now.values())
            now["all"] = frame.plan_seconds
            for name, value in now.items() if frame.step > 0 else ():
                spent[name].append(value)
            now.clear()
            classes.append(len(frame.plan.references))
    return {name: spent[name] for name in [*PHASES.values(), "rest", "all"]}, float(np.mean(classes))


def _timing(method: Callable[..., Any], name: str, now: dict[str, float]) -> Callable[..., Any]:
    def timed(*given: Any) -> Any:
        began = time.perf_counter()
        try:
            return method(*given)
        finally:
            now[name] += time.perf_counter() - began

    return timed


def late_plans(scenarios: list[Scenario], seconds: float, predict: str) -> tuple[int, int, float]:
    """How many plans of drives in real time were late, of how many, while they were recorded.

    And the share of the processors that other machines on the same hardware had meanwhile: no plan can help that.
    """
    late = plans = stolen = passed = 0
    for scenario in scenarios:
        timed = scenario.with_settings(max_time=seconds, real_time=True, predict=predict)
        tree = timed.grown_tree()
        driver = timed.driver(tree)
        with tempfile.TemporaryDirectory() as folder:
            sinks = Sinks(file=Path(folder) / "drive.rrd")
            with Recorder(timed.loaded, tree, driver.path_integral, sinks, settings={"scene": "benchmark"}) as recorder:
                before = ticks()
                for frame in timed.drive(timed.plant(), driver):
                    recorder.log(frame)
        taken, whole = np.subtract(ticks(), before).tolist()
        stolen, passed = stolen + taken, passed + whole
        figures = frame.metrics.real_time
        assert figures is not None
        late, plans = late + figures["deadline_misses"], plans + figures["periods"]
    return late, plans, stolen / max(passed, 1)
