"""Maps of a plan on paper, with matplotlib (extra `figures`).

Among moving obstacles they show where these and the references are at equal moments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import ceil
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pirrht.arrays import Array
from pirrht.errors import OptionError
from pirrht.geometry.obstacle import Mover
from pirrht.geometry.scene import Goal
from pirrht.planner.references import Reference
from pirrht.planner.tree import HomologyTree
from pirrht.topology.homology import Homology
from sim.drawing.colors import ClassColors, rgb, title
from sim.drawing.sides import NAMED, by_side, called, passed, places_of
from sim.drawing.strokes import timed
from sim.drawing.tubes import outlines
from sim.files import replaced
from sim.plotting import ground
from sim.plotting.ground import MOVER
from sim.scenario import Scenario
from sim.scenario.convergence import Convergence

INK = "#222222"
TREE = "#9aa3ab"  # no colour of a class
WIDE = 36  # characters of a line of the legend
ROW, SPARE = 0.17, 0.1  # height of such a line [in], as the map is a little lower; what may stand out below it
Label = tuple[str, Array]  # and its place (2,) [m]
NOBODY: Mapping[str, Sequence[Label]] = {}
ENDINGS = (".png", ".pdf", ".svg")
STEPS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # between moments [s]
MOST = 8  # moments, where steps allow
APART = 0.022  # from each other that numbers are at least, over the width of the map


def draw_plan(path: Path, scenario: Scenario, tree: HomologyTree, references: Sequence[Reference]) -> None:
    """Write a map with obstacles, tree and the reference of every class."""
    plt = pyplot()
    scene = scenario.loaded.scene
    size = scene.upper - scene.lower
    high = 6.2 * float(size[1] / size[0]) + 0.8
    figure, axes = plt.subplots(figsize=(8.0, high))  # the legend beside it may be higher; what is saved holds both
    told = [passed(reference, tree.homology) for reference in references]
    draw_scene(axes, scenario, _spoken(told, tree.homology))
    number_obstacles(axes, scenario)
    draw_tree(axes, tree)
    colors = ClassColors()
    colors.meet(reference.id for reference in references)
    for reference, bodies in reversed(list(zip(references, told, strict=True))):
        line = reference.trajectory.points
        axes.plot(*line[:, :2].T, color=rgb(colors[reference.id]), lw=2.2, label=_label(reference, bodies))
    step = draw_moments(axes, scenario, references, colors) if scene.movers else 0.0
    handles, labels = axes.get_legend_handles_labels()
    rows = sum(1 + label.count("\n") for label in labels)
    axes.legend(
        handles[::-1], labels[::-1], fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False,
        title="class: cost", title_fontsize=8, ncols=max(1, ceil(ROW * rows / high - SPARE)),
    )  # fmt: skip
    when = f"; bodies at 0 s, dots and outlines every {step:g} s" if step else ""
    axes.set_title(f"{scene.name}: {tree.size} vertices, {len(references)} classes, cheapest first{when}", fontsize=10)
    _save(plt, figure, path, "--png")


def _spoken(told: Sequence[Sequence[tuple[str, str]]], homology: Homology) -> dict[str, list[Label]]:
    """Labels of bodies that the legend speaks of, with their numbers in names of classes, and where they are at 0 s.

    Of a body whose parts are told one by one each has its own. `told` is `passed` of each reference.
    """
    spoken = {name for rows in told for name, _ in rows}
    rows = zip(homology.names, called(homology), places_of(homology, np.zeros(1))[:, 0], strict=True)
    labels: dict[str, list[Label]] = {}
    for number, (name, said, place) in enumerate(rows, len(homology.markers) + 1):
        if said in spoken:
            labels.setdefault(name, []).append((f"{name} {number}" if said == name else said, place))
    return labels


def _label(reference: Reference, bodies: Sequence[tuple[str, str]]) -> str:
    """A class and its cost, and below them on which side of bodies that move it passes."""
    lines = [
        line for side in by_side(bodies) for line in wrap(side, WIDE, initial_indent="  ", subsequent_indent="    ")
    ]
    return "\n".join([f"{title(reference.id)}: {reference.cost:.2f}", *lines])


def draw_convergence(
    path: Path, scene: str, convergence: Convergence, references: Sequence[Reference], *, at_most: int = 16
) -> None:
    """Write the lengths of the best path per class against the iteration, like the paper's Fig. 3a."""
    plt = pyplot("--convergence")
    figure, axes = plt.subplots(figsize=(8.0, 4.8), layout="constrained")
    colors = ClassColors()
    colors.meet(reference.id for reference in references)
    taut = {reference.id: reference.length for reference in references}
    shown = [name for name in taut if name in convergence.ids][:at_most]
    for name in shown:
        lengths = convergence.lengths[:, convergence.ids.index(name)]
        label = f"{title(name)}: {lengths[-1]:.2f} m, taut {taut[name]:.2f}"
        lengths = np.where(np.isfinite(lengths), lengths, np.nan)
        axes.step(convergence.iterations, lengths, where="post", color=rgb(colors[name]), lw=1.6, label=label)
        end = convergence.iterations[-1]
        axes.plot([0.97 * end, 1.03 * end], [taut[name]] * 2, color=rgb(colors[name]), lw=1.6, ls=":")
    if shown:  # first paths may be several times as long as the last ones: those are what one looks at
        axes.set_ylim(0.97 * min(taut.values()), 1.5 * max(taut[name] for name in shown))
    axes.set_xlabel("iteration (random states drawn)")
    axes.set_ylabel("length of the tree's best path per class [m]")
    axes.set_title(f"{scene}: {convergence.vertices[-1]} vertices; dotted: pulled taut within the class", fontsize=10)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, title="class", title_fontsize=8
    )
    _save(plt, figure, path, "--convergence")


