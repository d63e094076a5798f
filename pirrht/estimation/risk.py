"""Predict the probability of a collision from the weighted samples of a plan.

It has two parts. With a finite final cost phi the law accepts collisions: their share is the weight of samples that end
in a wall. And a control that is held for a step h is not the law of continuous time, which turns round at every wall.
At a flat wall at a distance c the law's drift is b^2 / c, so that one held step ends behind the wall with the
probability Phi(-(a + 1 / a)), a = c / (b sqrt(h)). Optimal paths have a density like c^2 there. A path that comes
within d of the wall with a chance of r d (`Paths.exposure`, small d) then collides with a chance of r d for

    d = 2 b sqrt(h) integral of Phi(-(a + 1 / a + m / (b sqrt(h)))) a^2 da,

m being a margin between walls that plans keep from and those that are hit. The wall seems nearer by d, as a barrier
does at which one looks from time to time only (Broadie, Glasserman and Kou 1997). Fewer held paths are near the wall,
so this is a bound, to first order in sqrt(h). It holds where noise acts on the position, or on the heading of a robot
with corners: b is then the most that noise moves its outline. Where it acts on derivatives of them, a held step ends
off its path by O(h^(3/2)), and nothing is added.

Samples head for the goal. A law that ends in a wall on purpose, which is optimal where phi is less than the cost to go,
is not among them. But psi is psi_goal, the part of paths that arrive, and that of others, which is exp(-phi / lambda)
at most. So the law accepts collisions with a probability of at most exp((v_goal - phi) / lambda).
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pirrht.arrays import BoolArray
from pirrht.estimation.estimate import Estimate, all_samples
from pirrht.estimation.weights import deviation, normalised
from pirrht.outcome import Outcome
from pirrht.problem import Problem

FINE, FARTHEST = 0.02, 8.0  # step and end of the integral over a
CLOSEST = 0.45  # a below which the drift is constant (`control.held`)


class CollisionProbability(NamedTuple):
    """Probability of a collision until the goal, predicted at one state."""

    probability: float  # 0 to 1
    error: float  # its standard error
    accepted: float  # part of it that a finite phi accepts
    held: float  # part of it that holding the control adds
    classes: dict[str, float]  # probability by class of the path, given the class
    accepted_most: float  # bound of the accepted part for any phi: exp((v_goal - phi) / lambda)
    goal_value: float  # v_goal, of the samples that arrive [cost]

    @property
    def most(self) -> float:
        """Upper bound of a one-sided confidence of 95 %."""
        return min(1.0, self.held + max(self.accepted, self.accepted_most) + 1.645 * self.error)


@lru_cache(256)
def offset(step: float, margin: float = 0.0) -> float:
    """Return d / b, by which walls seem nearer to a law held for a step [s] with a margin m / b [sqrt(s)].

    Examples:
        >>> round(offset(1.0), 4), round(offset(1.0, 1.0), 4)
        (0.1001, 0.0045)
    """
    total = 0.0
    for a in np.arange(FINE / 2.0, FARTHEST, FINE).tolist():
        total += 0.5 * math.erfc((a + 1.0 / max(a, CLOSEST) + margin / math.sqrt(step)) / math.sqrt(2.0)) * a * a
    return 2.0 * math.sqrt(step) * total * FINE


def collision_probability(
    problem: Problem, estimate: Estimate, *, step: float, margin: float = 0.0, classes: Mapping[int, str] | None = None,
    margins: Mapping[int, float] | None = None,
) -> CollisionProbability:  # fmt: skip
    """Predict the probability that a run from the state of an estimate ends in a collision.

    Args:
        step: time for which a control is held [s]: a physics step, or the period where plans are held.
        margin: distance that plans keep from walls on top of the robot's radius [m].
        classes: additive class keys to names.
        margins: those of single classes, by additive key [m].
    """
    noise = problem.clearance_spread(estimate.rollouts.origin.x)
    paths, log_weight, first = all_samples(estimate.parts)
    per_exposure = np.zeros(len(log_weight))
    if noise > 0.0:
        per_exposure[:] = offset(step, margin / noise)
        for code, own in (margins or {}).items():
            per_exposure[paths.key == code] = offset(step, own / noise)
    arrived = np.where(paths.outcome == Outcome.GOAL, log_weight, -np.inf)
    goal_value = problem.temperature * (math.log(len(arrived)) - float(np.logaddexp.reduce(arrived)))
    weight = normalised(log_weight)[0]
    ended = paths.outcome == Outcome.COLLISION
    held = np.where(ended, 0.0, per_exposure * paths.exposure)

    def probabilities(chosen: BoolArray) -> tuple[float, float]:
        """Return the accepted probability and the one that holding a control adds, among the chosen samples."""
        total = max(float(weight[chosen].sum()), 1e-300)
        return float(weight[chosen & ended].sum()) / total, 1.0 - math.exp(
            -(float(weight[chosen] @ held[chosen]) / total)
        )

    accepted, added = probabilities(np.ones(len(weight), dtype=np.bool_))
    spared = math.log1p(-added) if added < 1.0 else 0.0  # counts for nothing where a collision is certain
    terms = weight * (ended + (1.0 - added) * (held + spared) - accepted)
    return CollisionProbability(
        probability=min(1.0, accepted + added), accepted=accepted, held=added,
        error=float(deviation(terms[:, None], first, estimate.rollouts.tables.mirrored)[0]),
        classes={
            name: min(1.0, sum(probabilities(paths.key == code)))
            for code, name in (classes or {}).items()
            if weight[paths.key == code].any()
        },
        accepted_most=math.exp(min(0.0, (goal_value - problem.phi) / problem.temperature)), goal_value=goal_value,
    )  # fmt: skip
