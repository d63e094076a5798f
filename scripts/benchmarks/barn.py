"""Worlds of BARN (Perille et al. 2020), driven by a Jackal and scored by the rules of the challenge of 2026.

It has a lidar and no map, or with --known the map. The worlds are those of a folder next to the repository, or with
--scenes so many that `sim.barn` grows, which says what a course is. With --json each run is written too.
"""

import argparse
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.moving_text import prepared
from benchmarks.pool import spread

from pirrht.arrays import Array
from pirrht.control.mapped import Mapped
from pirrht.control.settings import TREELESS
from pirrht.errors import NoReference, OptionError, SceneError
from sim import barn
from sim.scenario import Scenario

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "barn"
STOOD = 0.2  # time in which a robot that stands moves less than a few centimetres [s]
RUNS = 10
GROWN = "grown "  # and a seed: the name of a world that is grown
ENDS = ("goal", "collision", "timeout", "no path")
HEADER = ["world", "runs", *ENDS, "time [s]", "score", "step [ms]", "99 %", "map [ms]", "99 %", "weakest"]
NOTE = "a reproduction in MuJoCo, not the challenge's Gazebo"


def worlds() -> list[str]:
    """Numbers of the worlds; none if the folder is missing."""
    file = FOLDER / "test50.json"
    return list(barn.read(file)) if file.exists() else []


def world(number: str, **given: Any) -> str:
    """A world as MJCF, by what `sim.barn.text` takes."""
    text = {"classes": 8, **given}  # half of what the Gym environment has
    return barn.text(f"barn {number}", posts_of(number), **text)


def posts_of(number: str) -> Array:
    """The centres (k, 2) of the cylinders of a world [m]."""
    if number.startswith(GROWN):
        return barn.grown(int(number.removeprefix(GROWN)))
    return np.array(barn.read(FOLDER / "test50.json")[number], dtype=float)


def length(number: str) -> float:
    """The length of the path that the challenge compares with [m]."""
    if number.startswith(GROWN):
        return barn.length(posts_of(number))
    return float(barn.read(FOLDER / "paths.json")["length"][number])


class Run(NamedTuple):
    """A run to make."""

    world: str
    seed: int
    known: bool = True
    method: str | None = None

    @property
    def best(self) -> float:
        """The best time [s]."""
        return length(self.world) / barn.FASTEST

    def scenario(self, **given: Any) -> Scenario:
        """Prepare it, with all cylinders known or none."""
        sense = {} if self.known else {"sense": "lidar"}
        text = world(self.world, **(barn.KNOWN if self.known else barn.SENSED))
        return prepared(
            "scene", text, robot="jackal", seed=self.seed, start=barn.START, method=self.method, **sense, **given
        )


def figures(run: Any) -> dict[str, Any]:
    """Drive a `Run` or one like it once.

    Return outcome, time, score, least clearance [m], the time of each control step and map [ms], and whether the robot
    stood at the end.
    """
    maps = list[float]()
    frames = []
    try:
        scenario = run.scenario()
        driver = scenario.driver(None if scenario.settings.method in TREELESS else scenario.grown_tree())
        for frame in scenario.drive(scenario.plant(), driver):
            frames.append(frame)
            if isinstance(driver, Mapped) and driver.believed is not None:
                maps.append(1e3 * driver.believed.seconds)
    except (NoReference, SceneError) as error:
        why = {"outcome": "no path", "why": f"seed {run.seed}: {error}"}
        return {**run._asdict(), **why, "time": np.nan, "score": 0.0, "step_ms": [], "map_ms": []}
    m = frames[-1].metrics
    x, y, _ = frames[-1].state
    states = np.vstack([frame.advance.states for frame in frames])
    stood = np.hypot(*(states[-1] - states[-round(STOOD / scenario.physics_step) :][0])[:2]) < 0.1 * STOOD
    time = m.time - barn.waited(states - scenario.start + barn.START, scenario.physics_step)
    return {
        **run._asdict(), "outcome": m.outcome, "time": time, "score": barn.score(m.outcome, time, run.best),
        "best": run.best, "stood": bool(stood),
        "why": f"seed {run.seed}: {m.outcome} at ({x:.2f}, {y:.2f}) after {m.time:.1f} s",
        "min_clearance": m.min_clearance, "blocked": m.blocked, "doubtful_plans": m.doubtful_plans,
        "mismatch": m.plant_mismatch, "step_ms": [1e3 * s for s in m.plan_seconds], "map_ms": maps, "note": NOTE,
    }  # fmt: skip


def row(name: str, found: list[dict[str, Any]]) -> list[str]:
    """A row of the table."""
    ends = [one["outcome"] for one in found]
    times = [one["time"] for one in found if one["outcome"] == "goal"]
    spent = [[ms for one in found for ms in one[part]] or [np.nan] for part in ("step_ms", "map_ms")]
    worst = min(found, key=lambda one: float(one["score"]))
    return [
        name, str(len(found)), *(str(ends.count(end)) for end in ENDS), f"{np.mean(times or [np.nan]):.1f}",
        f"{np.mean([one['score'] for one in found]):.4f}",
        *(f"{np.percentile(some, q):.0f}" for some in spent for q in (50, 99)),
        worst["why"] if worst["score"] == 0.0 else "",
    ]  # fmt: skip


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    numbers = options.worlds or worlds()
    if options.scenes:
        numbers = [f"{GROWN}{seed}" for seed in range(options.scenes)]
    elif not numbers or not set(numbers) <= set(worlds()):
        raise OptionError(
            f"{FOLDER} must hold the worlds; it has {', '.join(worlds()) or 'none, and --scenes 50 grows others'}"
        )
    seeds = range(options.first_seed, options.first_seed + min(options.seeds, RUNS))
    jobs = [Run(number, seed, options.known, options.method) for number in numbers for seed in seeds]
    found = list(spread(figures, jobs, options.workers, "runs"))
    table = [row(name, list(some)) for name, some in groupby(found, lambda one: str(one["world"]))]
    return HEADER, [*table, [*row("all", found)[:-1], NOTE]], found
