"""Does `--risk` keep its promise? Drives in MuJoCo through random scenes: static ones, and some with 24 moving bodies.

Every scene is prepared with the risk, and driven a number of times. "Refused" are scenes in which no margin keeps it.
Among moving bodies plans follow each other in a tenth of a second. With --robot there are static scenes only.
"""

import argparse
from collections import Counter
from functools import partial
from typing import Any

from benchmarks.moving_scene import moving_scenario
from benchmarks.pool import spread
from benchmarks.scenes import scenario_of
from scipy.stats import binomtest

from pirrht.errors import PirrhtError

RISK, SCENES, DRIVES, BODIES, NOISES = 0.01, 20, 10, 24, (0.1, 0.2, 0.3)
HEADER = ["scenes", "b", "refused", "drives", "goal", "collision", "timeout", "95 % interval", "margin mm", "most"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    kinds: list[tuple[str, float | None]] = [("static", b) for b in options.noises or NOISES] + [("moving", 0.1)]
    if options.robot:
        kinds = [("static", b) for b in options.noises or [None]]
    seeds = range(options.first_seed, options.first_seed + (options.scenes or SCENES))
    drives, table, values = min(options.seeds, DRIVES), list[list[str]](), list[dict[str, Any]]()
    for kind, noise in kinds:
        work = partial(ends, kind, options.robot, noise, drives)
        values += (mine := list(spread(work, seeds, options.workers, f"{kind} {noise or ''}")))
        driven = [one for one in mine if one["margin"] is not None]
        total = sum((one["ends"] for one in driven), Counter[str]())
        low, high = binomtest(total["COLLISION"], max(total.total(), 1)).proportion_ci(method="wilson")
        table.append([
            options.robot or kind, "own" if noise is None else f"{noise:g}", str(len(mine) - len(driven)),
            str(total.total()),
            *(str(total[end]) for end in ("GOAL", "COLLISION", "TIMEOUT")), f"{100 * low:.1f} .. {100 * high:.1f} %",
            f"{1e3 * sum(one['margin'] for one in driven) / max(len(driven), 1):.1f}",
            str(max((one["ends"]["COLLISION"] for one in driven), default=0)),
        ])  # fmt: skip
    return HEADER, table, values


def ends(kind: str, robot: str | None, noise: float | None, drives: int, seed: int) -> dict[str, Any]:
    """Count how drives of one scene end; no margin: it is refused."""
    given, name = {"noise": noise, "seed": seed, "risk": RISK, "threads": 1}, f"{kind}{seed}"
    try:
        if kind == "moving":
            scenario = moving_scenario(seed, BODIES, given | {"period": 0.1})
        else:
            scenario = scenario_of(seed, given, robot=robot)
    except PirrhtError as error:
        return {"scene": name, "noise": noise, "margin": None, "why": str(error), "ends": Counter[str]()}
    found, tree = Counter[str](), scenario.grown_tree()
    for k in range(drives):
        one = scenario.with_settings(seed=1000 * seed + k)
        *_, last = one.drive(one.plant(), one.driver(tree))
        found[last.outcome.name] += 1
    return {"scene": name, "noise": noise, "margin": scenario.margin, "ends": found}
