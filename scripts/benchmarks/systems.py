"""Speed of robots whose noise enters through their inputs: planning, a drive's control steps, rollouts.

Rollouts are those of a plan at the start: what follows guides, with the likelihood under every reference, and what
holds tapes; one tape also with exits judged at the ends of steps, which is what samplers elsewhere do. The rate counts
steps of the grid; near walls each of them may be several of a path's own.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from benchmarks.first_plan import first_batch
from benchmarks.timing import interleaved, planning, row

from pirrht.estimation.sampler import PathIntegral
from pirrht.planner.references import Reference
from pirrht.proposals.proposal import Batch, Proposal, Tape
from sim.rehearsal import rehearse
from sim.scenario import Scenario, prepare

VERTICES, CLASSES, SAMPLES = 2000, 8, 300
MANY = 20_000  # rollouts that are timed
REPEATS = 5


def rows(options: argparse.Namespace) -> tuple[list[list[str]], dict[str, Any]]:
    """Table and JSON for one robot."""
    robot, scene = options.robot or "hover", options.scene or "clutter"
    given = {"vertices": VERTICES, "classes": CLASSES, "samples": SAMPLES}
    scenario = prepare(scene, robot=robot, given=given)
    rehearse(scenario, driving=True)
    seconds = {f"{robot}, {scene}: planning {VERTICES} vertices": planning(scenario, REPEATS)}
    steps, classes = control_steps(scenario, options.drive)
    seconds[f"{robot}, {scene}: control step"] = float(np.median(steps))
    table = [
        row(name, spent, note=f"{classes:.1f} classes" if "step" in name else "") for name, spent in seconds.items()
    ]
    rates = rollouts(scenario) | ends_of_steps(scenario)
    for name, (spent, rate) in rates.items():
        table.append(row(f"{robot}, {scene}: {MANY} rollouts, {name}", spent, rate=f"{rate / 1e6:.1f} M steps/s"))
    return table, {"seconds": seconds, "classes": classes, "steps_per_second": {k: v[1] for k, v in rates.items()}}


def control_steps(scenario: Scenario, seconds: float) -> tuple[list[float], float]:
    """Wall times of control steps [s], and the mean number of classes around which they sample."""
    timed = scenario.with_settings(max_time=seconds)
    frames = [
        (f.plan_seconds, len(f.plan.references)) for f in timed.drive(timed.plant(), timed.driver(timed.grown_tree()))
    ]
    return [spent for spent, _ in frames[1:]], float(np.mean([count for _, count in frames]))


def rollouts(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Median time [s] and steps per second of rollouts that are led and of those that hold tapes, on all threads."""
    integral, guided, references, holds = first_batch(scenario)
    one = min(len(guided.proposals), 1)
    batches: dict[str, Batch] = {
        f"{len(references)} guides": guided.counting([MANY // len(references)] * len(references)),
        "one guide": replace(guided, proposals=guided.proposals[:one]).counting([MANY]),
    }
    if holds:
        batches[f"{len(references)} tapes"] = replace(guided, proposals=_tapes(guided, references))
        batches["one tape"] = replace(guided, proposals=_tapes(guided, references[:1]))
    return _timed(integral, batches)


def ends_of_steps(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """The same of the paper's rule of exits under one tape; empty where references are no tapes."""
    integral, guided, references, holds = first_batch(scenario.with_settings(exit="endpoint"), 1)
    if not holds:
        return {}
    batch = replace(guided, proposals=_tapes(guided, references))
    return _timed(integral, {"one tape, exits at ends of steps": batch})


def _tapes(guided: Batch, references: Sequence[Reference]) -> tuple[Proposal, ...]:
    """MANY samples in equal parts around what references apply."""
    return tuple(
        Proposal(lead=Tape(guided.times, reference.trajectory.tape(guided.times)), count=MANY // len(references))
        for reference in references
    )


def _timed(integral: PathIntegral, batches: dict[str, Batch]) -> dict[str, tuple[float, float]]:
    work = {name: (lambda k, batch=batch: integral.rollout(batch, k)) for name, batch in batches.items()}
    seconds = interleaved(work, REPEATS)
    counted = {name: int(integral.rollout(batch, 0).paths.steps.sum()) for name, batch in batches.items()}
    return {name: (spent, counted[name] / spent) for name, spent in seconds.items()}
