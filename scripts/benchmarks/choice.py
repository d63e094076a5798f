"""Whether 300 samples choose the class that a million do, at random states of the car in `clutter`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from pirrht.controller import Controller
from pirrht.errors import NoReference
from sim.scenarios import Scenario, prepare

STATES = 20  # at which a million samples give one class at least CLEAR
REPEATS = 100
MANY, FEW = 1_000_000, 300  # all samples together; samples around each reference
CLEAR = 0.9


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What many and few samples say at one state."""

    state: list[float]
    favourite: str
    weight: float  # of the favourite in the run of a million
    right: int  # repeats with few samples that choose it
    dead: int  # repeats without a survivor
    ess: float  # mean effective sample size within the favourite class


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    table, values = [], []
    for guide in ("feedback", "open-loop"):
        found = choices(options.scene or "clutter", options.rho, guide)
        values += [{"guide": guide, **vars(choice)} for choice in found]
        right = np.array([choice.right for choice in found])
        table.append(
            [
                guide,
                f"{options.rho:g}",
                str(len(found)),
                str(np.sum(right >= 0.9 * REPEATS)),
                str(right.min()),
                f"{right.mean():.1f}",
                str(sum(choice.dead for choice in found)),
                f"{np.mean([choice.ess for choice in found]):.1f}",
            ]
        )
    header = ["guide", "rho", "states", ">= 90 right", "least", "mean of 100", "no survivor", "ESS in class"]
    return header, table, values


def choices(scene: str, rho: float, guide: str) -> list[Choice]:
    """STATES random states with a clear favourite, judged by feedback guidance, and how few samples fare there."""
    given = {"seed": 0, "rho": rho, "samples": FEW}
    judge = prepare(scene, robot="unicycle", given={**given, "guide": "feedback"})
    tree = judge.grown_tree()
    tried = prepare(scene, robot="unicycle", given={**given, "guide": guide}).controller(tree)
    rng = np.random.default_rng(20)
    found: list[Choice] = []
    while len(found) < STATES:
        x = tree.steering.sample(judge.problem.scene, rng)
        if not judge.space.clearance(x) > 0.05 or judge.problem.scene.goal.contains(x[:2]):
            continue
        weights = _many(judge, judge.controller(tree), x)
        favourite = max(weights, key=lambda name: weights[name], default="")
        if weights.get(favourite, 0.0) >= CLEAR:
            found.append(_judged(tried, x, favourite, weights[favourite]))
    return found


def _many(scenario: Scenario, controller: Controller, x: np.ndarray) -> dict[str, float]:
    """Class weights of a run of a million samples, spread evenly over the references; empty if there is none."""
    try:
        controller.begin(x)
        H = max(1, len(controller.plan(x).references))
    except NoReference:
        return {}
    scenario = scenario.with_settings(samples=MANY // H)
    plenty = scenario.controller(controller.tree)
    plenty.begin(x)
    estimate = plenty.plan(x).estimate
    return {} if estimate is None else estimate.class_weights


def _judged(controller: Controller, x: np.ndarray, favourite: str, weight: float) -> Choice:
    controller.begin(x)
    right, dead, ess = 0, 0, []
    for _ in range(REPEATS):
        plan = controller.plan(x)
        if plan.estimate is None:
            dead += 1
            continue
        right += plan.favourite == favourite
        ess.append(plan.estimate.class_ess.get(favourite, 0.0))
    return Choice(
        state=x.tolist(), favourite=favourite, weight=weight, right=right, dead=dead, ess=float(np.mean(ess or [0.0]))
    )
