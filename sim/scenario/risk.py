"""Choose the least safety margin with which a run collides with at most a given probability."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from pirrht.errors import NoReference, OptionError, SceneError
from pirrht.estimation.risk import CollisionProbability
from sim.scenario.scenario import Scenario

ROUNDS = 8  # margins that are tried
FINEST = 1e-4  # margins are whole multiples of this [m]
WIDEST = 4.0  # of margins that are weighed at once, in deviations of a held step: it removes all but 1e-9 of the risk
DRAWN = 4  # times the samples of a plan: this estimate is made once per run


def predicted(scenario: Scenario, margins: Sequence[float] = (0.0,)) -> list[CollisionProbability] | None:
    """Predict the probability of a collision by one plan at the start, for margins besides the scenario's own [m].

    None: nothing is predicted (`Scenario.collisions`).
    """
    many = scenario.with_settings(samples=DRAWN * scenario.settings.samples)
    driver = many.controller(many.grown_tree())
    driver.begin(many.start)
    plan = driver.plan(many.start)
    return [one for more in margins if (one := many.collisions(plan, more)) is not None] or None


def within_risk(at: Callable[[float], Scenario], risk: float, *, stop: bool) -> Scenario:
    """Return the scenario of the least margin whose upper bound of the probability of a collision is at most `risk`.

    The next margin is chosen by the samples of the plan with the last one: from their walls the true ones move away.

    Args:
        at: makes the scenario with a margin [m].
        stop: whether OptionError is raised if no margin keeps the risk; else the one that comes nearest is taken.
    """
    scenario, margin, wide, closed = at(0.0), 0.0, 0.0, math.inf
    spread = scenario.problem.dynamics.position_spread(scenario.start)
    more = np.arange(0.0, WIDEST * spread * math.sqrt(scenario.physics_step) + FINEST, FINEST).tolist()
    tried: list[tuple[float, Scenario]] = []
    for _ in range(ROUNDS):
        try:
            scenario = at(margin) if margin > 0.0 else scenario
            found = predicted(scenario, more)
        except (NoReference, SceneError):  # no way is as wide as that
            found = None
        if found is None:
            if not tried:
                raise OptionError(
                    "--risk: no probability of a collision is predicted here; it takes a robot whose position is noisy"
                )
            closed = margin
        elif found[0].most <= risk:
            return scenario
        else:
            tried.append((found[0].most, scenario))
            wide, enough = margin, next((m for m, one in zip(more, found, strict=True) if one.most <= risk), more[-1])
        margin = round(wide + enough if wide + enough < closed else 0.5 * (wide + closed), 4)
        if margin in (wide, closed):
            break
    most, nearest = min(tried, key=lambda one: one[0])
    if stop:
        raise OptionError(
            f"--risk is {risk:g}; with a margin of {nearest.margin:g} m the probability of a collision is at most "
            f"{most:.2g}, and no margin that leaves a way keeps it: allow more, or --risk-infeasible best"
        )
    return nearest
