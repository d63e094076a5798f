"""How far from the optimum: grid against closed forms, control and desirability against the grid, drives.

The exact answer comes from `pirrht.exact`. Errors of u are root mean squares over repeats, then means over the first
points of the unscrambled Halton sequence that have room (clearance of 5 cm, outside the goal).
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from benchmarks import plots
from benchmarks.annulus import convergence
from scipy.stats.qmc import Halton

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import NoReference
from pirrht.estimation.assembly import path_integral
from pirrht.estimation.sampling import Sampling
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.geometry.scene import Goal, Kind, Obstacle, Scene
from pirrht.planner.tree import HomologyTree
from pirrht.problem import Problem
from pirrht.steering.dubins import Dubins
from pirrht.systems.unicycle import Unicycle
from sim.scenario import Scenario, prepare

NOISES = (0.1, 0.2, 0.3)
POINTS, REPEATS = 20, 40
MANY, CHUNK = 10_000_000, 100_000
PATHS = 1_000_000
PLANS = 1000
VARIANTS: dict[str, dict[str, Any]] = {
    # Same kernel and same exit rule as the default.
    "paper": {"guide": "open-loop", "weights": "average", "draws": "independent", "period": 0.1},
    "open loop, balance": {"guide": "open-loop", "weights": "balance", "draws": "independent", "period": 0.1},
    "feedback": {"draws": "independent"},
    "feedback, pairs (default)": {},
}
Table = tuple[list[str], list[list[str]], object]


def rows(options: argparse.Namespace) -> Table:
    """Header, table and JSON of one part."""
    parts = {
        "grid": grid,
        "car": car,
        "control": control,
        "samples": samples,
        "psi": desirability,
        "shares": shares,
        "drives": drives,
    }
    header, table, values = parts[options.part](options)
    if options.png is not None:
        if options.part not in ("samples", "drives"):
            raise SystemExit(f"--png draws the parts samples and drives, not {options.part}")
        getattr(plots, options.part)(options.png, values)
    return header, table, values


def grid(_: argparse.Namespace) -> Table:
    """v and u of the grid against the annulus' Bessel functions, per spacing."""
    table, values = [], []
    for noise in NOISES:
        k = 1.0 / noise**2
        spacings = [c / k for c in (2.0, 1.4, 1.0, 0.7)] if noise < 0.15 else [0.04, 0.028, 0.02, 0.014]
        for row in convergence(noise, spacings):
            values.append(row)
            table.append(["-" if v is None else f"{v:.3g}" for v in row.values()])
    return ["b", "h [m]", "kh", "error of v", "error of u", "order of u"], table, values


