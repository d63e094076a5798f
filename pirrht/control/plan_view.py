"""A plan as a line, as a table and as a picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht import shown
from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.outcome import Outcome
from pirrht.plotting import axes as axes_of
from pirrht.plotting import ground, lines

ALONG = 0.5  # the arrow of a control is as long as the way that its first two entries lead in this time [s]
FAINT, STRONG = 0.08, 0.6  # opacity of samples, of the least and of the greatest weight


def line(plan: Any) -> str:
    """A plan in one line."""
    if plan.estimate is not None:
        said = f"v {plan.estimate.value:.4g} +- {plan.estimate.value_error:.2g}"
    else:
        said = f"blocked, {plan.fallback}" if plan.fallback else f"v {plan.exact or np.nan:.4g}"
    which = f", {len(plan.ids)} classes" if len(plan.ids) != 1 else ", 1 class"
    weight = weights(plan).get(plan.favourite or "")
    lead = f", most weight {shown.turns(plan.favourite)} ({shown.share(weight)})" if weight is not None else ""
    return f"Plan(at {shown.vector(plan.state)}: control {shown.vector(plan.control)}, {said}{which}{lead})"


def weights(plan: Any) -> dict[str, float]:
    """Weight of every class under the law, else in the estimate; empty without either."""
    found = {} if plan.estimate is None else plan.estimate.class_weights
    return {**found, **(plan.shares or {})}


def table(plan: Any) -> str:
    """A plan as an HTML table, one row per class."""
    by, estimate = weights(plan), plan.estimate
    rows = []
    for id, reference in zip(plan.ids, plan.references, strict=False):
        ess = "" if estimate is None or id not in estimate.class_ess else f"{estimate.class_ess[id]:.1f}"
        weight = shown.share(by[id]) if id in by else ""
        rows.append([shown.turns(id), f"{reference.cost:.4g}", f"{reference.length:.3g}", weight, ess])
    return shown.table(line(plan), ["class", "cost", "length [m]", "weight", "ESS"], rows)


def draw(plan: Any, samples: int, axes: Any) -> Any:
    """The axes, drawn on; see `Plan.plot`.

    Raises:
        OptionError: the plan does not know its scene.
    """
    if plan.space is None:
        raise OptionError("this plan does not know its scene; plot one that Controller, Mppi or Optimal made")
    axes = axes_of.on(axes, "plan.plot")
    ground.draw(axes, plan.space.scene, plan.time)
    ground.foreseen(axes, plan.movers, plan.time)
    _samples(axes, plan, samples)
    by = weights(plan)
    labels = [f"{shown.turns(id)}: {shown.share(by[id]) if id in by else '-'}" for id in plan.ids]
    drawn = list(zip(plan.references, labels, strict=False))
    lines.classes(axes, [one.trajectory.points for one, _ in drawn], [label for _, label in drawn], "class: weight")
    lines.dot(axes, plan.state)
    if len(plan.control) == 2:
        lines.arrow(axes, plan.state[:2], plan.state[:2] + ALONG * plan.control)
    axes.set_title(f"{plan.space.scene.name} at {plan.time:.2f} s", fontsize=10)
    return axes


def _samples(axes: Any, plan: Any, count: int) -> None:
    """The heaviest samples, stronger the more they weigh, then as many of those that died, in grey."""
    if plan.estimate is None or plan.replay is None or count < 1:
        return
    rollouts, weight = plan.estimate.rollouts, plan.estimate.weight
    arrived = np.flatnonzero(rollouts.paths.outcome == Outcome.GOAL)
    died = np.flatnonzero(rollouts.paths.outcome == Outcome.COLLISION)[:count]
    best = arrived[np.argsort(-weight[arrived], kind="stable")[:count]]
    share = weight[best] / max(float(weight[best].max(initial=0.0)), 1e-300)
    for chosen, opacity in ((died, FAINT), (best, FAINT + (STRONG - FAINT) * share)):
        if len(chosen):
            paths = _paths(plan, rollouts, chosen)
            lines.many(axes, paths, lines.SAMPLE, width=0.7, opacity=opacity, zorder=2)


def _paths(plan: Any, rollouts: Any, chosen: NDArray[np.int64]) -> list[Array]:
    states, steps = plan.replay.trace(rollouts, chosen)
    return [path[: int(count) + 1, :2] for path, count in zip(states, steps, strict=True)]