def draw_scene(axes: Any, scenario: Scenario, spoken: Mapping[str, Sequence[Label]] = NOBODY) -> None:
    """Workspace, obstacles seen from above, start and heading, goal, and what moves at 0 s, by name.

    Args:
        spoken: labels of bodies that bear some even where many move.
    """
    from matplotlib.patheffects import withStroke

    scene = scenario.loaded.scene
    ground.draw(axes, scene)
    halo = [withStroke(linewidth=1.8, foreground="white")]
    for mover in scene.movers:
        own = [(mover.name, mover.motion.pose(0.0)[:2])] if len(scene.movers) <= NAMED else []
        for label, (x, y) in spoken.get(mover.name, own):
            axes.text(x, y, label, fontsize=7, ha="center", va="center", color=INK, path_effects=halo, zorder=9)
    if scenario.problem.dynamics.angles:
        heading = scene.robot_radius * 1.6 * np.array([np.cos(scene.start[2]), np.sin(scene.start[2])])
        axes.annotate("", scene.start[:2] + heading, scene.start[:2], arrowprops={"arrowstyle": "->", "lw": 1.2})


def number_obstacles(axes: Any, scenario: Scenario) -> None:
    """The numbers by which classes name the topological obstacles, from 1, at their markers."""
    for i, (x, y) in enumerate(scenario.space.homology.markers, 1):
        axes.text(x, y, str(i), color="white", fontsize=8, ha="center", va="center", zorder=5)


def draw_tree(axes: Any, tree: HomologyTree) -> None:
    """The best edge of every vertex, as its own curve."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(tree_lines(tree), colors=TREE, lw=0.35, alpha=0.5, zorder=1))


def tree_lines(tree: HomologyTree) -> list[Array]:
    """The edge that each vertex' cheapest node takes, as polylines (k, 2)."""
    graph = tree.graph
    tails, heads = [], []
    for v in range(tree.size):
        count = int(graph.nodes[v])
        if count == 0:
            continue
        e = int(graph.parent[v, int(np.argmin(graph.cost[v, :count]))])
        if e >= 0:
            tails.append(v)
            heads.append(int(graph.head[e]))
    curves = tree.steering.connect(tree.states[tails], tree.states[heads])
    return [_until(line, tree.space.scene.goal) for line in curves.points(0.15)]


def _until(line: Array, goal: Goal) -> Array:
    """A line (k, 2) up to where it is in the goal's disc: what an edge may do beyond counts for nothing."""
    within = np.flatnonzero(np.hypot(*(line[:, :2] - goal.center).T) < goal.radius)
    return line[: within[0] + 1] if len(within) else line


