"""Reasons for the weights of a plan: what each class costs, how many of its samples die, and where; in Markdown."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, log, sqrt
from typing import Any

import numpy as np

from pirrht.arrays import Array
from pirrht.control.plan import Plan
from pirrht.estimation.estimate import Estimate
from pirrht.estimation.sampler import PathIntegral
from pirrht.estimation.sampling import TUNING
from pirrht.exact.desirability import Desirability
from pirrht.freespace import FreeSpace
from pirrht.geometry.obstacle import Mover, rotation_of
from pirrht.geometry.shapes import Solids, distances
from pirrht.outcome import Outcome
from pirrht.topology.signature import class_id
from sim.drawing.colors import sides, title, worded
from sim.drawing.ways import ways_in
from sim.drive.metrics import why_blocked
from sim.states import adapter_of

TRACED = 48  # samples whose ends are examined
CHEAPEST, HEAVY = 4, 0.005  # classes from which all are told apart: so many, and those that weigh as much
ROWS = 8  # classes in the table at most
BORDER = "the border"
DRAWN = 400  # optimal paths that tell how much psi each class has, in every plan that is explained

Names = tuple[str, ...]


def touched(space: FreeSpace, names: Names, movers: Sequence[Mover], places: Array, times: Array) -> list[str]:
    """Name what is nearest at places (k, d) [m] and times (k,) [s]: a solid by `names`, a mover or the border."""
    scene, collision = space.scene, space.collision
    gaps = [np.minimum(places - scene.lower, scene.upper - places).min(axis=1) + scene.robot_radius]
    gaps += [collision.obstacle_distance(k, places) for k in range(len(names))]
    for mover in movers:
        poses = mover.motion.pose(times)
        d = places.shape[1]
        turns = np.array([rotation_of(pose)[:d, :d] for pose in poses]).reshape(-1, d, d)
        own = np.einsum("kij,ki->kj", turns, places - poses[:, :d])
        gap = np.empty(len(places))
        distances(Solids.of(mover.solids), np.arange(len(mover.solids)), own, collision.footprint.height, gap)
        gaps.append(gap)
    named = [BORDER, *names, *(mover.name for mover in movers)]
    return [named[k] for k in np.argmin(gaps, axis=0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """Figures that speak for a class and against it."""

    name: str  # its id
    way: str  # in words
    cost: float  # of its best path, without noise [cost]; infinite of what has none
    value: float  # v of its paths alone [cost]; infinite where none arrives
    error: float  # standard error of that [cost]
    weight: float  # its share of psi, by samples that take it
    weight_error: float | None  # standard error of that; None where no sample does
    samples: float  # effective ones that take it
    dying: float  # share of the samples drawn around its path that hit something
    late: float  # share of them that ran out of time
    pooled: float | None = None  # its share in the law, which keeps what earlier plans found, if there is such a law
    exact: float | None = None  # its share of psi by the grid, where that is known
    where: str = ""  # what they hit most often


def arriving(estimate: Estimate, ids: Names) -> dict[str, float]:
    """Return the share of the samples around each reference that arrive; where walls only weigh, by that chance."""
    return _shares(estimate, ids, lambda p: np.where(p.outcome == Outcome.GOAL, np.exp(p.log_survival), 0.0))


def _shares(estimate: Estimate, ids: Names, of: Callable[[Any], Any]) -> dict[str, float]:
    """Average something of paths over the samples drawn around each reference."""
    total = np.zeros(len(ids))
    number = np.zeros(len(ids))

    for part in estimate.parts:
        first = part.tables.first[: len(ids) + 1]
        total += np.diff(np.concatenate([[0.0], np.cumsum(of(part.paths), dtype=float)])[first])
        number += np.diff(first)
    return {name: float(total[h] / number[h]) for h, name in enumerate(ids) if number[h]}


def reasons(
    plan: Plan, path_integral: PathIntegral, solids: Names, ways: Mapping[str, str],
    exact: Mapping[str, float] | None = None,
) -> list[Reason]:  # fmt: skip
    """One for each class of a plan, in the order of its references; none in a fallback.

    `solids` names static solids in the order of the scene, `ways` the classes (`words_of`); `exact` are shares of psi.
    """
    estimate, temperature = plan.estimate, path_integral.temperature
    if estimate is None or not plan.ids:
        return []
    alive, errors = arriving(estimate, plan.ids), estimate.class_weight_errors
    late = _shares(estimate, plan.ids, lambda paths: paths.outcome == Outcome.TIMEOUT)
    where = _places(plan, estimate, path_integral, solids)
    drawn = sum(part.size for part in estimate.parts)
    found = []

    for reference, name in zip(plan.references, plan.ids, strict=True):
        weight = estimate.class_weights.get(name, 0.0)
        size = estimate.class_ess.get(name, 0.0)
        found.append(Reason(
            name=name, way=ways[name], cost=reference.cost, weight=weight, late=late.get(name, 0.0),
            weight_error=errors.get(name), samples=size,
            value=estimate.value - temperature * log(weight) if weight > 0.0 else inf,
            error=temperature * sqrt(max(0.0, 1.0 / size - 1.0 / drawn)) if size > 0.0 else inf,
            dying=max(0.0, 1.0 - alive.get(name, 0.0) - late.get(name, 0.0)),
            pooled=None if plan.shares is None else plan.shares.get(name, 0.0),
            exact=None if exact is None else exact.get(name, 0.0), where=where.get(name, ""),
        ))  # fmt: skip
    return found


def shares_of(grid: Desirability, plan: Plan, time: float, samples: int = DRAWN) -> dict[str, float]:
    """Share of psi of each class of a plan, by so many paths drawn under the optimal control from its state.

    Where the grid tells classes apart by moving obstacles and the plan does not, those of one class are added up.
    """
    found = [(name.split(","), share) for name, share in grid.shares(plan.state, samples=samples, t=time).items()]
    shares = {}
    for reference, name in zip(plan.references, plan.ids, strict=True):
        turns = class_id(reference.winding).split(",") if reference.winding else []
        shares[name] = sum(share for whole, share in found if whole[: len(turns)] == turns)
    return shares


def words_of(plan: Plan, path_integral: PathIntegral, names: Names) -> dict[str, str]:
    """The classes of a plan's references in words, by id; `names` (M,) are those of the topological obstacles."""
    if ways := ways_in(path_integral.space, plan.references, names):
        return dict(zip(plan.ids, ways, strict=True))
    windings = {name: r.winding for name, r in zip(plan.ids, plan.references, strict=True)}
    homology = path_integral.homology
    passed = dict(zip(plan.ids, sides(plan.references, homology), strict=True))
    weights = plan.weights() if plan.estimate else {}
    matter = {name for k, name in enumerate(plan.ids) if k < CHEAPEST or weights.get(name, 0.0) >= HEAVY}
    return worded(windings, homology.static.base(plan.state), names, homology.names, matter, passed)


