"""Whether 300 samples around each reference choose the class that a million do, at random states of the car.

A state counts if two runs of a million samples, the second with guides that the first one's were improved to, give
the same class a weight of at least CLEAR; where they disagree a million samples do not know the answer either.
"""

import argparse
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.control.controller import Controller
from pirrht.errors import NoReference
from pirrht.planner.tree import HomologyTree
from sim.scenario import Scenario, prepare

STATES = 20
REPEATS = 100
MANY, FEW = 1_000_000, 300  # all samples together; samples around each reference
CLEAR = 0.9
GUIDES = ("feedback", "open-loop")


@dataclass(frozen=True, kw_only=True)
class Clear:
    """A state at which a million samples, drawn by feedback guidance, favour one class."""

    state: Array
    favourite: str
    weight: float  # of the favourite, the lesser of two runs


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What many and few samples say at one state."""

    state: list[float]
    favourite: str
    weight: float  # of the favourite in the runs of a million
    right: int  # repeats with few samples that choose it
    dead: int  # repeats without a survivor
    ess: float  # mean effective sample size within the favourite class


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    judge = prepare(options.scene or "clutter", robot="unicycle", given={"seed": 0, "rho": options.rho, "samples": FEW})
    tree = judge.grown_tree()
    states, unclear = clear_states(judge, tree)
    found = {guide: choices(judge, tree, states, guide) for guide in GUIDES}
    ess = {guide: np.array([choice.ess for choice in chosen]) for guide, chosen in found.items()}
    table = []
    for guide, chosen in found.items():
        right = np.array([choice.right for choice in chosen])
        gain = ess[guide] / np.maximum(ess["open-loop"], 1e-9)
        table.append(
            [
                guide,
                f"{options.rho:g}",
                f"{len(chosen)} ({unclear})",
                str(np.sum(right >= 0.9 * REPEATS)),
                str(right.min()),
                f"{right.mean():.1f}",
                str(sum(choice.dead for choice in chosen)),
                f"{ess[guide].mean():.1f}",
                f"{ess[guide].mean() / max(ess['open-loop'].mean(), 1e-9):.1f}",
                f"{np.median(gain):.1f}",
                str(np.sum(gain >= 10.0)),
            ]
        )
    header = ["guide", "rho", "states (unclear)", ">= 90 right", "least", "mean of 100", "no survivor", "ESS in class"]
    header += ["x open loop", "median", ">= 10 x"]
    values = [{"guide": guide, **vars(choice)} for guide, chosen in found.items() for choice in chosen]
    return header, table, values


def clear_states(judge: Scenario, tree: HomologyTree) -> tuple[list[Clear], int]:
    """STATES random states with a clear favourite, and how many others with references came up on the way."""
    rng = np.random.default_rng(20)
    found: list[Clear] = []
    unclear = 0
    while len(found) < STATES:
        x = tree.steering.sample(judge.problem.scene, rng)
        if not judge.space.clearance(x) > 0.05 or judge.problem.scene.goal.contains(x[:2]):
            continue
        runs = many(judge, tree, x)
        favourites = {max(weights, key=lambda name, w=weights: w[name]) for weights in runs}  # type: ignore[misc]
        weight = min((max(weights.values()) for weights in runs), default=0.0)
        if weight >= CLEAR and len(favourites) == 1:
            found.append(Clear(state=x, favourite=favourites.pop(), weight=weight))
        else:
            unclear += len(runs) > 0
    return found, unclear


def many(scenario: Scenario, tree: HomologyTree, x: Array) -> list[dict[str, float]]:
    """Class weights of two runs of a million samples, spread evenly over the references; none without a reference."""
    controller = scenario.controller(tree)
    controller.begin(x)
    try:
        H = max(1, len(controller.plan(x).references))
    except NoReference:
        return []
    plenty = scenario.with_settings(samples=MANY // H, classes=H).controller(tree)
    plenty.begin(x)
    estimates = [plenty.plan(x).estimate for _ in range(2)]
    return [estimate.class_weights for estimate in estimates if estimate is not None]


def choices(judge: Scenario, tree: HomologyTree, states: list[Clear], guide: str) -> list[Choice]:
    """How few samples fare at states with a clear favourite."""
    controller = judge.with_settings(guide=guide).controller(tree)
    return [_choice(controller, clear) for clear in states]


def _choice(controller: Controller, clear: Clear) -> Choice:
    controller.begin(clear.state)
    right, dead, ess = 0, 0, []
    for _ in range(REPEATS):
        plan = controller.plan(clear.state)
        if plan.estimate is None:
            dead += 1
            continue
        right += plan.favourite == clear.favourite
        ess.append(plan.estimate.class_ess.get(clear.favourite, 0.0))
    return Choice(
        state=clear.state.tolist(), favourite=clear.favourite, weight=clear.weight, right=right, dead=dead,
        ess=float(np.mean(ess or [0.0])),
    )  # fmt: skip
