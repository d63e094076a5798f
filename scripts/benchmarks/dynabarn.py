"""Worlds of DynaBARN (Nair et al. 2022), driven by a Jackal with a lidar, without a map, among moving cylinders.

Rules and scores are those of `barn`, for a path of 20 m. The cylinders do not give way: a robot that stands may be
hit, which the column `stood` counts among the collisions. With --known plans know all motions.
"""

import argparse
import json
import re
import tempfile
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from benchmarks import barn
from benchmarks.moving_text import prepared
from benchmarks.pool import spread

from pirrht.errors import OptionError
from sim.barn import FASTEST
from sim.importing.scene_file import import_world
from sim.scenario import Scenario

FILE = barn.FOLDER.parent / "dynabarn" / "worlds.json"
LENGTH = 20.0  # of the path that the challenge compares with [m]
SETTINGS = {"speed": 1.3, "margin": 0.05, "vertices": 300, "max_time": 100.0}
LEVELS = ("easy", "medium", "hard")
PUBLISHED = {"easy": "78, 40, 74", "medium": "43, 16, 60", "hard": "17, 0, 28"}  # % of DWA, TEB and a learned policy
HEADER = [*barn.HEADER[:-1], "stood", "published [%]", "weakest"]


def levels() -> dict[str, str]:
    """The level of each world; none if the file is missing."""
    return {number: one["level"] for number, one in json.loads(FILE.read_text()).items()} if FILE.exists() else {}


def world(number: str) -> str:
    """The model of a world, for a robot of its own size."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.xml"
        import_world(FILE, path, number=number)
        return re.sub(r'\n *<numeric name="pirrht_radius".*', "", path.read_text())


class Run(NamedTuple):
    """A run to make."""

    world: str
    seed: int
    known: bool
    best: float = LENGTH / FASTEST

    def scenario(self) -> Scenario:
        """Prepare it."""
        sense = "map" if self.known else "lidar"
        return prepared("scene", world(self.world), robot="jackal", seed=self.seed, sense=sense, **SETTINGS)


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    level = levels()
    numbers = options.worlds or [*level]
    if not numbers or not set(numbers) <= set(level):
        raise OptionError(f"{FILE} must hold the worlds; it has {', '.join(level) or 'none'}")
    numbers = sorted(numbers, key=lambda number: LEVELS.index(level[number]))
    seeds = range(options.first_seed, options.first_seed + min(options.seeds, barn.RUNS))
    jobs = [Run(number, seed, options.known) for number in numbers for seed in seeds]
    found = list(spread(barn.figures, jobs, options.workers, "runs"))

    def row(name: str, some: list[dict[str, object]], published: str = "") -> list[str]:
        *figures, weakest = barn.row(name, some)
        stood = sum(one["outcome"] == "collision" and bool(one["stood"]) for one in some)
        return [*figures, str(stood), published, weakest]

    table = [row(name, list(some)) for name, some in groupby(found, lambda one: str(one["world"]))]
    for name in LEVELS:
        if some := [one for one in found if level[str(one["world"])] == name]:
            table.append(row(name, some, PUBLISHED[name]))
    return HEADER, [*table, row("all", found)], found
