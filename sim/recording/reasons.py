"""Reasons for the weights of a plan: what each class costs, how many of its samples die, and where; in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, inf, isfinite, log, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import TUNING
from pirrht.geometry.collision import Collision
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Footprint, Workspace
from pirrht.moving.collision import NOWHERE, radius_of
from pirrht.outcome import Outcome
from sim.drawing.colors import title
from sim.drawing.sides import sides, worded

ASKED = 3  # bodies that are asked how near they are
TRACED, NEAREST = 48, 3  # samples whose ends are looked at, obstacles that are asked how near they are
CHEAPEST, HEAVY = 4, 0.005  # classes from which all are told apart: so many, and those that weigh as much
BORDER = "the border"

Names = tuple[str, ...]
ROWS, SAID = 8, 3  # classes in the table and in the sentence at most
FEWEST = 0.005  # weight from which a class is spoken of, the cheapest and the heaviest aside


class Bystanders:
    """The shapes of bodies that move; how they move is told when they are asked about."""

    def __init__(self, movers: Sequence[Mover], footprint: Footprint) -> None:
        self._shapes = [Collision(Workspace(-NOWHERE, NOWHERE, mover.solids), footprint) for mover in movers]
        self._reach = np.array([radius_of(mover) for mover in movers])
        self._radius = footprint.radius

    def nearest(self, movers: Sequence[Mover], places: Array, times: Array) -> list[tuple[float, str]]:
        """Free distance of a robot at places (k, 2) [m] and times (k,) [s] to the nearest body, and its name.

        Args:
            movers: the same bodies, as they are taken to move.
        """
        if not movers:
            return [(inf, "")] * len(places)
        poses = np.stack([mover.motion.pose(times) for mover in movers], axis=1)
        off = places[:, None] - poses[..., :2]
        near = np.argsort(np.linalg.norm(off, axis=2) - self._reach, axis=1, kind="stable")[:, :ASKED]
        return [
            min((self._free(j, away[j], float(yaws[j])), movers[j].name) for j in asked)
            for asked, away, yaws in zip(near.tolist(), off, poses[..., 2], strict=True)
        ]

    def _free(self, j: int, off: Array, yaw: float) -> float:
        c, s = cos(yaw), sin(yaw)
        own = np.array([[c * off[0] + s * off[1], c * off[1] - s * off[0]]])
        return float(self._shapes[j].distance(own)[0]) - self._radius


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Figures that speak for a class and against it."""

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
    """Return the share of the samples around each reference that arrive; where walls only weigh, by that chance."""
    return _shares(
        estimate, ids, lambda paths: np.where(paths.outcome == Outcome.GOAL, np.exp(paths.log_survival), 0.0)
    )


def _shares(estimate: Estimate, ids: Names, of: Callable[[Any], Any]) -> dict[str, float]:
    """Average something of paths over the samples drawn around each reference."""
    total, number = np.zeros(len(ids)), np.zeros(len(ids))
    for part in estimate.parts:
        values = of(part.paths)
        for h, (a, b) in enumerate(_slices(part.tables.first, len(ids))):
            total[h] += values[a:b].sum()
            number[h] += b - a
    return {name: float(total[h] / number[h]) for h, name in enumerate(ids) if number[h]}


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
    alive = arriving(estimate, plan.ids)
    late = _shares(estimate, plan.ids, lambda paths: paths.outcome == Outcome.TIMEOUT)
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
    homology = path_integral.homology
    passed = {name: sides(r, homology) for name, r in zip(plan.ids, plan.references, strict=True)}
    weights = plan.estimate.class_weights if plan.estimate else {}
    matter = {name for k, name in enumerate(plan.ids) if k < CHEAPEST or weights.get(name, 0.0) >= HEAVY}
    straight = homology.static.base(plan.state)
    return worded(windings, straight, names, homology.names, matter, passed)


def _slices(first: NDArray[np.int64], count: int) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for a, b in zip(first[:count], first[1 : count + 1], strict=True)]


def _places(
    plan: Plan, estimate: Estimate, path_integral: PathIntegral, names: Names, bystanders: Bystanders | None
) -> dict[str, Counter[str]]:
    """Count what the samples drawn around each reference hit, of as many as are worth it."""
    rollouts, ids = estimate.rollouts, plan.ids
    chosen: list[NDArray[np.int64]] = []
    slices = _slices(rollouts.tables.first, len(ids))
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
        collision, times = path_integral.space.collision, plan.time + rollouts.tables.times[steps]
        free = collision.clearance(ends)
        near = bystanders.nearest(plan.movers, ends, times)
        hit = [who if gap < room else what for (gap, who), room, what in zip(near, free, hit, strict=True)]
    found, first = {}, 0
    for name, group in zip(ids, chosen, strict=True):
        found[name] = Counter(hit[first : first + len(group)])
        first += len(group)
    return found


