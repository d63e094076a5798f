"""Does `--risk` keep its promise? Drives in MuJoCo through random scenes: static ones, and some with 24 moving bodies.

Every scene is prepared with the risk, and driven a number of times. "Refused" are scenes in which no margin keeps it.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

from benchmarks.moving_scene import moving_scene
from benchmarks.moving_text import prepared
from benchmarks.scenes import random_scene
from scipy.stats import binomtest
from tqdm import tqdm

from pirrht.errors import OptionError

RISK, SCENES, DRIVES, BODIES, NOISES = 0.01, 20, 10, 24, (0.1, 0.2, 0.3)
HEADER = ["scenes", "b", "refused", "drives", "goal", "collision", "timeout", "95 % interval", "margin mm", "most"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    kinds = [("static", b) for b in options.noises or NOISES] + [("moving", 0.1)]
    seeds = range(options.first_seed, options.first_seed + (options.scenes or SCENES))
    drives, table, values = min(options.seeds, DRIVES), list[list[str]](), list[dict[str, Any]]()
    for kind, noise in kinds:
        with ProcessPoolExecutor(options.workers) as pool:
            found = pool.map(partial(ends, kind, noise, drives), seeds)
            values += (mine := list(tqdm(found, f"{kind} {noise:g}", len(seeds), disable=None)))
        driven = [one for one in mine if one["margin"] is not None]
        total = sum((one["ends"] for one in driven), Counter[str]())
        low, high = binomtest(total["COLLISION"], max(total.total(), 1)).proportion_ci(method="wilson")
        table.append([
            kind, f"{noise:g}", str(len(mine) - len(driven)), str(total.total()),
            *(str(total[end]) for end in ("GOAL", "COLLISION", "TIMEOUT")), f"{100 * low:.1f} .. {100 * high:.1f} %",
            f"{1e3 * sum(one['margin'] for one in driven) / max(len(driven), 1):.1f}",
            str(max((one["ends"]["COLLISION"] for one in driven), default=0)),
        ])  # fmt: skip
    return HEADER, table, values


def ends(kind: str, noise: float, drives: int, seed: int) -> dict[str, Any]:
    """Count how drives of one scene end; no margin: it is refused."""
    name, text = f"{kind}{seed}", random_scene(seed) if kind == "static" else moving_scene(seed, BODIES)
    try:
        scenario = prepared(name, text, {"noise": noise, "seed": seed, "risk": RISK, "threads": 1})
    except OptionError as error:
        return {"scene": name, "noise": noise, "margin": None, "why": str(error), "ends": Counter[str]()}
    found, tree = Counter[str](), scenario.grown_tree()
    for k in range(drives):
        one = scenario.with_settings(seed=1000 * seed + k)
        *_, last = one.drive(one.plant(), one.driver(tree))
        found[last.outcome.name] += 1
    return {"scene": name, "noise": noise, "margin": scenario.margin, "ends": found}
