"""Follow the best class only, as planners that optimise one trajectory per topology and pick one of them.

teb_local_planner (Roesmann, Hoffmann and Bertram, Robotics and Autonomous Systems 88, 2017) and T-MPC (de Groot,
Ferranti, Gavrila and Alonso-Mora, IEEE T-RO 2025) optimise several homotopy classes and execute the cheapest. Here
psi_h is the mean over the samples around reference h, each weighed by dP/dQ_h alone, v_h = -lambda log psi_h, and the
control is the mean of these samples. Both planners can favour the class followed so far: its cost is multiplied by
`selection_cost_hysteresis` (1 by default) or by `selection_weights/consistency` (0.8 as T-MPC is configured).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pirrht.arrays import Array
from pirrht.control.policy import ClassMemory
from pirrht.estimation.estimate import Estimate, Rollouts, weigh
from pirrht.estimation.weights import log_weights
from pirrht.problem import Problem
from pirrht.proposals.proposal import Batch


def follow_best(
    problem: Problem, estimate: Estimate, batch: Batch, memory: ClassMemory, consistency: float
) -> Estimate:  # fmt: skip
    """Return the estimate by the samples of the best class alone; forget those of earlier plans if it is another."""
    ids = list(batch.classes.values())
    best = best_class(problem, estimate, ids, memory.followed, consistency=consistency)
    if memory.followed != ids[best]:
        memory.followed, memory.mixture = ids[best], None
    return alone(problem, estimate, best, {key: name for key, name in batch.classes.items() if name == ids[best]})


def best_class(
    problem: Problem, estimate: Estimate, names: Sequence[str], followed: str | None, *, consistency: float
) -> int:
    """Return the number of the reference to follow next, of those with class `names` (H,) in sample order.

    The value v [cost] of `followed`, the class followed so far, is multiplied by `consistency`.
    """
    values = class_values(problem, estimate)[: len(names)]
    if followed in names:
        values[names.index(followed)] *= consistency
    return int(np.argmin(values))


def class_values(problem: Problem, estimate: Estimate) -> Array:
    """Estimate v (H,) [cost] by the samples around each reference alone; infinite where none survived."""
    number = sum(np.diff(part.tables.first) for part in estimate.parts)
    sums = [np.logaddexp.reduceat(_own(problem, part), part.tables.first[:-1]) for part in estimate.parts]
    values: Array = -problem.temperature * (np.logaddexp.reduce(sums) - np.log(number))
    return values


def alone(problem: Problem, estimate: Estimate, h: int, classes: Mapping[int, str] | None = None) -> Estimate:
    """Estimate v [cost], u (m,) and their errors by the samples around reference h alone.

    Args:
        classes: additive class keys to names, as `weigh` takes them.

    Raises:
        NoSurvivingSample: none of them has any weight.
    """
    return weigh(problem, [_restricted(problem, part, h) for part in estimate.parts], estimate.walls, classes)


def _own(problem: Problem, part: Rollouts) -> Array:
    """Return log weights (S,) as if there were no samples but those around their own reference."""
    number = np.diff(part.tables.first)
    averaged = log_weights(problem, "average", part.paths, part.tables.first)
    own: Array = averaged - np.repeat(np.log(part.size / (len(number) * number)), number)
    return own


def _restricted(problem: Problem, part: Rollouts, h: int) -> Rollouts:
    # The others weigh nothing; a mean over all samples is the mean over these if each counts S / N_h times.
    first, log_weight = part.tables.first, np.full(part.size, -np.inf)
    mine = slice(int(first[h]), int(first[h + 1]))
    averaged = log_weights(problem, "average", part.paths, first, mine)
    log_weight[mine] = averaged + np.log(len(first) - 1)
    return replace(part, log_weight=log_weight)
