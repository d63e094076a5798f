"""Why a plan weighs its classes as it does: what each costs, how many of its samples die, and where."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, log, sqrt

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.geometry.collision import Collision
from pirrht.outcome import Outcome
from sim.drawing.sides import sides
from sim.drawing.ways import worded
from sim.recording.bystanders import Bystanders

TRACED, NEAREST = 48, 3  # samples whose ends are looked at, obstacles that are asked how near they are
CHEAPEST, HEAVY = 4, 0.005  # classes from which all are told apart: so many, and those that weigh as much
BORDER = "the border"

Names = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """What speaks for a class and against it."""

    name: str  # its id
    way: str  # in words
    cost: float  # of its best path, without noise [cost]; infinite of what has none
    value: float  # v of its paths alone [cost]; infinite where none arrives
    error: float  # standard error of that [cost]
    weight: float  # its share of psi
    dying: float  # share of the samples drawn around its path that hit something
    late: float  # share of them that ran out of time
    exact: float | None = None  # its share of psi by the grid, where that is known
    where: tuple[tuple[str, float], ...] = ()  # what they hit, most often first, and the share of the dying


def arriving(estimate: Estimate, ids: Names) -> dict[str, float]:
    """Share of the samples drawn around each reference that arrive; where walls only weigh, by that chance."""
    alive, number = np.zeros(len(ids)), np.zeros(len(ids))
    for part in estimate.parts:
        chance = np.where(part.paths.outcome == Outcome.GOAL, np.exp(part.paths.lasting), 0.0)
        for h, (a, b) in enumerate(_slices(part.leads.first, len(ids))):
            alive[h] += chance[a:b].sum()
            number[h] += b - a
    return {name: float(alive[h] / number[h]) for h, name in enumerate(ids) if number[h]}


def reasons(
    plan: Plan,
    path_integral: PathIntegral,
    names: Names,
    ways: dict[str, str],
    exact: Mapping[str, float] | None = None,
    bystanders: Bystanders | None = None,
) -> list[Reason]:
    """One for each class of a plan, in the order of its references; none in a fallback.

    Args:
        names: what to call the solids of the scene.
        ways: the classes in words (`words_of`).
        exact: share of psi of each class by the grid, if there is one.
        bystanders: the bodies that move, which samples may hit too.
    """
    estimate = plan.estimate
    if estimate is None or not plan.ids:
        return []
    alive, late = arriving(estimate, plan.ids), _late(estimate, plan.ids)
    places = _places(plan, estimate, path_integral, names, bystanders)
    drawn = sum(part.size for part in estimate.parts)
    found = []
    for reference, name in zip(plan.references, plan.ids, strict=True):
        weight, size = estimate.class_weights.get(name, 0.0), estimate.class_ess.get(name, 0.0)
        hit = places.get(name, Counter())
        found.append(
            Reason(
                name=name,
                way=ways[name],
                cost=reference.cost,
                value=estimate.value - path_integral.temperature * log(weight) if weight > 0.0 else inf,
                error=path_integral.temperature * sqrt(max(0.0, 1.0 / size - 1.0 / drawn)) if size > 0.0 else inf,
                weight=weight,
                dying=max(0.0, 1.0 - alive.get(name, 0.0) - late.get(name, 0.0)),
                late=late.get(name, 0.0),
                exact=None if exact is None else exact.get(name, 0.0),
                where=tuple((what, count / hit.total()) for what, count in hit.most_common(2)),
            )
        )
    return found


def words_of(plan: Plan, path_integral: PathIntegral, names: Names) -> dict[str, str]:
    """The classes of a plan's references in words, by id; `names` (M,) are those of the topological obstacles.

    They are told apart from those that matter: from all that there are would take too many words.
    """
    windings = {name: r.winding for name, r in zip(plan.ids, plan.references, strict=True)}
    timed = path_integral.homology
    movers = () if timed is None else timed.moving.names
    passed = None
    if timed is not None:
        passed = {name: sides(r, timed.moving) for name, r in zip(plan.ids, plan.references, strict=True)}
    weights = plan.estimate.class_weights if plan.estimate else {}
    matter = {name for k, name in enumerate(plan.ids) if k < CHEAPEST or weights.get(name, 0.0) >= HEAVY}
    straight = path_integral.space.homology.straight(plan.state[None, :2])[0]
    return worded(windings, straight, names, movers, matter, passed)


def _slices(first: NDArray[np.int64], count: int) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for a, b in zip(first[:count], first[1 : count + 1], strict=True)]


def _late(estimate: Estimate, ids: Names) -> dict[str, float]:
    late, number = np.zeros(len(ids)), np.zeros(len(ids))
    for part in estimate.parts:
        for h, (a, b) in enumerate(_slices(part.leads.first, len(ids))):
            late[h] += np.sum(part.paths.outcome[a:b] == Outcome.TIMEOUT)
            number[h] += b - a
    return {name: float(late[h] / number[h]) for h, name in enumerate(ids) if number[h]}


def _places(
    plan: Plan, estimate: Estimate, path_integral: PathIntegral, names: Names, bystanders: Bystanders | None
) -> dict[str, Counter[str]]:
    """What the samples drawn around each reference hit, of as many as are worth a look."""
    rollouts, ids = estimate.rollouts, plan.ids
    chosen: list[NDArray[np.int64]] = []
    slices = _slices(rollouts.leads.first, len(ids))
    each = max(4, TRACED // max(1, len(ids)))
    for a, b in slices:
        dead = a + np.flatnonzero(rollouts.paths.outcome[a:b] == Outcome.COLLISION)
        chosen.append(dead[:each])  # neighbours are simulated again together, and are as random as any others
    every = np.concatenate(chosen)
    if not len(every):
        return {}
    states, steps = path_integral.replay.trace(rollouts, every)
    ends = states[np.arange(len(every)), steps, :2]
    hit = met(path_integral.space.collision, ends, names)
    if bystanders is not None:
        collision, times = path_integral.space.collision, plan.time + rollouts.leads.times[steps]
        free = collision.clearance(ends)
        near = bystanders.nearest(plan.movers, ends, times)
        hit = [who if gap < room else what for (gap, who), room, what in zip(near, free, hit, strict=True)]
    found, first = {}, 0
    for name, group in zip(ids, chosen, strict=True):
        found[name] = Counter(hit[first : first + len(group)])
        first += len(group)
    return found


def met(collision: Collision, points: Array, names: Names) -> list[str]:
    """What robots at points (k, 2) [m] touch: the nearest of the solids, or the border."""
    lower, upper = collision.extents()
    world = collision.world
    border = np.minimum(points - world.lower, world.upper - points).min(axis=1) - collision.footprint.radius
    if not len(lower):
        return [BORDER] * len(points)
    gap = np.maximum(np.maximum(lower[None] - points[:, None], points[:, None] - upper[None]), 0.0)
    near = np.argsort(np.linalg.norm(gap, axis=2), axis=1, kind="stable")[:, :NEAREST]
    found = []
    for point, candidates, edge in zip(points, near, border, strict=True):
        distances = [float(collision.obstacle_distance(int(k), point[None])[0]) for k in candidates]
        best = int(np.argmin(distances))
        outside = edge + collision.footprint.radius < max(0.0, distances[best] - collision.footprint.radius)
        found.append(BORDER if outside else names[int(candidates[best])])
    return found