def _places(plan: Plan, estimate: Estimate, path_integral: PathIntegral, solids: Names) -> dict[str, str]:
    """Name what the samples drawn around each reference hit most often."""
    rollouts, first = estimate.rollouts, estimate.rollouts.tables.first
    found = {}
    each = max(4, TRACED // max(1, len(plan.ids)))
    position = adapter_of(path_integral.problem.dynamics.states).position

    for h, name in enumerate(plan.ids):
        dead = first[h] + np.flatnonzero(rollouts.paths.outcome[first[h] : first[h + 1]] == Outcome.COLLISION)[:each]
        if len(dead):
            states, steps = path_integral.replay.trace(rollouts, dead)
            ends = states[np.arange(len(dead)), steps, position]
            times = plan.time + rollouts.tables.times[steps]
            found[name] = Counter(touched(path_integral.space, solids, plan.movers, ends, times)).most_common(1)[0][0]
    return found


def page(plan: Plan, reasons: Sequence[Reason], time: float) -> str:
    """Explain a plan made at a time [s]."""
    estimate = plan.estimate
    if estimate is None:
        why = "the exact solution is followed" if plan.exact is not None else "no samples"
        if plan.fallback is not None:
            why = f"blocked, {why_blocked(plan)}"
        value = "" if plan.exact is None else f" Exact value {plan.exact:.2f}."
        return f"**At {time:.2f} s: {why}.**{value}"
    value = f"{estimate.value:.2f} ± {estimate.value_error:.2f}"
    if not reasons:
        return f"**At {time:.2f} s**: value {value}; this method has no classes."
    weak = f" Only {estimate.ess:.1f} effective samples: a guess." if estimate.ess < TUNING.few else ""
    foot = f"Plan and samples of {time:.2f} s. Value of all paths {value}, {estimate.ess:.0f} effective samples."
    return f"**{sentence(reasons, plan.favourite)}**{weak}\n\n{_table(reasons)}\n\n{foot}"


def sentence(reasons: Sequence[Reason], favourite: str | None) -> str:
    """Compare the cheapest class with the heaviest: what each costs, and what becomes of its samples."""
    cheapest = min(reasons, key=lambda r: r.cost)
    chosen = next((r for r in reasons if r.name == favourite), cheapest)
    text = f"{cheapest.way}: shortest, {fate(cheapest)}"
    if chosen is not cheapest:
        text += f"; {chosen.way}: {chosen.cost - cheapest.cost:.2g} more, {fate(chosen)}"
    return f"{text[0].upper()}{text[1:]}. Most weight: class {title(chosen.name)}, {weight_of(chosen)}."


def fate(reason: Reason) -> str:
    """Put the end of a class' samples into words."""
    dying = round(100 * reason.dying)
    late = round(100 * reason.late)
    often = "nearly all" if dying == 100 and reason.dying < 1.0 else f"{dying} of 100"
    parts = [f"{often} samples hit {reason.where or 'a wall'}"] if dying else []
    rest = "all arrive" if reason.dying + reason.late == 0.0 else "nearly all arrive"
    return " and ".join([*parts, *([f"{late} of 100 ran out of time"] if late else [])]) or rest


def weight_of(reason: Reason) -> str:
    """Put the weight of a class into words: by this plan's samples, and in a law that keeps what earlier ones found."""
    if reason.pooled is None:
        return known(reason)
    return f"{share(reason.pooled)} by recent plans, {known(reason)} in this one"


def known(reason: Reason) -> str:
    """Return the weight of a class with its standard error, or without one what it rests on."""
    if reason.weight_error is None:
        return "no sample"
    if reason.samples < TUNING.lone:
        return f"{share(reason.weight)} by one sample"
    error = 100.0 * reason.weight_error
    digits = f"{error:.0f}" if error >= 1.0 else f"{error:.1f}" if error >= 0.1 else "under 0.1"
    return f"{share(reason.weight)} ± {digits} %"


def value_of(reason: Reason) -> str:
    """Return the value of a class with its standard error, where more than one sample tells it."""
    if reason.value == inf:
        return "none arrives"
    error = "by one sample" if reason.samples < TUNING.lone else f"± {reason.error:.2f}"
    return f"{reason.value:.2f} {error}"


def share(weight: float) -> str:
    """Return a weight in percent, neither rounded to none nor to all."""
    if 0.995 <= weight < 1.0 - 1e-9:
        return "over 99 %"
    return "under 1 %" if 0.0 < weight < 0.005 else f"{100 * weight:.0f} %"


def _table(reasons: Sequence[Reason]) -> str:
    rows = sorted(reasons, key=lambda r: (-round(max(r.weight, r.pooled or 0.0), 3), r.cost))[:ROWS]
    cells: dict[str, list[str]] = {
        "class": [title(r.name) for r in rows],
        "weight": [known(r) for r in rows],
        "recent plans": [share(r.pooled) for r in rows if r.pooled is not None],
        "exact": [share(r.exact) for r in rows if r.exact is not None],
        "path": [r.way for r in rows],
        "cost": [f"{r.cost:.2f}" for r in rows],
        "collide": [share(r.dying) + (f", {share(r.late)} late" * (r.late > 0.0)) for r in rows],
        "with": [r.where for r in rows],
        "value": [value_of(r) for r in rows],
    }
    columns = {head: column for head, column in cells.items() if column}
    lines = [columns.keys(), ["---"] * len(columns), *zip(*columns.values(), strict=True)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
