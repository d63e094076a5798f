"""Search for the least safety margin whose predicted probability of a collision is at most a risk."""

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

from pirrht.control.plan import Plan
from pirrht.errors import NoReference, OptionError, SceneError
from pirrht.estimation.risk import CollisionProbability
from pirrht.formatting import percent
from pirrht.planner.tree import HomologyTree
from sim.scenario.scenario import Scenario

PREDICTED = ("pi-rrht", "optimal")  # methods whose law is that of the prediction
ROUNDS = 8  # margins that are tried
FINEST = 1e-4  # margins are whole multiples of this [m]
WIDEST = 4.0  # of margins that are weighed at once, in deviations of a held step: it removes all but 1e-9 of the risk
RESERVE = 2.0  # by which predictions can be too low: 2.3 in the worst of 120 cells (`benchmark.py risk`)
ACCEPTED = 0.1  # of a risk: most that a finite final cost accepts
DRAWN, MOST_DRAWN = 4, 10_000  # times the samples of a plan, since it is made once per run; and at most


@dataclass(frozen=True, slots=True, eq=False)
class StartPlan:
    """One plan at the start, of more samples than those of a run, which predicts the probability of a collision."""

    scenario: Scenario
    tree: HomologyTree
    plan: Plan

    @classmethod
    def of(cls, scenario: Scenario, tree: HomologyTree | None = None) -> Self:
        """Plan over a tree, which is grown if it is not given; NoReference: no class reaches the goal."""
        many = scenario.with_settings(samples=min(DRAWN * scenario.settings.samples, MOST_DRAWN), method="pi-rrht")
        grown = tree or scenario.grown_tree()
        driver = many.controller(grown)
        driver.begin(many.start)
        return cls(scenario, grown, driver.plan(many.start))

    def collision(self, margin: float = 0.0) -> CollisionProbability | None:
        """Predict with a wider margin by so much [m]; None: no sample reaches the goal."""
        return self.scenario.collisions(self.plan, margin)


def predicted(scenario: Scenario, tree: HomologyTree | None = None) -> CollisionProbability | None:
    """Predict the probability of a collision by one plan at the start, over a tree that may be given.

    None: nothing is predicted (`Scenario.collisions`). What the search for a margin has predicted is not predicted
    again.
    """
    if scenario.collision is not None or not scenario.predicts_collisions:
        return scenario.collision
    return StartPlan.of(scenario, tree).collision()


@dataclass(slots=True, eq=False)
class RiskSearch:
    """Search for the least margin whose upper bound of the probability of a collision is at most `risk`.

    Predictions count RESERVE times: they take walls as flat, and the law as the optimal one. The next margin is chosen
    by the samples of the plan with the last one: from their walls the true ones move away. A final cost with which the
    law accepts more than a share ACCEPTED of the risk is raised.

    `at` makes the scenario with a margin [m] and settings by name.
    """

    at: Callable[..., Scenario]
    risk: float
    phi: dict[str, float] = field(default_factory=dict)  # the final cost, once it has been raised [cost]
    wide: float = 0.0  # last margin that does not keep the risk [m]
    step: float = 0.0  # by which it must be wider by its own samples [m]
    closed: float = math.inf  # last margin that leaves no path [m]
    nearest: tuple[CollisionProbability, StartPlan] | None = None  # of those that do not keep it

    def result(self, *, stop: bool) -> Scenario:
        """Return the scenario of that margin.

        Where none keeps the risk, OptionError is raised if the search shall `stop` there; else the nearest is taken.
        """
        margin = 0.0
        for _ in range(ROUNDS):
            plan = self._planned(margin)
            collision = None if plan is None else plan.collision()
            if plan is None or (collision is None and self.nearest is not None):
                self.closed = margin
            elif collision is None:
                return _unpredicted(plan.scenario, stop=stop)
            elif not self.phi and collision.accepted_most > ACCEPTED * self.risk:
                lambdas = math.log(ACCEPTED * self.risk / 2.0)
                self.phi = {"phi": collision.goal_value - plan.scenario.problem.temperature * lambdas}
                continue
            elif RESERVE * collision.most <= self.risk:
                note = f"with phi raised to {self.phi['phi']:.4g}" if self.phi else ""
                return _chosen(collision, plan, note)
            else:
                if self.nearest is None or collision.most < self.nearest[0].most:
                    self.nearest = collision, plan
                self.wide = margin
                self.step = self._wider(plan)
            margin = self.wide + self.step
            margin = round(margin if margin < self.closed else 0.5 * (self.wide + self.closed), 4)
            if margin in (self.wide, self.closed):
                break
        return self._nearest(stop=stop)

    def _planned(self, margin: float) -> StartPlan | None:
        """Plan with a margin [m]; None: after the first plan, no path is as wide as that."""
        try:
            scenario = self.at(margin, **self.phi)
            if not scenario.predicts_collisions or scenario.settings.method not in PREDICTED:
                methods = ", ".join(PREDICTED)
                raise OptionError(f"--risk takes --exit bridge and a method of {methods}; others take --margin")
            return StartPlan.of(scenario)
        except (NoReference, SceneError):
            if self.nearest is None:
                raise
            return None

    def _wider(self, plan: StartPlan) -> float:
        """Return by how much a margin must be wider by a plan's own samples [m], as far as they say."""
        scenario = plan.scenario
        spread = scenario.problem.clearance_spread(scenario.start)
        count = math.ceil(WIDEST * spread * math.sqrt(scenario.held) / FINEST)

        def keeps(steps: int) -> bool:
            collision = plan.collision(FINEST * steps)
            return collision is not None and RESERVE * collision.most <= self.risk

        return FINEST * bisect_left(range(count), True, key=keeps)

    def _nearest(self, *, stop: bool) -> Scenario:
        assert self.nearest is not None
        collision, plan = self.nearest
        name, best = min(collision.classes.items(), key=lambda one: one[1])
        least = f"{percent(min(1.0, RESERVE * collision.most))} at most, by class {name} ({percent(best)})"
        if stop:
            raise OptionError(
                f"--risk is {self.risk:g}; no margin that leaves a way keeps it. Nearest comes one of "
                f"{1e3 * plan.scenario.margin:.2g} mm with {least}: allow more, or --risk-infeasible best"
            )
        return _chosen(collision, plan, f"not kept: {least}")


def _unpredicted(scenario: Scenario, *, stop: bool) -> Scenario:
    if stop:
        raise OptionError("--risk: no sample of a plan at the start reaches the goal, so that no probability of a "
                          "collision is predicted: try more --samples, or --risk-infeasible best")  # fmt: skip
    return replace(scenario, risk_note="not predicted")


def _chosen(collision: CollisionProbability, plan: StartPlan, note: str) -> Scenario:
    """Return the scenario of a plan with all that the plan has found out."""
    return replace(plan.scenario, risk_note=note, spare=[plan.tree], collision=collision)
