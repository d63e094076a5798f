"""Cost against the probability of a collision: drives in MuJoCo at many margins, beside the exact law.

The exact law with a margin is the best there is for its walls: its cost is v, and --samples runs of it (4000), held for
a physics step, collide ("exact"). `--risk` chooses the margin of "pi-rrht"; the other methods get some by hand. Costs
are of drives that arrived.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.plots import COLORS, plain
from scipy.stats import binomtest
from tqdm import tqdm

from pirrht.arrays import Array
from pirrht.plotting.maps import pyplot
from sim.scenario import prepare
from sim.sweeps.runs import Job, frozen
from sim.sweeps.sweep import sweep

RISKS = (0.1, 0.03, 0.01, 0.003)
MARGINS = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5)  # of the exact law, in deviations of a physics step
BY_HAND = (0.0, 0.02, 0.05)  # of other methods [m]
RUNS = 4000  # of the exact law
HEADER = ["method", "risk", "margin mm", "runs", "collided", "95 % interval", "cost", "error"]


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON; with --png also a picture."""
    scene, noise = options.scene or "slit", (options.noises or [0.2])[0]
    step = noise * np.sqrt(prepare(scene, margin=0.0).physics_step)
    margins = tqdm([float(step * m) for m in MARGINS], "exact law", disable=None)
    found = [_exact(scene, noise, margin, options.samples or RUNS) for margin in margins]
    wanted: list[tuple[str, dict[str, Any]]] = [("pi-rrht", {"risk": risk}) for risk in RISKS]
    wanted += [(method, {"margin": m}) for method in ("pi-rrht", "best-class", "mppi") for m in BY_HAND]
    found += [_row(options, scene, noise, method, **how) for method, how in tqdm(wanted, "drives", disable=None)]
    if options.png is not None:
        draw(options.png, found, f"{scene}, b = {noise:g}")
    table = [
        [
            one["method"], "" if one["risk"] is None else f"{one['risk']:g}", f"{1e3 * one['margin']:.1f}",
            str(one["drives"]), str(one["collided"]), f"{100 * one['low']:.1f} .. {100 * one['high']:.1f} %",
            f"{one['cost']:.3f}", f"{one['error']:.3f}",
        ]
        for one in found
    ]  # fmt: skip
    return HEADER, table, found


def _exact(scene: str, noise: float, margin: float, runs: int) -> dict[str, Any]:
    """Simulate the exact law with a margin."""
    scenario = prepare(scene, noise=noise, margin=margin)
    truth = scenario.truth(steps=False)
    share, _ = truth.collision_probability(scenario.start, runs, 1, step=scenario.physics_step, margin=margin)
    return _found("exact", None, margin, runs, round(share * runs), np.array([truth.value(scenario.start)]))


def _row(
    options: argparse.Namespace, scene: str, noise: float, method: str, *, margin: float | None = None,
    risk: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Drive one method with one margin, or the one that keeps a risk."""
    scenario = prepare(scene, noise=noise, margin=margin, risk=risk)
    shared = frozen({"plan_seed": 0, "margin": scenario.margin})
    drives = options.seeds if risk is not None else max(1, options.seeds // 3)
    jobs = [Job(scene=scene, method=method, noise=noise, seed=k, given=shared) for k in range(drives)]
    ends = list(sweep(jobs, jobs_at_once=options.workers))
    collided = sum(one["outcome"] == "collision" for one in ends)
    cost = np.array([one["cost"] for one in ends if one["outcome"] == "goal"])
    return _found(method, risk, scenario.margin, drives, collided, cost)


def _found(method: str, risk: float | None, margin: float, runs: int, collided: int, cost: Array) -> dict[str, Any]:
    low, high = binomtest(collided, runs).proportion_ci(method="wilson")
    return {
        "method": method, "risk": risk, "margin": margin, "drives": runs, "collided": collided,
        "low": float(low), "high": float(high), "cost": float(cost.mean()) if len(cost) else np.nan,
        "error": float(cost.std() / np.sqrt(len(cost))) if len(cost) else np.nan,
    }  # fmt: skip


def draw(path: Path, found: list[dict[str, Any]], title: str) -> None:
    """Draw the cost over the share of drives that collided, one line a method."""
    figure, axes = pyplot("--png").subplots(figsize=(6.4, 4.2), layout="constrained")
    lines = {(one["method"], one["risk"] is not None): None for one in found}
    for i, (method, kept) in enumerate(lines):
        line = [one for one in found if (one["method"], one["risk"] is not None) == (method, kept)]
        share = np.array([100.0 * one["collided"] / one["drives"] for one in line])
        bars = np.abs(np.array([[100.0 * one["low"], 100.0 * one["high"]] for one in line]).T - share)
        name = "pi-rrht --risk" if kept else "exact law" if method == "exact" else f"{method}, margin by hand"
        axes.errorbar(
            share, [one["cost"] for one in line], xerr=bars, yerr=[one["error"] for one in line], marker="o", ms=5,
            lw=1.8 if method == "exact" or kept else 0.8, elinewidth=0.7, label=name,
            color="#222222" if method == "exact" else COLORS[i % len(COLORS)],
        )  # fmt: skip
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xticks([0, 1, 3, 10, 30, 100], ["0", "1", "3", "10", "30", "100"])
    axes.set_title(title, fontsize=10)
    labels = {"xlabel": "drives that collided [%], with 95 % intervals", "ylabel": "cost of drives that arrived"}
    plain(axes, xlim=(-0.1, 100.0), **labels)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=120)
