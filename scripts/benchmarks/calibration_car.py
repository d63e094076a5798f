"""Value and control of the car at random states of open random scenes against a million samples of small steps.

The car's exact grid cannot resolve little noise, so truth is sampled: in parts, with steps of FINE, v from the mean of
their psi, which is unbiased, and u from their mean weighted by psi; errors are the scatter of the parts. A million
samples of default steps tell what the steps do; plans of default size what few samples do besides. Plans are compared
with truth ("in 1" to "over 3"), and with a million samples of their own steps ("own in 2", "over 3"). States without a
reference are left out, and those where truth has fewer than ENOUGH effective samples are counted, not judged.
"""

import argparse
from typing import Any

import numpy as np
from benchmarks.calibration_table import by_noise_and_scene
from benchmarks.first_plan import controller_of, first_plan
from benchmarks.scenes import random_states, scenario_of, with_references
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.errors import SceneError
from pirrht.planner.tree import HomologyTree
from sim.scenario import Scenario

NOISES = (0.03,)  # the default; more takes longer paths
SCENES, STATES, PLANS = 3, 8, 20
MOST = 4  # solids of an open scene
RADIUS = 0.15  # of the car [m]
FINE = 0.02  # [s]
MANY, PARTS = 1_000_000, 10
ENOUGH = 100.0
HEADER = ["b, scene", "states", "unclear", "plans", "in 1", "in 2", "over 3", "own in 2", "over 3"]
PARTLY = ("1", "2", "3", "_own2", "_own3")  # of the columns of v, and of u
HEADER += ["u in 1", "in 2", "over 3", "own in 2", "over 3"]
HEADER += ["bias", "its s.e.", "rms", "s.e.", "steps' bias", "its s.e.", "worst", "in s.e.", "ESS", "none", "ms"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON."""
    found = collect(options)
    table, values = [], []
    for noise, name, some in by_noise_and_scene(found):
        values.append({"noise": noise, "scene": name, **summary(some)})
        table.append(_text(values[-1]))
    return HEADER, table, {"table": values, "states": found}


def collect(options: argparse.Namespace) -> list[dict[str, Any]]:
    """One record per state and noise."""
    scenes, states, plans = options.scenes or SCENES, options.states or STATES, options.plans or PLANS
    noises, found, seed, used = options.noises or NOISES, [], options.first_seed, 0
    with tqdm(total=scenes * len(noises) * states, desc="states", leave=False, disable=None) as bar:
        while used < scenes:
            try:
                quiet = scenario_of(seed, {"seed": seed}, most=MOST, robot="unicycle", radius=RADIUS)
            except SceneError:  # the car is larger than the robot that the scene was made for
                seed += 1
                continue
            tree = quiet.grown_tree()
            for noise in noises:
                scenario = quiet.with_settings(noise=noise)
                for x in _states(scenario, tree, states, seed):
                    found.append({"scene": f"random{seed}", "noise": noise, **_record(scenario, tree, x, plans)})
                    bar.update()
            seed, used = seed + 1, used + 1
    return found


def _states(scenario: Scenario, tree: HomologyTree, count: int, seed: int) -> list[Array]:
    """Random positions and headings, (3,), from which there is a way."""
    headings = np.random.default_rng([seed, 54]).uniform(-np.pi, np.pi, 20 * count)
    places = random_states(scenario.space, 20 * count, seed)
    return with_references(tree, map(np.append, places, headings), count)


def _record(scenario: Scenario, tree: HomologyTree, x: Array, plans: int) -> dict[str, Any]:
    """What plans say at x (3,), and what a million samples say with fine steps and with default ones."""
    fine, coarse = (_many(scenario.with_settings(dt=dt), tree, x) for dt in (FINE, scenario.settings.dt))
    controller = controller_of(scenario, tree)
    made = [first_plan(controller, x) for _ in range(plans)]
    said = [plan for plan in made if plan is not None]
    return {"x": x.tolist(), "fine": fine, "coarse": coarse, "plans": said, "without": plans - len(said)}


def _many(scenario: Scenario, tree: HomologyTree, x: Array) -> dict[str, float]:
    """v and u of a million samples at x (3,) in parts, standard errors by their scatter, and effective samples."""
    H = max(1, len(tree.references(x)))
    controller = controller_of(scenario.with_settings(samples=max(1, MANY // (PARTS * H))), tree)
    logs, controls, ess, lam = [], [], 0.0, scenario.problem.temperature
    for _ in range(PARTS):
        controller.begin(x)
        e = controller.plan(x).estimate
        logs.append(-np.inf if e is None else e.log_psi)
        controls.append(0.0 if e is None else float(e.control[0]))
        ess += 0.0 if e is None else e.ess
    top = max(logs)
    if not np.isfinite(top):
        return {"v": np.inf, "v_error": np.inf, "u": 0.0, "u_error": np.inf, "ess": 0.0}
    psi = np.exp(np.array(logs) - top)
    share = psi / psi.sum()
    u = float(share @ controls)
    off = float(np.sqrt(np.sum((share * (np.array(controls) - u)) ** 2)))
    error = lam * float(psi.std(ddof=1) / psi.mean()) / np.sqrt(PARTS)
    return {"v": -lam * (top + float(np.log(psi.mean()))), "v_error": error, "u": u, "u_error": off, "ess": ess}


def _scores(states: list[dict[str, Any]], key: str, steps: str) -> Array:
    """How far plans are off truth by their steps, in errors of both."""
    return np.concatenate([
        [abs(np.ravel(p[key])[0] - s[steps][key]) / np.hypot(np.ravel(p[f"{key}_error"])[0], s[steps][f"{key}_error"])
         for p in s["plans"]]
        for s in states
    ])  # fmt: skip


def summary(states: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage, where truth's own error is allowed for, biases and errors of v [cost]; truth must be clear."""
    clear = [s for s in states if s["plans"] and s["fine"]["ess"] >= ENOUGH]
    unclear = len(states) - len(clear)
    counts: dict[str, Any] = {"states": len(states), "unclear": unclear, "without": sum(s["without"] for s in states)}
    if not clear:
        return counts
    v, claim = ([np.array([p[key] for p in s["plans"]]) for s in clear] for key in ("v", "v_error"))
    true, unsure = (np.array([s["fine"][key] for s in clear]) for key in ("v", "v_error"))
    off = [a - t for a, t in zip(v, true, strict=True)]
    for key in "vu":
        own, score = (_scores(clear, key, steps) for steps in ("coarse", "fine"))
        counts |= {f"{key}1": float(np.mean(score <= 1)), f"{key}2": float(np.mean(score <= 2))}
        counts |= {f"{key}3": float(np.mean(score > 3))}
        counts |= {f"{key}_own2": float(np.mean(own <= 2)), f"{key}_own3": float(np.mean(own > 3))}
    bias, n = np.array([o.mean() for o in off]), np.array([len(o) for o in off])
    error = np.hypot(unsure, [o.std() / np.sqrt(k) for o, k in zip(off, n, strict=True)])
    worst = int(np.argmax(np.abs(bias) / error))
    steps = np.array([s["coarse"]["v"] for s in clear]) - true
    steps_error = np.hypot(unsure, [s["coarse"]["v_error"] for s in clear])
    return counts | {
        "plans": sum(len(s["plans"]) for s in clear),
        "bias": float(bias.mean()),
        "bias_error": _of_mean(error),
        "rms": float(np.sqrt(np.mean(np.concatenate(off) ** 2))),
        "claim": float(np.sqrt(np.mean(np.concatenate(claim) ** 2))),
        "steps": float(steps.mean()),
        "steps_error": _of_mean(steps_error),
        "worst": float(bias[worst]),
        "worst_over_error": float(abs(bias[worst]) / error[worst]),
        **{key: float(np.median([p[key] for s in clear for p in s["plans"]])) for key in ("ess", "ms")},
    }


def _of_mean(errors: Array) -> float:
    return float(np.sqrt(np.sum(errors**2))) / len(errors)


def _text(row: dict[str, Any]) -> list[str]:
    cells = [f"{row['noise']:g}, {row['scene']}", str(row["states"]), str(row["unclear"])]
    if "v1" not in row:
        return [*cells, *[""] * (len(HEADER) - 5), str(row["without"]), ""]
    return [
        *cells, str(row["plans"]), *(f"{100 * row[key + part]:.1f}" for key in "vu" for part in PARTLY),
        f"{row['bias']:+.5f}", f"{row['bias_error']:.5f}", f"{row['rms']:.5f}", f"{row['claim']:.5f}",
        f"{row['steps']:+.5f}", f"{row['steps_error']:.5f}", f"{row['worst']:+.5f}",
        f"{row['worst_over_error']:.1f}", f"{row['ess']:.1f}", str(row["without"]), f"{row['ms']:.1f}",
    ]  # fmt: skip
