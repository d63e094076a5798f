"""What presets cost: seconds of a plan, effective samples, and the error of v against the exact grid.

States: the start, and the first POINTS points of the unscrambled Halton sequence with a clearance of 5 cm, and log psi
of the grid above LEAST, where the grid is trusted. The car of `clutter` has no grid at its own noise, so the error
there is the puck's.
"""

import argparse
import time
from itertools import islice

import numpy as np
from benchmarks.quality import clear_states

from pirrht.arrays import Array
from pirrht.errors import NoReference, PirrhtError
from pirrht.exact.desirability import Desirability
from sim.scenario import Scenario, prepare
from sim.settings import PRESETS

POINTS, REPEATS = 12, 10
LEAST = -300.0  # log psi
CASES: tuple[tuple[str, str | None, dict[str, float]], ...] = (  # scene, robot, settings
    ("slit", None, {}),
    ("clutter", "puck", {"noise": 0.2}),
    ("clutter", None, {}),
)


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    table, values = [], []
    for scene, robot, given in [(options.scene, options.robot, {})] if options.scene else CASES:
        given = {"seed": 0, **given, **({"noise": options.noises[0]} if options.noises else {})}
        known = prepare(scene, robot=robot, given=given)
        try:
            truth = Desirability.of(known.problem, known.space)
        except PirrhtError:  # too many points for a grid
            truth = None
        states = drawn(known, truth)
        for preset in (None, *PRESETS):
            scenario = prepare(scene, robot=robot, preset=preset, given=given)
            found = figures(scenario, truth, states)
            name = known.loaded.robot
            values.append({"scene": scene, "robot": name, "noise": known.settings.noise, "preset": preset, **found})
            figure = ["-" if np.isnan(value) else f"{value:.4g}" for value in found.values()]
            table.append([scene, name, f"{known.settings.noise:g}", preset or "(none)", *figure])
    header = ["scene", "robot", "b", "preset", "samples", "vertices", "tree [s]", "plan [ms]", "ESS"]
    return [*header, "error of v [%]", "bias [%]", "no estimate"], table, values


def drawn(scenario: Scenario, truth: Desirability | None) -> list[Array]:
    """The states at which plans are made."""
    clear = clear_states(scenario.space, len(scenario.start))
    trusted = (x for x in clear if truth is None or truth.log_psi(x) > LEAST)
    return [scenario.start, *islice(trusted, POINTS)]


def figures(scenario: Scenario, truth: Desirability | None, states: list[Array]) -> dict[str, float]:
    """Means over the states; the error of v is a root mean square over plans, relative to the exact v."""
    began = time.perf_counter()
    tree = scenario.grown_tree()
    grown = time.perf_counter() - began
    controller = scenario.controller(tree)
    controller.path_integral.warm_up()
    seconds, sizes, errors, biases, none = [], [], [], [], 0
    for x in states:
        exact, off = np.nan if truth is None else float(truth.value(x)), list[float]()
        controller.begin(x)
        for _ in range(REPEATS):
            began = time.perf_counter()
            try:
                estimate = controller.plan(x).estimate
            except NoReference:
                estimate = None
            seconds.append(time.perf_counter() - began)
            if estimate is None or not np.isfinite(estimate.log_psi):
                none += 1
                continue
            sizes.append(estimate.ess)
            off.append((-scenario.problem.temperature * estimate.log_psi - exact) / exact)
        if off:
            errors.append(float(np.sqrt(np.mean(np.square(off)))))
            biases.append(float(np.mean(off)))
    return {
        "samples": scenario.settings.samples,
        "vertices": tree.size,
        "tree_seconds": grown,
        "plan_ms": 1e3 * float(np.median(seconds)),
        "ess": float(np.mean(sizes)),
        "error_percent": 100.0 * float(np.mean(errors)),
        "bias_percent": 100.0 * float(np.mean(biases)),
        "no_estimate": none,
    }
