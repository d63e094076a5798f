"""The way that the samples of a class went on average: a line that stays among them and runs through no wall."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.freespace import FreeSpace
from pirrht.outcome import Outcome

MOST, POINTS = 24, 32  # samples that a way is the mean of, the heaviest of a class, and its points
TRIED = 5  # samples that may stand for a mean that touches something

Indices = NDArray[np.int64]


def ways(path_integral: PathIntegral, estimate: Estimate, names: Mapping[int, str]) -> dict[str, Array]:
    """Per class the mean of its samples that arrived, by weight, at equal shares of their time, (POINTS, 2) [m].

    Where that mean touches something or passes it on another side than its samples do, it is the sample nearest to it.

    Args:
        names: classes to look at, by additive key.
    """
    paths = estimate.rollouts.paths
    arrived = (paths.outcome == Outcome.GOAL) & (estimate.weight > 0.0)
    groups = {key: _heaviest(np.flatnonzero(arrived & (paths.key == key)), estimate.weight) for key in names}
    groups = {key: group for key, group in groups.items() if len(group)}
    if not groups:
        return {}
    lines = _lines(path_integral, estimate, np.concatenate([*groups.values()]))
    found, first = {}, 0
    for key, group in groups.items():
        mine = lines[first : first + len(group)]
        first += len(group)
        mean = np.average(mine, axis=0, weights=estimate.weight[group])
        order = np.argsort(np.abs(mine - mean).max(axis=(1, 2)), kind="stable")
        candidates = [mean, *mine[order[:TRIED]]]
        fit = (line for line in candidates if _belongs(path_integral.space, line, key))
        found[names[key]] = next(fit, mine[order[0]])
    return found


def _heaviest(group: Indices, weight: Array) -> Indices:
    return group[np.argsort(-weight[group], kind="stable")[:MOST]]


def _lines(path_integral: PathIntegral, estimate: Estimate, chosen: Indices) -> Array:
    """Paths of chosen samples (c,) at equal shares of their time, (c, POINTS, 2) [m]."""
    states, steps = path_integral.replay.trace(estimate.rollouts, chosen)
    times = estimate.rollouts.leads.times
    share = np.linspace(0.0, 1.0, POINTS)
    return np.stack(
        [
            np.column_stack([np.interp(share * times[k], times[: k + 1], line[: k + 1, i]) for i in (0, 1)])
            for line, k in zip(states, steps, strict=True)
        ]
    )


def _belongs(space: FreeSpace, line: Array, key: int) -> bool:
    """Whether a line (k, 2) [m] is free and of the class with that key, as far as that is about what stands."""
    if not space.collision.segments_free(line[:-1], line[1:]).all():
        return False
    homology = space.homology
    return bool(space.scene.movers) or homology.key(homology.winding(line)) == key
