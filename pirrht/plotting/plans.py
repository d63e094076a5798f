"""A plan as a picture: the state, the reference of every class, samples and the control on a map of the scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from pirrht.outcome import Outcome
from pirrht.plotting import axes as axes_of
from pirrht.plotting import ground, lines


def draw(plan: Any, labels: list[str], samples: int, axes: Any) -> Any:
    """Return the axes, drawn on; `labels` are of the references (`Plan.plot`)."""
    axes = axes_of.on(axes, "plan.plot")
    ground.draw(axes, plan.space.scene, plan.time)
    ground.foreseen(axes, plan.movers, plan.time)
    if plan.estimate is not None and plan.replay is not None and samples > 0:
        _draw_samples(axes, plan, samples)
    lines.classes(axes, [one.trajectory.points for one in plan.references], labels, "class: weight")
    lines.dot(axes, plan.state)
    if len(plan.control) == 2:
        lines.arrow(axes, plan.state[:2], plan.state[:2] + 0.5 * plan.control)  # where it leads to in 0.5 s
    axes.set_title(f"{plan.space.scene.name} at {plan.time:.2f} s", fontsize=10)
    return axes


def _draw_samples(axes: Any, plan: Any, count: int) -> None:
    """Draw the heaviest samples, stronger the more they weigh, then as many of those that died."""
    rollouts, weight = plan.estimate.rollouts, plan.estimate.weight
    arrived = np.flatnonzero(rollouts.paths.outcome == Outcome.GOAL)
    died = np.flatnonzero(rollouts.paths.outcome == Outcome.COLLISION)[:count]
    best = arrived[np.argsort(-weight[arrived], kind="stable")[:count]]
    share = weight[best] / max(float(weight[best].max(initial=0.0)), 1e-300)
    for chosen, opacity in ((died, 0.08), (best, 0.08 + 0.52 * share)):  # opaque samples would hide the map
        if len(chosen):
            states, steps = plan.replay.trace(rollouts, chosen)
            paths = [path[: int(count) + 1, :2] for path, count in zip(states, steps, strict=True)]
            lines.many(axes, paths, lines.SAMPLE, width=0.7, opacity=opacity, zorder=2)
