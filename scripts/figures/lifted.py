"""Fig. 1: the tree in the H-augmented space, one panel per obstacle, and the best path of every class."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from figures import style
from figures.effort import Effort, Tick
from pirrht.arrays import Array
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.plotting.colors import ClassColors
from pirrht.plotting.strokes import even, outline
from sim.drawing import strokes
from sim.drawing.colors import title
from sim.scenario import Scenario

PANELS = 2
EDGES = 4000  # of the tree, at most
TREE = "#7fb7cf"
BEADS = 12  # circles on a reference
VIEW = {"elev": 24.0, "azim": -62.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lifted:
    """What the figure shows."""

    scenario: Scenario
    tree: HomologyTree
    references: Sequence[Reference]


def work(effort: Effort, tick: Tick) -> Lifted:
    """Grow the tree of `slit` and read off the references."""
    scenario = effort.scenario("slit")
    tree = scenario.grown_tree()
    references = scenario.references(tree)
    tick()
    return Lifted(scenario=scenario, tree=tree, references=references)


def draw(plt: Any, shown: Lifted) -> Any:
    """One panel in three dimensions per obstacle, z being its H."""
    obstacles = shown.scenario.space.obstacles[:PANELS]
    figure = plt.figure(figsize=(style.PAGE, 3.35))
    colors = ClassColors(reference.id for reference in shown.references)
    for k, part in enumerate(obstacles):
        place = (-0.015 + 0.5 * k, 0.1, 0.48, 0.86)
        axes = figure.add_axes(place, projection="3d", computed_zorder=False, proj_type="ortho")
        _panel(axes, shown, k, colors)
        axes.text2D(
            0.5, 0.99, f"({chr(ord('a') + k)}) $z$ = $H$ of obstacle {k + 1} ({part.names[0]})",
            transform=axes.transAxes, ha="center", va="top",
        )  # fmt: skip
    _legend(figure, shown, colors)
    return figure


def _panel(axes: Any, shown: Lifted, obstacle: int, colors: ClassColors) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    scene, limit = shown.scenario.loaded.scene, shown.scenario.settings.limit
    low, high = 1.0 - limit - 0.1, 1.0 + limit + 0.1
    _floor(axes, Poly3DCollection, shown, low, obstacle)
    x, y = shown.scenario.space.homology.markers[obstacle]
    axes.plot([x, x], [y, y], [low, high], color=style.INK, lw=0.7, ls=(0, (4, 3)), zorder=2)
    ends = strokes.tree_edges(shown.tree, obstacle, EDGES)
    far = np.argsort(-ends[:, :, 1].mean(axis=1), kind="stable")  # what is near is drawn last
    axes.add_collection3d(Line3DCollection(ends[far], colors=TREE, lw=0.25, alpha=0.55, zorder=3))
    for reference in reversed(shown.references):
        line, beads = _raised(shown, reference, obstacle)
        color = style.rgb(colors[reference.id])
        axes.plot(*line.T, color="white", lw=2.8, zorder=4)
        axes.plot(*line.T, color=color, lw=1.5, zorder=5)
        axes.plot(*beads.T, "o", ms=2.8, mfc="white", mec=color, mew=0.9, ls="none", zorder=6)
    style.space(axes, scene.lower, scene.upper, (low, high), height=4.2, **VIEW)
    axes.set_zlabel(f"$H_{obstacle + 1}$ [turns]", labelpad=-6, rotation=90)
    axes.set_zticks([0.4, 0.7, 1.0, 1.3, 1.6] if limit == 0.6 else np.linspace(1 - limit, 1 + limit, 5).round(2))


def _floor(axes: Any, polygons: Any, shown: Lifted, z: float, obstacle: int) -> None:
    """The map on the floor: obstacles, that of the panel darker, and the goal."""
    scene = shown.scenario.loaded.scene
    own = shown.scenario.space.obstacles[obstacle].names
    for solid in scene.obstacles:
        face = style.INK if solid.name in own else "#b4bac1"
        axes.add_collection3d(polygons([_at(outline(solid), z)], facecolors=face, edgecolors="none", zorder=1))
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = scene.goal.center + scene.goal.radius * np.column_stack([np.cos(turn), np.sin(turn)])
    axes.add_collection3d(polygons([_at(ring, z)], facecolors=style.GOAL, edgecolors=style.GOAL_EDGE, lw=0.6, zorder=1))


def _raised(shown: Lifted, reference: Reference, obstacle: int) -> tuple[Array, Array]:
    """A reference with the H of what is left of it as third coordinate: its line (k, 3) and circles on it."""
    homology, line = shown.scenario.space.homology, reference.trajectory.points
    fine, beads = even(line, 200), even(line, BEADS)
    return tuple(  # type: ignore[return-value]
        np.column_stack([points, strokes.remaining(homology, reference, points, obstacle)]) for points in (fine, beads)
    )


def _at(points: Array, z: float) -> Array:
    return np.column_stack([points, np.full(len(points), z)])


def _legend(figure: Any, shown: Lifted, colors: ClassColors) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=style.rgb(colors[r.id]), lw=1.5, marker="o", ms=3, mfc="white",
               label=f"class {title(r.id)}: cost {r.cost:.2f}")
        for r in shown.references
    ]  # fmt: skip
    handles += [
        Line2D([], [], color=TREE, lw=0.8, label=f"tree, {shown.tree.size} vertices"),
        Patch(fc=style.INK, label="the panel's obstacle"),
        Patch(fc=style.GOAL, ec=style.GOAL_EDGE, lw=0.6, label="goal"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), columnspacing=1.2, handletextpad=0.5)
