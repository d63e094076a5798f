"""Effective samples along one drive, in `clutter` unless asked, and whether log psi agrees with a million samples.

psi of REPEATS runs is averaged, which keeps it unbiased; its error is their scatter. Where a run has about one
effective sample the scatter says little: the paths that weigh most are too rare to be among those drawn, psi comes
out too small and its error with it.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pirrht.arrays import Array
from pirrht.errors import NoReference
from pirrht.estimation.estimate import Estimate
from pirrht.planner.tree import HomologyTree
from sim.scenario import Scenario, prepare

APART = 10  # control steps between the states that are looked at
REPEATS = 20
MANY, FEW = 1_000_000, 300  # all samples together; samples around each reference
WITHIN = 3.0  # standard errors
GUIDES = ("feedback", "open-loop")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """What repeated runs say at one state, and a run of a million samples with feedback guidance."""

    state: list[float]
    guide: str
    ess: float  # effective samples of a run, the mean
    class_ess: float  # within the class that is favoured by a million
    dead: int  # runs without a survivor; they count as psi = 0
    log_psi: float  # of the mean of psi
    error: float  # its standard error
    reference: float  # log psi of a million samples
    reference_error: float

    @property
    def off(self) -> float:
        """Distance from the reference, in standard errors of the difference."""
        return abs(self.log_psi - self.reference) / float(np.hypot(self.error, self.reference_error))


def rows(options: argparse.Namespace) -> tuple[list[str], list[list[str]], object]:
    """Header, table and JSON of the figures."""
    robot = options.robot or "unicycle"
    own = {"rho": options.rho} if robot == "unicycle" else {}
    noise = {"noise": options.noises[0]} if options.noises else {}
    given = {"seed": 0, "samples": FEW, **own, **noise}
    scenario = prepare(options.scene or "clutter", robot=robot, given=given)
    tree = scenario.grown_tree()
    found = [figure for x in driven(scenario, tree) for figure in figures(scenario, tree, x)]
    table = []
    for guide in ways_of(tree):
        own = [figure for figure in found if figure.guide == guide]
        table.append(
            [
                guide,
                robot,
                str(len(own)),
                f"{np.mean([f.ess for f in own]):.1f}",
                f"{np.mean([f.class_ess for f in own]):.1f}",
                str(sum(f.dead for f in own)),
                f"{np.median([f.log_psi - f.reference for f in own]):+.3f}",
                f"{np.median([f.error for f in own]):.3f}",
                f"{np.median([f.reference_error for f in own]):.4f}",
                f"{np.sum([f.off <= WITHIN for f in own])}",
            ]
        )
    header = ["guide", "robot", "states", "ESS", "in class", "no survivor"]
    header += ["log psi - 10^6", "error", "of 10^6", "within 3"]
    return header, table, [{**vars(figure), "off": figure.off} for figure in found]


def ways_of(tree: HomologyTree) -> tuple[str, ...]:
    """Ways of guiding; references that are only a path have no tapes."""
    return GUIDES if tree.steering.drives else GUIDES[:1]


def driven(scenario: Scenario, tree: HomologyTree) -> list[Array]:
    """States of one drive under the defaults, APART control steps from each other."""
    frames = scenario.drive(scenario.plant(), scenario.driver(tree))
    return [frame.plan.state for frame in frames if frame.step % APART == 0]


def figures(scenario: Scenario, tree: HomologyTree, x: Array) -> list[Figure]:
    """Both ways of guiding at one state; nothing where the tree alone has no reference."""
    try:
        H = len(estimates(scenario, tree, x, 1)[0].proposal_weights)
    except NoReference:
        return []
    plenty = estimates(scenario.with_settings(samples=MANY // H), tree, x, 1)[0]
    favourite = max(plenty.class_weights, key=lambda name: plenty.class_weights[name])
    found = []
    for guide in ways_of(tree):
        runs = estimates(scenario.with_settings(guide=guide), tree, x, REPEATS)
        alive = [run for run in runs if run.survivors > 0]
        log_psi, error = averaged([run.log_psi for run in alive], REPEATS)
        found.append(
            Figure(
                state=x.tolist(),
                guide=guide,
                ess=float(np.mean([run.ess for run in alive] or [0.0])),
                class_ess=float(np.mean([run.class_ess.get(favourite, 0.0) for run in alive] or [0.0])),
                dead=REPEATS - len(alive),
                log_psi=log_psi,
                error=error,
                reference=plenty.log_psi,
                reference_error=float(np.sqrt(max(np.sum(plenty.weight**2) - 1.0 / len(plenty.weight), 0.0))),
            )
        )
    return found


def estimates(scenario: Scenario, tree: HomologyTree, x: Array, repeats: int) -> list[Estimate]:
    """Independent estimates at one state; none of the runs in which no sample had any weight."""
    controller = scenario.controller(tree)
    controller.begin(x)
    plans = [controller.plan(x) for _ in range(repeats)]
    return [plan.estimate for plan in plans if plan.estimate is not None]


def averaged(log_psi: Sequence[float], repeats: int) -> tuple[float, float]:
    """Log of the mean of `repeats` values of psi, of which those not given are 0, and its standard error."""
    if not log_psi:
        return -np.inf, np.inf
    top = max(log_psi)
    psi = np.zeros(repeats)
    psi[: len(log_psi)] = np.exp(np.array(log_psi) - top)
    return top + float(np.log(psi.mean())), float(psi.std(ddof=1) / np.sqrt(repeats) / psi.mean())
