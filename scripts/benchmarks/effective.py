"""Effective samples of all plans of drives: robots in built-in scenes, worlds of BARN, and scenes that a seed grows.

The worlds of BARN are those of a folder next to the repository, if it is there. A row is one robot in one scene, or in
all worlds of a kind; the last row of a robot is all of its plans. With --robot or --scene there is only that, of
--scene BARN so many worlds (--scenes); --seeds is of drives through each built-in scene. With --shapes the robot has
each of these in turn: footprints, or radii of discs [m].
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby, product
from typing import Any, NamedTuple

import numpy as np
from benchmarks.barn import world, worlds
from benchmarks.moving_text import prepared
from benchmarks.pool import spread
from worlds import grown
from worlds.page import PUCK, Page

from pirrht.errors import NoReference, SceneError
from pirrht.estimation.sampling import TUNING
from sim import barn
from sim.scenario import Scenario, prepare

ROBOTS = ("puck", "unicycle", "diffdrive", "hover", "rover", "car")
SCENES, SEEDS = ("house", "office", "clutter", "barn", "forest", "warehouse"), 2
WORLDS = 10
NARROW: dict[str, Any] = {
    **PUCK, "size": (4.5, 14.0), "goal": (2.25, 13.0, 0.9), "noise": 0.08, "vertices": 2000, "limit": 0.8,
}  # fmt: skip
GROWN: dict[str, Callable[[], Page]] = {
    "forest 1": partial(grown.forest, 1), "barn 1": partial(grown.barn, 1), "barn 2": partial(grown.barn, 2),
}  # fmt: skip
HEADER = ["robot", "scene", "drives", "goal", "plans", "doubtful", "ESS", "least", "cost", "step [ms]"]


class Drive(NamedTuple):
    """One drive to make: a robot in a scene, which is built in, a world of BARN or grown."""

    robot: str
    kind: str  # of the table's row
    scene: str
    seed: int
    shape: str | None = None  # its own, a footprint, or the radius of a disc [m]

    def scenario(self, **given: Any) -> Scenario:
        """Prepare it."""
        given = {"robot": self.robot, "seed": self.seed, **given}
        if self.shape is not None:
            round_ = self.shape.replace(".", "").isdecimal()
            given |= {"radius": float(self.shape)} if round_ else {"footprint": self.shape}
        if self.kind == self.scene:
            return prepare(self.scene, **given)
        if self.kind == "grown":
            return prepared("scene", GROWN[self.scene]().text(), **given)
        return prepared("scene", world(self.scene, **NARROW), **given, start=barn.START)


def drives(options: argparse.Namespace) -> Iterator[Drive]:
    """Yield the drives that are asked for."""
    for robot, shape in product([options.robot] if options.robot else ROBOTS, options.shapes or [None]):
        seeds = range(options.first_seed, options.first_seed + min(options.seeds, SEEDS))
        for scene in [options.scene] if options.scene else SCENES:
            yield from (Drive(robot, scene, scene, seed, shape) for seed in seeds if scene != "BARN")
        if options.scene in (None, "BARN"):
            numbers = worlds()[:: 50 // (options.scenes or WORLDS)]
            yield from (Drive(robot, "BARN", number, options.first_seed, shape) for number in numbers)
        if options.scene is None:
            yield from (Drive(robot, "grown", name, options.first_seed, shape) for name in GROWN)


def figures(drive: Drive) -> dict[str, Any]:
    """Drive once; return the figures of `run`, effective samples of each plan, and the median control step [ms]."""
    sizes, seconds = list[float](), list[float]()
    try:
        scenario = drive.scenario()
        for frame in scenario.drive(scenario.plant(), scenario.driver(scenario.grown_tree())):
            seconds.append(frame.plan_seconds)
            if frame.plan.estimate is not None:
                sizes.append(frame.plan.estimate.ess)
    except (NoReference, SceneError) as error:
        nothing = {"cost": np.nan, "steps": 0, "doubtful_plans": 0, "least_ess": None, "ess": [], "step_ms": np.nan}
        return {**drive._asdict(), "outcome": f"no path: {error}", **nothing}
    m = frame.metrics
    return {
        **drive._asdict(), "outcome": m.outcome, "cost": m.cost, "steps": m.steps, "doubtful_plans": m.doubtful_plans,
        "least_ess": m.least_ess, "ess": sizes, "step_ms": 1e3 * float(np.median(seconds[1:] or seconds)),
    }  # fmt: skip


def row(robot: str, kind: str, found: Sequence[dict[str, Any]]) -> list[str]:
    """A row of the table."""
    arrived = [one for one in found if one["outcome"] == "goal"]
    plans, sizes = sum(one["steps"] for one in found) or 1, np.concatenate([one["ess"] for one in found])
    kind = kind if found[0]["shape"] is None else f"{kind}, {found[0]['shape']}"
    costs = f"{np.mean([one['cost'] for one in arrived]):.3f}" if arrived else "-"
    doubtful = 100.0 * sum(one["doubtful_plans"] for one in found) / plans
    return [
        robot, kind, str(len(found)), str(len(arrived)), str(plans), f"{doubtful:.1f} %",
        *([f"{np.median(sizes):.0f}", f"{sizes.min():.1f}"] if len(sizes) else ["-", "-"]), costs,
        f"{np.nanmedian([one['step_ms'] for one in found]):.1f}",
    ]  # fmt: skip


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON; a plan is doubtful below TUNING.few effective samples."""
    table = list[list[str]]()
    found = list(spread(figures, list(drives(options)), options.workers, "drives"))
    for (robot, _), of_robot in groupby(found, lambda one: (str(one["robot"]), one["shape"])):
        mine = list(of_robot)
        table += [row(robot, kind, list(some)) for kind, some in groupby(mine, lambda one: str(one["kind"]))]
        table.append(row(robot, "all", mine))
    return [*HEADER[:5], f"ESS < {TUNING.few:g}", *HEADER[6:]], table, found