def met(collision: Collision, points: Array, names: Names) -> list[str]:
    """Name the solid nearest to robots at points (k, 2) [m], or the border."""
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


def page(plan: Plan, reasons: Sequence[Reason], time: float) -> str:
    """Explain a plan made at a time [s]."""
    estimate = plan.estimate
    if estimate is None:
        why = "the exact solution is followed" if plan.exact is not None else "no samples"
        if plan.fallback is not None:
            why = f"blocked, {plan.fallback}: {'braking' if plan.stops else 'the longest free way is taken'}"
        value = "" if plan.exact is None else f" Exact value {plan.exact:.2f}."
        return f"**At {time:.2f} s: {why}.**{value}"
    if not reasons:
        value = f"value {estimate.value:.2f} ± {estimate.value_error:.2f}"
        return f"**At {time:.2f} s**: {value}; this method has no classes."
    weak = f" Only {estimate.ess:.1f} effective samples: a guess." if estimate.ess < TUNING.few else ""
    head = f"**{sentence(reasons, plan.favourite)}**{weak}"
    return f"{head}\n\n{_table(reasons)}\n\n{_foot(plan, time)}"


def sentence(reasons: Sequence[Reason], favourite: str | None) -> str:
    """The classes that matter, from the cheapest on: what each costs, who dies there, and which one is driven."""
    cheapest = min(reasons, key=lambda r: r.cost)
    spoken = [r for r in reasons if r is cheapest or r.name == favourite]
    rest = sorted((r for r in reasons if r not in spoken and r.weight >= FEWEST), key=lambda r: -r.weight)
    spoken = sorted([*spoken, *rest[: SAID - len(spoken)]], key=lambda r: r.cost)
    parts = []
    for reason in spoken:
        dearer = reason.cost - cheapest.cost
        price = "shortest" if reason is cheapest else "as short" if dearer < 0.005 else f"{dearer:.2g} dearer"
        joint = ", but " if reason is cheapest and reason.dying >= 0.2 else ", "
        parts.append(f"{reason.way}: {price}{joint}{fate(reason)}")
    text = "; ".join(parts)
    driven = next((r for r in reasons if r.name == favourite), None)
    chosen = "" if driven is None else f" Most weight: class {title(driven.name)}, {share(driven.weight)}."
    return f"{text[0].upper()}{text[1:]}.{chosen}"


def fate(reason: Reason) -> str:
    """Put the end of a class' samples into words."""
    dying, late = round(100 * reason.dying), round(100 * reason.late)
    if not dying and not late:
        return "all arrive"
    parts = []
    if dying:
        what = _where(reason) if reason.where else "a wall"
        parts.append(f"{'all' if dying == 100 else f'{dying} of 100'} samples hit {what}")
    if late:
        parts.append(f"{late} of 100 ran out of time")
    return " and ".join(parts)


def share(weight: float) -> str:
    """A weight in percent, rounded to nothing else than it is: neither to none nor to all."""
    if 0.995 <= weight < 1.0 - 1e-9:
        return "over 99 %"
    return "under 1 %" if 0.0 < weight < 0.005 else f"{100 * weight:.0f} %"


def _where(reason: Reason) -> str:
    if len(reason.where) == 1 or reason.where[0][1] > 0.9:
        return reason.where[0][0]
    return " or ".join(name for name, _ in reason.where)


def _table(reasons: Sequence[Reason]) -> str:
    rows = sorted(reasons, key=lambda r: (-round(r.weight, 3), r.cost))
    known = any(r.exact is not None for r in rows)
    exact = (" exact |", "--:|") if known else ("", "")
    lines = [  # what a narrow view cuts off at the right is also in its plots
        f"| class | weight |{exact[0]} path | cost | collide | with | value |",
        f"|---|--:|{exact[1]}---|--:|--:|---|--:|",
    ]
    for r in rows[:ROWS]:
        value = _valued(r)
        dying = f"{100 * r.dying:.0f} %" + (f", {100 * r.late:.0f} % late" if r.late >= 0.005 else "")
        told = [share(r.exact or 0.0)] if known else []
        cells = (
            title(r.name),
            share(r.weight),
            *told,
            r.way,
            f"{r.cost:.2f}",
            dying,
            _where(r) if r.where else "",
            value,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _valued(reason: Reason) -> str:
    if not isfinite(reason.value):
        return "none arrives"
    return f"{reason.value:.2f} ± {reason.error:.2f}" if isfinite(reason.error) else f"{reason.value:.2f} by one sample"


def _foot(plan: Plan, time: float) -> str:
    assert plan.estimate is not None
    e = plan.estimate
    return (
        f"Plan and samples of {time:.2f} s. Value of all paths {e.value:.2f} ± {e.value_error:.2f}, "
        f"{e.ess:.0f} effective samples."
    )
