"""Worlds of BARN (Perille et al. 2020), driven by a Jackal and scored by the rules of the challenge of 2026.

The course is walled in by cylinders; the robot starts at its closed end, and its goal is the disc of 1 m around a point
beyond the open one. The clock starts once the robot has moved 0.1 m; a collision, or 100 s, scores 0. The worlds are
those of a folder next to the repository. With --json each run is written too.
"""

import argparse
import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.moving_text import prepared
from benchmarks.pool import spread
from worlds.page import Page, drum

from pirrht.arrays import Array
from pirrht.errors import NoReference, OptionError, SceneError
from sim.scenario import Scenario

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "barn"
START = (2.25, 3.0, 0.5 * np.pi)
ACROSS = 4.5  # by which x is more than that of the files [m]
RADIUS = 0.075  # of the cylinders [m]
FASTEST = 2.0  # speed of the best time [m/s]
MOVED = 0.1  # way until the clock of a run starts [m]
STOOD = 0.2  # time in which a robot that stands moves less than a tenth of this way [s]
RUNS = 10
SETTINGS = {  # a mean speed of 1 m/s scores most; passages of all worlds are 0.74 m wide or wider
    "max_time": 100.0, "speed": 1.0, "margin": 0.05,
}  # fmt: skip
ENDS = ("goal", "collision", "timeout", "no path")
HEADER = ["world", "runs", *ENDS, "time [s]", "score", "step [ms]", "99 % [ms]", "weakest"]


def worlds() -> list[str]:
    """Numbers of the worlds; none if the folder is missing."""
    file = FOLDER / "test50.json"
    return list(json.loads(file.read_text())) if file.exists() else []


def world(number: str, **other: Any) -> Page:
    """A world, with other fields of `Page` if they are given."""
    posts = json.loads((FOLDER / "test50.json").read_text())[number]
    fields = {"size": (4.5, 14.5), "goal": (2.25, 13.0, 1.0), "settings": SETTINGS, **other}
    return Page(
        name=f"barn {number}", about="A world of BARN.", why="BARN (Perille et al. 2020).", start=START[:2],
        elements=[drum(f"post {i}", x + ACROSS, y, RADIUS) for i, (x, y) in enumerate(posts)], **fields,
    )  # fmt: skip


def length(number: str) -> float:
    """The length of the path that the challenge compares with [m]."""
    return float(json.loads((FOLDER / "paths.json").read_text())["length"][number])


def score(outcome: str, time: float, best: float) -> float:
    """The score of a run that took a time, where the best one is known [s]; at most 0.5."""
    return best / float(np.clip(time, 2.0 * best, 8.0 * best)) if outcome == "goal" else 0.0


def waited(states: Array, step: float, start: Sequence[float] = START) -> float:
    """How long states (k, n), a step apart, take to have moved from the start [s]."""
    away = np.hypot(*(states[:, :2] - start[:2]).T) > MOVED
    return step * float(np.argmax(away) if away.any() else len(away))


class Run(NamedTuple):
    """A run to make."""

    world: str
    seed: int

    @property
    def best(self) -> float:
        """The best time [s]."""
        return length(self.world) / FASTEST

    def scenario(self, **given: Any) -> Scenario:
        """Prepare it, with all cylinders known."""
        return prepared("scene", world(self.world).text(), robot="jackal", seed=self.seed, start=START, **given)


def figures(run: Any) -> dict[str, Any]:
    """Drive a `Run` or one like it once.

    Return outcome, time, score, least clearance [m], the time of each control step [ms], and whether the robot stood at
    the end.
    """
    try:
        scenario = run.scenario()
        frames = list(scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())))
    except (NoReference, SceneError) as error:
        why = {"outcome": "no path", "why": f"seed {run.seed}: {error}"}
        return {**run._asdict(), **why, "time": np.nan, "score": 0.0, "step_ms": []}
    m = frames[-1].metrics
    x, y, _ = frames[-1].state
    states = np.vstack([frame.advance.states for frame in frames])
    time = m.time - waited(states, scenario.physics_step, scenario.start)
    stood = np.hypot(*(states[-1] - states[-round(STOOD / scenario.physics_step) :][0])[:2]) < MOVED * STOOD
    return {
        **run._asdict(), "outcome": m.outcome, "time": time, "score": score(m.outcome, time, run.best),
        "best": run.best, "stood": bool(stood),
        "why": f"seed {run.seed}: {m.outcome} at ({x:.2f}, {y:.2f}) after {m.time:.1f} s",
        "min_clearance": m.min_clearance, "blocked": m.blocked, "doubtful_plans": m.doubtful_plans,
        "mismatch": m.plant_mismatch, "step_ms": [1e3 * s for s in m.plan_seconds],
    }  # fmt: skip


def row(name: str, found: list[dict[str, Any]]) -> list[str]:
    """A row of the table."""
    ends = [one["outcome"] for one in found]
    times = [one["time"] for one in found if one["outcome"] == "goal"]
    steps = [ms for one in found for ms in one["step_ms"]] or [np.nan]
    worst = min(found, key=lambda one: float(one["score"]))
    return [
        name, str(len(found)), *(str(ends.count(end)) for end in ENDS), f"{np.mean(times or [np.nan]):.1f}",
        f"{np.mean([one['score'] for one in found]):.4f}", *(f"{np.percentile(steps, q):.0f}" for q in (50, 99)),
        worst["why"] if worst["score"] == 0.0 else "",
    ]  # fmt: skip


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    if not options.known:
        raise OptionError("`barn` drives with the map known: give --known")
    numbers = options.worlds or worlds()
    if not numbers or not set(numbers) <= set(worlds()):
        raise OptionError(f"{FOLDER} must hold the worlds; it has {', '.join(worlds()) or 'none'}")
    seeds = range(options.first_seed, options.first_seed + min(options.seeds, RUNS))
    jobs = [Run(number, seed) for number in numbers for seed in seeds]
    found = list(spread(figures, jobs, options.workers, "runs"))
    table = [row(name, list(some)) for name, some in groupby(found, lambda one: str(one["world"]))]
    return HEADER, [*table, row("all", found)], found
