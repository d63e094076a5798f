"""Is the probability that `--risk` promises kept? Margins of random scenes, or a --scene, against the exact held law.

A cell is a scene at a noise level and a risk: the margin is chosen as for a run, and the exact law with this margin,
held for a physics step, makes 2 000 runs from the start. A prediction "holds" if the Wilson interval (95 %) of the runs
that collided begins no higher, its 95 % "bound" and the risk ("kept") in the same way. "Price" is v with the margin
over v without. With --png the runs that collided are drawn over what was predicted.
"""

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.plots import COLORS, plain
from benchmarks.pool import spread
from benchmarks.scenes import scenario_of
from scipy.stats import binomtest

from pirrht.errors import PirrhtError
from pirrht.exact.desirability import Desirability
from pirrht.plotting.maps import pyplot
from sim.scenario import Scenario, prepare
from sim.scenario.risk import predicted

NOISES, RISKS, RUNS, SCENES = (0.1, 0.2, 0.3), (0.1, 0.03, 0.01, 0.003), 2000, 20
HEADER = ["scenes", "b", "risk", "cells", "refused", "margin mm", "predicted %", "happened %", "over", "hold", "bound",
          "kept", "worst", "price"]  # fmt: skip


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON; with --png also a picture."""
    scenes: list[int | str] = [*range(options.first_seed, options.first_seed + (options.scenes or SCENES))]
    scenes = [options.scene] if options.scene else scenes
    jobs = [(one, noise) for one in scenes for noise in options.noises or NOISES]
    found = [cell for cells in spread(_cells, jobs, options.workers, "scenes x noises") for cell in cells]
    table = []
    for noise, risk in sorted({(one["noise"], -one["risk"]) for one in found}):
        cells = [one for one in found if (one["noise"], -one["risk"]) == (noise, risk)]
        table.append([options.scene or "random", f"{noise:g}", f"{-risk:g}", *_row(cells)])
    if options.png is not None:
        draw(options.png, found)
    return HEADER, table, found


def _row(cells: list[dict[str, Any]]) -> list[str]:
    """Sum up the cells of a noise level and a risk."""
    known = [one for one in cells if one["margin"] is not None]
    mean = {name: float(np.mean([one[name] for one in known])) for name in ("margin", "predicted", "happened", "price")}
    hold, bound, kept = (
        f"{100 * np.mean([one['low'] <= one[name] for one in known]):.0f} %" for name in ("predicted", "most", "risk")
    )
    return [
        str(len(cells)), str(len(cells) - len(known)), f"{1e3 * mean['margin']:.1f}", f"{100 * mean['predicted']:.3f}",
        f"{100 * mean['happened']:.3f}", f"{mean['happened'] / max(mean['predicted'], 1e-9):.2f}", hold, bound, kept,
        f"{max(one['happened'] / one['risk'] for one in known):.2f}", f"{mean['price']:.4f}",
    ]  # fmt: skip


def _cells(job: tuple[int | str, float]) -> list[dict[str, Any]]:
    """Choose margins of a scene at a noise level for all risks, and simulate the exact law with each."""
    scene, noise = job
    free = _ready(scene, noise=noise)
    cells, least = list[dict[str, Any]](), math.nan
    known: dict[float, float] = {}  # share that collided by margin
    for risk in RISKS:
        cell = {"scene": scene, "noise": noise, "risk": risk, "margin": None}
        cells.append(cell)
        try:
            least = (
                least if math.isfinite(least) else float(Desirability.of(free.problem, free.space).value(free.start))
            )
            scenario = _ready(scene, noise=noise, risk=risk)
            truth = Desirability.of(scenario.problem, scenario.space)
        except PirrhtError:  # no margin keeps the risk, or no grid of this package is fine enough
            continue
        said, margin = predicted(scenario), scenario.margin
        if margin not in known:
            known[margin], _ = truth.collision_probability(
                scenario.start, RUNS, 1, step=scenario.physics_step, margin=margin
            )
        happened = known[margin]
        low, high = binomtest(round(happened * RUNS), RUNS).proportion_ci(method="wilson")
        cell |= {
            "margin": margin, "predicted": said.probability, "most": said.most, "happened": happened,
            "low": float(low), "high": float(high), "price": float(truth.value(scenario.start)) / least,
        }  # fmt: skip
    return cells


def _ready(scene: int | str, **given: Any) -> Scenario:
    """Prepare a random scene or one by name."""
    margin = 0.0 if given.get("risk") is None else None
    given |= {"threads": 1}
    return prepare(scene, given=given, margin=margin) if isinstance(scene, str) else scenario_of(scene, given)


def draw(path: Path, found: list[dict[str, Any]]) -> None:
    """Draw what happened over what was predicted, a point a cell, one colour a risk."""
    figure, axes = pyplot("--png").subplots(figsize=(5.6, 4.6), layout="constrained")
    least = 0.3 / RUNS  # where none collided
    for i, risk in enumerate(RISKS):
        line = [one for one in found if one["margin"] is not None and one["risk"] == risk]
        x, y, low, high = (
            np.maximum([one[k] for one in line], least) for k in ("predicted", "happened", "low", "high")
        )
        axes.errorbar(
            x, y, yerr=[y - np.minimum(low, y), high - y], fmt="o", ms=4, lw=0, elinewidth=0.6, alpha=0.7,
            color=COLORS[i], label=f"--risk {risk:g}",
        )  # fmt: skip
        axes.axhline(risk, color=COLORS[i], lw=0.8, ls=":")
    axes.plot([least, 0.2], [least, 0.2], color="#444444", lw=0.9)
    plain(
        axes, grid=0.2, xscale="log", yscale="log", xlim=(0.8 * least, 0.2), ylim=(0.8 * least, 0.2),
        xlabel="predicted probability of a collision", ylabel=f"share of {RUNS} runs that collided, 95 % intervals",
    )  # fmt: skip
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=120)