def _save(plt: Any, figure: Any, path: Path, option: str) -> None:
    """Write a figure whole or not at all, in the format of the file's ending."""
    try:
        with replaced(path, option) as stream:
            figure.savefig(stream, format=path.suffix[1:].lower(), dpi=150, bbox_inches="tight")
    finally:
        plt.close(figure)


def check(path: Path, option: str) -> None:
    """Make sure, before any work, that a figure can be drawn and has an ending that says how.

    Raises:
        OptionError: matplotlib is missing, or it knows no such ending.
    """
    pyplot(option)
    if path.suffix.lower() not in ENDINGS:
        raise OptionError(f"{option} {path}: no figure has this ending; give a file that ends in {', '.join(ENDINGS)}")


def pyplot(option: str = "--png") -> Any:
    """matplotlib.pyplot without a display; OptionError, naming the option, if matplotlib is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise OptionError(f"{option} needs matplotlib; install it with: pip install matplotlib") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    return plt


def draw_moments(axes: Any, scenario: Scenario, references: Sequence[Reference], colors: ClassColors) -> float:
    """Outline bodies where they will be, and put a dot on every reference, at equal moments.

    Returns:
        the time between moments [s]; 0 where no reference moves.
    """
    ways = [timed(reference, 0.0) for reference in references]
    last = max((float(way[-1, 2]) for way in ways), default=0.0)
    if last <= 0.0:
        return 0.0
    step = next((step for step in STEPS if last / step <= MOST), STEPS[-1])
    moments = np.arange(step, last + 0.5 * step, step)
    told: list[Array] = []
    apart = APART * float(np.ptp(axes.get_xlim()))
    for mover in scenario.loaded.scene.movers:
        _outline(axes, mover, moments, told, apart)
    for reference, way in zip(references, ways, strict=True):
        _dots(axes, way, moments, rgb(colors[reference.id]), told, apart)
    return step


def _outline(axes: Any, mover: Mover, moments: Array, told: list[Array], apart: float) -> None:
    """A body's outlines, the paler the later, until it stands still; within its first part's the number of seconds.

    Args:
        told, apart: as `_dots` takes them.
    """
    from matplotlib.patches import Polygon

    until = moments[: 1 + int(np.searchsorted(moments, mover.motion.last))]
    for part, rings in enumerate(outlines(mover, until)):
        for time, ring in zip(until, rings, strict=True):
            alpha = 0.9 - 0.7 * float(time / moments[-1])
            axes.add_patch(Polygon(ring, closed=True, fill=False, ec=MOVER, lw=0.9, alpha=alpha, zorder=2.9))
            if part == 0 and _room(place := ring.mean(axis=0), told, apart):
                axes.annotate(f"{time:g}", place, ha="center", va="center", fontsize=6.5, color=MOVER, zorder=2.9)


def _dots(axes: Any, way: Array, moments: Array, color: Any, told: list[Array], apart: float) -> None:
    """Dots on a path (k, 3) at those moments that it is still under way, with the number of seconds beside.

    Args:
        told: places (2,) that have a number, to which its own are added.
        apart: from those that another must be, for both to be read [m].
    """
    for time, x, y in _places(way, moments):
        axes.plot(x, y, "o", ms=4.0, mfc="white", mec=color, mew=1.2, zorder=7)
        if _room(np.array([x, y]), told, apart):
            axes.annotate(
                f"{time:g}", (x, y), xytext=(3, 4), textcoords="offset points", fontsize=6.5, color=INK, zorder=8
            )


def _room(place: Array, told: list[Array], apart: float) -> bool:
    """Return whether a number at a place (2,) can be read; if so, the place is noted."""
    free = all(np.hypot(*(place - other)) >= apart for other in told)
    if free:
        told.append(place)
    return free


def _places(way: Array, moments: Array) -> Iterator[NDArray[np.float64]]:
    at = moments[moments <= way[-1, 2]]
    yield from np.column_stack([at, *(np.interp(at, way[:, 2], way[:, k]) for k in (0, 1))])