def car(_: argparse.Namespace) -> Table:
    """v of a car in a room of 4 x 4 m at b = 0.3: the grid's against a million passive paths of small steps."""
    posts = [(1.8, 2.2, 0.3), (2.6, 1.2, 0.25)]
    room = Scene(
        name="room", lower=np.zeros(2), upper=np.full(2, 4.0), start=np.array([0.5, 2.0, 0.0]), robot_radius=0.1,
        goal=Goal(center=np.array([3.4, 2.0]), radius=0.3),
        obstacles=tuple(
            Obstacle(name=f"post{i}", kind=Kind.CYLINDER, size=np.array([r, 0.25, 0.0]),
                position=np.array([x, y, 0.25]), rotation=np.eye(3))
            for i, (x, y, r) in enumerate(posts)
        ),
    )  # fmt: skip
    problem, space = Problem(dynamics=Unicycle(b=0.3), scene=room, R=np.eye(1)), FreeSpace.of(room)
    exact = Desirability.of(problem, space)
    # Noise turns the car more tightly than |u| <= 1 does; ways that need it get references of a smaller radius.
    tree = HomologyTree(space, Dubins(rho=0.4), limit=0.8, classes=4, rng=np.random.default_rng(0))
    tree.grow(500)
    sampling = Sampling(dt=0.05, samples=CHUNK // 4)
    controller = Controller(problem, space, tree, sampling, between="hold", rng=np.random.default_rng(1))
    table, values = [], []
    for x in _states(controller, POINTS):
        logs, drawn = [], 0
        while drawn < PATHS:
            plan = controller.plan(x)
            logs.append(-np.inf if plan.estimate is None else plan.estimate.log_psi)
            drawn += sampling.samples * len(plan.ids)
        psi = np.exp(np.array(logs) - max(logs))
        v, error = float(exact.value(x)), problem.temperature * float(psi.std(ddof=1) / psi.mean() / len(psi) ** 0.5)
        sampled = -problem.temperature * (max(logs) + float(np.log(psi.mean())))
        values.append({"x": x.tolist(), "grid": v, "sampled": sampled, "stderr": error})
        figures = [f"{v:.4f}", f"{sampled:.4f}", f"{error:.4f}", f"{100.0 * abs(v - sampled) / sampled:.2f}"]
        table.append([" ".join(f"{c:.2f}" for c in x), *figures])
    return ["x, y, theta", "v grid", "v sampled (1e6)", "its s.e.", "off [%]"], table, values


def _states(controller: Controller, count: int) -> Iterator[Array]:
    """The first clear states from which the car has a path to the goal."""
    found = 0
    for x in clear_states(controller.space, 3):
        if found == count:
            return
        controller.begin(x)
        try:
            usable = controller.plan(x).estimate is not None
        except NoReference:
            usable = False
        if usable:
            found += 1
            yield x


def clear_states(space: FreeSpace, n: int) -> Iterator[Array]:
    """States (n,) of the Halton sequence with a clearance of 5 cm, outside the goal; angles follow x and y."""
    scene = space.scene
    for unit in Halton(d=n, scramble=False).random(500):
        x = np.concatenate([scene.lower + unit[:2] * (scene.upper - scene.lower), np.pi * (2.0 * unit[2:] - 1.0)])
        if space.clearance(x) >= 0.05 and not scene.goal.contains(x[:2]):
            yield x


def control(_: argparse.Namespace) -> Table:
    """Error of u at the same number of samples and at the same time, per variant."""
    table, values = [], []
    for noise in NOISES:
        results = {name: _errors(noise, changes) for name, changes in VARIANTS.items()}
        paper, seconds = results["paper"]
        for name, (error, spent) in results.items():
            fair = error
            if name != "paper":  # as many samples as fit into the paper's time
                N = max(1, round(200 * seconds / spent))
                fair, _ = _errors(noise, {**VARIANTS[name], "samples": N})
            table.append(
                [
                    f"{noise:g}",
                    name,
                    f"{error:.3f}",
                    f"{error / paper:.2f}",
                    f"{1e3 * spent:.1f}",
                    f"{fair / paper:.2f}",
                ]
            )
            values.append({"noise": noise, "variant": name, "error": error, "seconds": spent, "error_equal_time": fair})
    return ["b", "variant", "error of u", "over paper's", "ms", "over paper's, equal time"], table, values


def samples(_: argparse.Namespace) -> Table:
    """Error of u against the number of samples per class."""
    table, values = [], []
    for noise in NOISES:
        for name, changes in VARIANTS.items():
            for N in (25, 50, 100, 200, 400, 800, 1600):
                error, _ = _errors(noise, {**changes, "samples": N})
                values.append({"noise": noise, "variant": name, "samples": N, "error": error})
                table.append([f"{noise:g}", name, str(N), f"{error:.3f}"])
    return ["b", "variant", "samples", "error of u"], table, values


def _errors(noise: float, changes: dict[str, Any]) -> tuple[float, float]:
    """Mean error of u over the points, and median seconds of sampling and weighing."""
    scenario = prepare("slit", given={"noise": noise, "plan_seed": 0, "between": "hold", **changes})
    tree, truth = scenario.grown_tree(), Desirability.of(scenario.problem, scenario.space)
    controller = scenario.controller(tree)
    controller.path_integral.warm_up()
    errors, spent = [], []
    for x in islice(clear_states(scenario.space, 2), POINTS):
        exact, square = truth.control(x), []
        controller.begin(x)
        controller.plan(x)
        for _ in range(REPEATS):
            began = time.perf_counter()
            plan = controller.plan(x)
            spent.append(time.perf_counter() - began)
            square.append(float(np.sum((plan.control - exact) ** 2)))
        errors.append(float(np.sqrt(np.mean(square))))
    return float(np.mean(errors)), float(np.median(spent))


def desirability(_: argparse.Namespace) -> Table:
    """Whether psi is unbiased: mean of exp(-(v - v_ref)/lambda) over plans of 200 samples per class."""
    table, values = [], []
    for noise in NOISES:
        scenario = prepare("slit", given={"noise": noise, "plan_seed": 0})
        tree, truth = scenario.grown_tree(), Desirability.of(scenario.problem, scenario.space)
        x, lam = scenario.start, scenario.problem.temperature
        exact = float(truth.value(x))
        reference = -lam * _log_psi(scenario, tree, x, MANY // CHUNK, CHUNK // 3, exact)[0] + exact
        _, found = _log_psi(scenario, tree, x, PLANS, 200, reference)
        ratio, v = np.exp(found), reference - lam * found
        error = float(ratio.std(ddof=1) / np.sqrt(PLANS))
        finite = v[np.isfinite(v)]
        values.append(
            {
                "noise": noise,
                "grid": exact,
                "v_ref": reference,
                "ratio": float(ratio.mean()),
                "stderr": error,
                "bias_of_v": float(finite.mean() - reference),
                "sd_of_v": float(finite.std(ddof=1)),
            }
        )
        table.append([f"{noise:g}", *[f"{v:.4f}" for v in list(values[-1].values())[1:]]])
    return ["b", "v grid", "v_ref (1e7)", "mean ratio", "its s.e.", "bias of v", "sd of v"], table, values


def _log_psi(
    scenario: Scenario, tree: Any, x: Array, plans: int, samples: int, reference: float
) -> tuple[float, Array]:
    """log of the mean of psi over plans, relative to that of a reference value, and each one's."""
    controller = scenario.with_settings(samples=samples, between="hold").controller(tree)
    found = []
    for _ in range(plans):
        estimate = controller.plan(x).estimate
        found.append(-np.inf if estimate is None else estimate.log_psi + reference / scenario.problem.temperature)
    return float(np.logaddexp.reduce(found) - np.log(plans)), np.array(found)


def shares(_: argparse.Namespace) -> Table:
    """Share of the slit at the start, b = 0.3 and dt = 0.1, against the optimal paths of the grid."""
    table, values = [], []
    for rule, dt, guide in (("bridge", None, "feedback"), ("endpoint", 0.1, "open-loop")):
        given = {"noise": 0.3, "plan_seed": 0, "exit": rule, "guide": guide, "period": 0.1, "samples": 300_000}
        scenario = prepare("slit", given=given)
        exact = Desirability.of(scenario.problem, scenario.space, dt=dt).shares(scenario.start, samples=4000, seed=0)
        tree = scenario.grown_tree()
        integral = path_integral(scenario.problem, scenario.space, replace(scenario.sampling, first=None))
        controller = scenario.controller(tree)
        controller.path_integral = integral
        estimate = controller.plan(scenario.start).estimate
        assert estimate is not None
        found = estimate.class_weights["0,0"]
        values.append({"exit": rule, "sampled": found, "grid": exact.get("0,0", 0.0)})
        table.append([rule, f"{found:.3f}", f"{exact.get('0,0', 0.0):.3f}"])
    return ["exit", "slit's share", "of the grid's paths"], table, values


def drives(options: argparse.Namespace) -> Table:
    """Drives in MuJoCo against the optimal law at the physics rate, on the same noise seeds."""
    from sim.sweeps import sweep

    table, values = [], []
    few = max(1, options.seeds // 3)  # of methods that are far from the optimum anyway
    grid: list[tuple[str, str, str | None, dict[str, Any], int]] = [
        ("optimal", "optimal", None, {}, options.seeds),
        ("pi-rrht", "pi-rrht", None, {}, options.seeds),
        ("planned every 0.1 s", "pi-rrht", None, {"period": 0.1}, options.seeds),
        ("paper", "pi-rrht", "paper", {}, few),
        ("single", "single", None, {}, few),
        ("passive", "passive", None, {}, few),
    ]
    found: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for name, method, preset, given, seeds in grid:
        rows = sweep.sweep(_jobs(method, preset, given, seeds))
        for row in rows:
            found.setdefault((name, row["noise"]), []).append(row)
    for (method, noise), group in found.items():
        values.append({"method": method, "noise": noise, **paired(group, found["optimal", noise])})
        v = values[-1]
        table.append(
            [
                f"{noise:g}",
                method,
                str(len(group)),
                f"{v['success']:.3f}",
                f"{100 * v['difference']:+.1f}",
                f"{100 * v['low']:+.1f} .. {100 * v['high']:+.1f}",
                f"{v['cost']:.3f}",
                f"{v['cost_over_optimal']:.4f}",
            ]
        )
    order = np.lexsort(([v["method"] for v in values], [v["noise"] for v in values]))
    header = ["b", "method", "drives", "success", "points", "95 % interval", "cost", "over optimal"]
    return header, [table[i] for i in order], [values[i] for i in order]


def _jobs(method: str, preset: str | None, given: dict[str, Any], seeds: int) -> list[Any]:
    from sim.sweeps.runs import Job

    shared = tuple({"plan_seed": 0, "preset": preset, **given}.items())
    return [
        Job(scene="slit", method=method, noise=noise, seed=seed, given=shared)
        for noise in NOISES
        for seed in range(seeds)
    ]


def paired(group: list[dict[str, Any]], optimal: list[dict[str, Any]]) -> dict[str, float]:
    """Success and cost of drives against those of the optimal law with the same seeds."""
    best = {row["seed"]: row for row in optimal}
    pairs = [(row, best[row["seed"]]) for row in group]
    arrived = np.array([[float(r["outcome"] == "goal") for r in pair] for pair in pairs])
    off = arrived[:, 0] - arrived[:, 1]
    error = 1.96 * float(off.std(ddof=1)) / np.sqrt(len(off))
    cost = np.array([[r["cost"] for r in pair] for pair, both in zip(pairs, arrived.all(axis=1), strict=True) if both])
    cost = cost.reshape(-1, 2)
    return {
        "success": float(arrived[:, 0].mean()),
        "difference": float(off.mean()),
        "low": float(off.mean() - error),
        "high": float(off.mean() + error),
        "cost": float(cost[:, 0].mean()) if len(cost) else np.nan,
        "cost_over_optimal": float(cost[:, 0].mean() / cost[:, 1].mean()) if len(cost) else np.nan,
    }
