"""Does the predicted probability of a collision hold? Plans at random states of random scenes against the exact law.

The exact law of the grid is held for a physics step, and walls are judged where steps end, as MuJoCo does. A cell is a
state at a noise level. A prediction "holds" if the Wilson interval (95 %) of the runs that collided begins no higher,
and its "bound" of 95 % does in the same way. "Over" is the ratio of collisions to predictions in all cells of a row,
"worst" the greatest ratio of a cell, of those with at least 20 collisions. With --part moving, states are
the starts of `crossing`, `pincer` and `closing_door`, at several times.
"""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from benchmarks import kept, promise, tradeoff
from benchmarks.scenes import random_states, scenario_of
from scipy.stats import binomtest
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.estimation.risk import collision_probability
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario, prepare

NOISES, STEP, RUNS = (0.1, 0.2, 0.3), 0.002, 2000
MOVING, TIMES = ("crossing", "pincer", "closing_door"), (0.0, 0.5, 1.0, 1.5)
HEADER = ["scenes", "b", "cells", "predicted", "happened", "over", "hold", "bound", "worst"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    if options.part in ("kept", "tradeoff", "promise"):
        return {"kept": kept, "tradeoff": tradeoff, "promise": promise}[options.part].rows(options)
    noises, found = tuple(options.noises or NOISES), list[dict[str, Any]]()
    for scenario, places in tqdm(list(_scenes(options)), disable=None):
        for noise in noises:
            found += _cells(scenario.with_settings(noise=noise), places)
    table = []
    for noise in noises:
        cells = [one for one in found if one["noise"] == noise]
        said, met = (float(np.mean([one[name] for one in cells])) for name in ("predicted", "happened"))
        ratios = [one["happened"] / one["predicted"] for one in cells if one["happened"] * RUNS >= 20]
        hold, bound = (
            f"{100 * np.mean([one['low'] <= one[name] for one in cells]):.0f} %" for name in ("predicted", "most")
        )
        figures = (f"{said:.4f}", f"{met:.4f}", f"{met / said:.2f}", hold, bound, f"{max(ratios, default=0.0):.2f}")
        table.append([options.part or "random", f"{noise:g}", str(len(cells)), *figures])
    return HEADER, table, found


def _scenes(options: argparse.Namespace) -> Iterator[tuple[Scenario, Array]]:
    """Scenarios, and states and times (k, 3) in each [m, m, s]."""
    if options.part == "moving":
        for name in MOVING:
            scenario = prepare(name, margin=0.0)
            yield scenario, np.array([[*scenario.start[:2], t] for t in TIMES])
        return
    for seed in range(options.first_seed, options.first_seed + (options.scenes or 10)):
        scenario = scenario_of(seed, {"seed": seed})
        states = random_states(scenario.space, options.states or 4, seed)
        yield scenario, np.column_stack([states, np.zeros(len(states))])


def _cells(scenario: Scenario, places: Array) -> Iterator[dict[str, Any]]:
    """Predict from one plan at each place, and simulate the exact law from there."""
    truth, tree = Desirability.of(scenario.problem, scenario.space), scenario.grown_tree()
    for k, (x, y, t) in enumerate(places):
        rng = np.random.default_rng([scenario.settings.seed, k])
        controller = Controller(
            scenario.problem, scenario.space, tree, scenario.sampling, homology=scenario.homology, rng=rng
        )
        state = np.array([x, y])
        controller.begin(state, t)
        estimate = controller.plan(state).estimate
        if estimate is None:
            continue
        predicted = collision_probability(scenario.problem, estimate, step=STEP)
        happened, _ = truth.collision_probability(state, RUNS, k, step=STEP, t=t)
        low, high = binomtest(round(happened * RUNS), RUNS).proportion_ci(method="wilson")
        yield {
            "scene": scenario.problem.scene.name, "noise": scenario.settings.noise, "state": [x, y, t],
            "predicted": predicted.probability, "error": predicted.error, "most": predicted.most, "happened": happened,
            "low": float(low), "high": float(high), "ess": estimate.ess,
        }  # fmt: skip
