"""Fig. 3: lengths of the best paths of the car per class while the tree grows, and the references at the end."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from figures import ground, style
from figures.effort import Effort, Tick
from pirrht.arrays import Array
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.plotting.colors import ClassColors
from sim.drawing.colors import title
from sim.result import convergence_json
from sim.scenario import Scenario

VERTICES, NOTES = 1000, 250  # of the tree, as in the paper; notes of lengths taken on the way
SHOWN = 8  # classes, the shortest first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lengths:
    """What the figure shows."""

    scenario: Scenario
    tree: HomologyTree
    convergence: Mapping[str, Any]  # `convergence_json`
    references: Sequence[Reference]  # shortened, the shortest of all classes first

    def history(self, reference: Reference) -> Array:
        """Lengths of a class' best path at each note, NaN before it is found [m]."""
        column = np.array(self.convergence["lengths"][reference.id])
        known: Array = np.where(np.isfinite(column), column, np.nan)
        return known


def work(effort: Effort, tick: Tick) -> Lengths:
    """Grow the tree of `clutter`."""
    scenario = effort.scenario("clutter", vertices=effort.vertices or VERTICES)
    tree, vertices = scenario.empty_tree(), scenario.settings.vertices
    convergence = convergence_json(tree, scenario.start, vertices, every=max(1, vertices // NOTES))
    references = scenario.references(tree)
    tick()
    known = [reference for reference in references if reference.id in convergence["lengths"]]
    return Lengths(scenario=scenario, tree=tree, convergence=convergence, references=known[:SHOWN])


def draw(plt: Any, shown: Lengths) -> Any:
    """Lengths against iterations beside the map of the references."""
    scene = shown.scenario.loaded.scene
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(style.PAGE, 3.15), layout="constrained", gridspec_kw={"width_ratios": [1.25, 1.0]}
    )
    colors = ClassColors(reference.id for reference in shown.references)
    _histories(left, shown, colors)
    ground.draw(right, scene)
    for reference in reversed(shown.references):
        ground.dots(right, reference.trajectory.points, style.rgb(colors[reference.id]), width=1.2, count=18)
    ground.robot(right, scene, shown.scenario.start)
    for i, (x, y) in enumerate(shown.scenario.space.homology.markers, 1):
        right.text(x, y, str(i), color="white", fontsize=6, ha="center", va="center", zorder=11)
    ground.frame(right, scene.lower, scene.upper)
    right.set(xlabel="$x$ [m]", ylabel="$y$ [m]")
    style.panel(right, 1, f"references, {shown.tree.size} vertices")
    figure.legend(
        *left.get_legend_handles_labels(), loc="outside lower center", ncols=4, columnspacing=1.6,
        title="class: turns around obstacles, length of its reference", title_fontsize=7,
    )  # fmt: skip
    return figure


def _histories(axes: Any, shown: Lengths, colors: ClassColors) -> None:
    iterations = shown.convergence["iterations"]
    for reference in shown.references:
        color, lengths = style.rgb(colors[reference.id]), shown.history(reference)
        label = f"{title(reference.id)}: {reference.length:.2f} m"
        axes.step(iterations, lengths, where="post", color=color, lw=1.2, label=label)
        axes.plot([1.01 * iterations[-1], 1.05 * iterations[-1]], [reference.length] * 2, color=color, lw=1.6)
    last = [r.length for r in shown.references]
    if last:  # first paths may be several times as long as the last ones: those are what one looks at
        axes.set_ylim(0.97 * min(last), 1.35 * max(last))
    labels = {"xlabel": "iteration (random states drawn)", "ylabel": "shortest path of the class [m]"}
    style.lines(axes, xlim=(0, 1.06 * iterations[-1]), **labels)
    style.panel(axes, 0, "tree's paths; bars at the right: references, pulled taut")
